"""Hand-ins: what is scored. Methods by name, functions of your own, or folders of poses made elsewhere."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import cache
from pathlib import Path

import numpy as np

from dmae.completion.methods.registry import completion_method, find_method
from dmae.data.clip import Clip, Poses3D
from dmae.evaluation.predictions import fitting
from dmae.formats.recordings.pose_files import pose_paths, read_poses
from dmae.plugins import load_function

OURS = "capture"
"""The capture that comes with the package, nothing filled."""


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
                f"{lacking[0]}.npz, as dmae export format=npz writes, or another format that dmae.read_poses reads"
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
            found = read_poses(_file(self.folder, name))
            if found.fps is not None and not np.isclose(found.fps, given.fps, rtol=1e-3):
                raise ValueError(f"{where}: expected {given.fps:g} frames per second, found {found.fps:g}")
            poses = found.poses
        else:
            function = _loaded(self)
            try:
                poses = function(given.poses, given.fps) if self.task == Task.completion else function(given)
            # A function of another project may raise anything; the clip and the function are named with it.
            except Exception as error:
                raise ValueError(f"{where}: {type(error).__name__}: {error}") from error
        return check_poses(poses, given.poses, self.task, where)


def find_hand_in(given: str | Callable, task: Task, weights: str | None = None) -> HandIn:
    """Return the hand-in of a name or of a function."""
    if callable(given):
        return HandIn(getattr(given, "__name__", repr(given)), task, weights, given)
    return HandIn(given, task, weights)


def check_poses(poses: Poses3D, given: Poses3D, task: Task, where: str) -> Poses3D:
    """Return poses on the skeleton of the given ones.

    Args:
        poses: Handed in.
        given: Captured poses of the clip.
        task: What they are.
        where: What they are of, for messages.

    Raises:
        ValueError: they are no `Poses3D`, of another length, number of persons or unit, on a skeleton without a
            conversion, or not finite.
    """
    if not isinstance(poses, Poses3D):
        raise ValueError(f"{where}: expected dmae.Poses3D, found {type(poses).__name__}")
    return fitting(poses, given, where, tracks=task == Task.completion)


def _file(folder: Path, name: str) -> Path | None:
    """Return the file or folder of a clip's poses, None if there is none."""
    place = folder / name
    return (pose_paths(place.parent) or {}).get(place.name) if place.parent.is_dir() else None


@cache
def _loaded(hand_in: HandIn) -> Callable:
    """The function of a hand-in, loaded once a process: weights are large."""
    return hand_in.function()
