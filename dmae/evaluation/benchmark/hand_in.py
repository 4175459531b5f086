"""Hand-ins: what is scored. Methods by name, functions of your own, or folders of poses made elsewhere."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path

import numpy as np

from dmae.completion.methods.registry import completion_method, find_method
from dmae.data.clip import Clip, Poses3D
from dmae.data.store import load_clip
from dmae.formats.npz import read_npz
from dmae.plugins import load_function

OURS = "capture"
"""The capture that comes with the package, nothing filled."""
_MOST_FACTOR = 3.0
"""Greatest factor between the size of people handed in and of those captured."""


class Task(StrEnum):
    """What is handed in."""

    completion = "completion"
    """Poses with the holes of our capture filled: all methods on the same holes."""
    capture = "capture"
    """Poses made from detections, by any capture."""


@dataclass(frozen=True)
class HandIn:
    """What is scored.

    Attributes:
        name: As users name it: a completion method, `capture`, `package.module:function`, or a folder.
        task: What it hands in.
        weights: Folder of trained weights, for learned completion methods.
        own: A function handed in by Python; then the name is its.
    """

    name: str
    task: Task
    weights: str | None = None
    own: Callable | None = None

    @property
    def folder(self) -> Path | None:
        """The folder of poses, None if it is none; a folder called as a method is `./NAME`."""
        known = self.own or self.name in completion_method or self.name == OURS
        return Path(self.name) if not known and Path(self.name).is_dir() else None

    def check(self, clips: list[str]) -> None:
        """Check it before anything is computed.

        Args:
            clips: Ids of the clips of the benchmark.

        Raises:
            ValueError: there is no such method, function or folder.
            FileNotFoundError: the folder lacks clips; the message names them.
        """
        if self.folder is None:
            self.function()
            return
        lacking = [name for name in clips if _file(self.folder, name) is None]
        if lacking:
            more = f" and {len(lacking) - 3} more" if len(lacking) > 3 else ""
            raise FileNotFoundError(
                f"{self.name}: lacks {len(lacking)} of {len(clips)} clips: {', '.join(lacking[:3])}{more}; expected "
                f"{lacking[0]}.npz, as dmae export format=npz writes, or a clip with poses in {lacking[0]}/"
            )

    def function(self) -> Callable:
        """Return the function that makes poses: of poses and frames per second, or of a clip."""
        if self.own:
            return self.own
        if self.task == Task.completion:
            return find_method(self.name).load(Path(self.weights) if self.weights else None)
        if self.name == OURS:
            return lambda clip: clip.poses
        if ":" not in self.name:
            raise ValueError(f"captures={self.name}: expected {OURS}, package.module:function, or a folder of poses")
        return load_function("captures", self.name)

    def poses(self, name: str, given: Clip) -> Poses3D:
        """Return the poses of one clip, checked.

        Args:
            name: Id of the clip.
            given: What methods are given of it, with our captured poses.

        Raises:
            ValueError: they do not fit the clip; the message names both.
        """
        where = f"{self.name}, clip {name}"
        if self.folder is not None:
            poses, fps = _read(_file(self.folder, name))
            if abs(fps - given.fps) > 1e-3 * given.fps:
                raise ValueError(f"{where}: expected {given.fps:g} frames per second, found {fps:g}")
        else:
            function = _loaded(self)
            try:
                poses = function(given.poses, given.fps) if self.task == Task.completion else function(given)
            # A function of another project may raise anything; the clip and the function are named with it.
            except Exception as error:
                raise ValueError(f"{where}: {type(error).__name__}: {error}") from error
        check_poses(poses, given.poses, self.task, where)
        return poses


def find_hand_in(given: str | Callable, task: Task, weights: str | None = None) -> HandIn:
    """Return the hand-in of a name or of a function."""
    if callable(given):
        return HandIn(getattr(given, "__name__", repr(given)), task, weights, given)
    return HandIn(given, task, weights)


def check_poses(poses: Poses3D, given: Poses3D, task: Task, where: str) -> None:
    """Check that poses fit a clip.

    Args:
        poses: Handed in.
        given: Captured poses of the clip.
        task: What they are.
        where: What they are of, for messages.

    Raises:
        ValueError: they are no `Poses3D`, of another skeleton, length, number of persons or unit, or not finite.
    """
    if not isinstance(poses, Poses3D):
        raise ValueError(f"{where}: expected dmae.Poses3D, found {type(poses).__name__}")
    if poses.skeleton != given.skeleton:
        raise ValueError(f"{where}: expected poses on {given.skeleton.name!r}, found {poses.skeleton.name!r}")
    (frames, persons), (found_frames, found_persons) = given.source.shape[:2], poses.source.shape[:2]
    if found_frames != frames:
        raise ValueError(f"{where}: expected {frames} frames, found {found_frames}")
    if task == Task.completion and found_persons != persons:
        raise ValueError(
            f"{where}: expected the {persons} persons of the given poses, in their order, found {found_persons}"
        )
    if np.isinf(poses.xyz).any():
        raise ValueError(f"{where}: has infinite coordinates; joints that are not known must be NaN")
    factor = _person_size(poses) / _person_size(given)
    if factor > _MOST_FACTOR or factor < 1 / _MOST_FACTOR:
        units = {1000: "millimetres", 100: "centimetres", 39.4: "inches"}
        unit = next((f", as if in {unit}" for number, unit in units.items() if 0.6 < factor / number < 1.6), "")
        raise ValueError(f"{where}: people are {factor:.4g} times as large as those given{unit}; expected metres")


def _person_size(poses: Poses3D) -> float:
    """Return the median distance of joints from the median joint of their person, m; NaN if there are none."""
    known = poses.xyz[~np.isnan(poses.xyz).any((-1, -2))].astype(np.float64)
    if not len(known):
        some = poses.xyz.astype(np.float64)
        present = (~np.isnan(some).any(-1)).sum(-1) > 1
        known = some[present]
    if not len(known):
        return np.nan
    return float(np.nanmedian(np.linalg.norm(known - np.nanmedian(known, -2, keepdims=True), axis=-1)))


def _file(folder: Path, name: str) -> Path | None:
    """Return the file or folder of a clip's poses, None if there is none."""
    archive, clip = folder / f"{name}.npz", folder / name
    return archive if archive.is_file() else clip if (clip / "clip.json").is_file() else None


def _read(path: Path) -> tuple[Poses3D, float]:
    if path.is_file():
        return read_npz(path)
    clip = load_clip(path)
    if clip.poses is None:
        raise ValueError(f"{path}: this clip has no poses; dmae complete and dmae capture write them")
    return clip.poses, clip.fps


@cache
def _loaded(hand_in: HandIn) -> Callable:
    """The function of a hand-in, loaded once a process: weights are large."""
    return hand_in.function()
