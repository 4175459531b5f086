"""Hand-ins of a benchmark: methods by name, functions of your own, or folders of poses made elsewhere."""

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
"""Name of the capture that comes with the package, without completion."""


class Task(StrEnum):
    """The kind of result that a method hands in."""

    completion = "completion"
    """Poses with the holes of our capture filled: all methods on the same holes."""
    capture = "capture"
    """Poses made from detections, by any capture."""


@dataclass(frozen=True)
class HandIn:
    """A method or capture that is scored.

    Attributes:
        name: The user's name for it: a completion method, `capture`, `package.module:function`, or a folder.
        task: The task that it solves.
        weights: Folder of trained weights, for learned completion methods.
        own: A Python function; `name` is then the name of the function.
    """

    name: str
    task: Task
    weights: str | None = None
    own: Callable | None = None

    @property
    def folder(self) -> Path | None:
        """The folder of poses; None if the name is not a folder. Write `./NAME` if a method has the same name."""
        known = self.own or self.name in completion_method or self.name == OURS
        return Path(self.name) if not known and Path(self.name).is_dir() else None

    def check(self, clips: list[str]) -> None:
        """Check the hand-in before anything is computed.

        Args:
            clips: Ids of the clips of the benchmark.

        Raises:
            ValueError: the method, function or folder does not exist.
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
        """Return the function that makes poses. Its arguments are poses and frames per second, or a clip."""
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
            given: The data that methods get, with our captured poses.

        Raises:
            ValueError: the poses do not fit the clip; the message names both.
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
            # A function of another project may raise any error. The message names the clip and the function.
            except Exception as error:
                raise ValueError(f"{where}: {type(error).__name__}: {error}") from error
        return check_poses(poses, given.poses, self.task, where)


def find_hand_in(given: str | Callable, task: Task, weights: str | None = None) -> HandIn:
    """Return the hand-in for a name or a function."""
    if callable(given):
        return HandIn(getattr(given, "__name__", repr(given)), task, weights, given)
    return HandIn(given, task, weights)


def check_poses(poses: Poses3D, given: Poses3D, task: Task, where: str) -> Poses3D:
    """Return poses that were handed in, converted to the skeleton of the captured poses.

    Args:
        poses: The poses that were handed in.
        given: Captured poses of the clip.
        task: Task that the poses solve.
        where: Name of the poses in messages.

    Raises:
        ValueError: the poses are not `Poses3D`; differ in length, number of persons or unit; have a skeleton without a
            conversion; or are not finite.
    """
    if not isinstance(poses, Poses3D):
        raise ValueError(f"{where}: expected dmae.Poses3D, found {type(poses).__name__}")
    return fitting(poses, given, where, tracks=task == Task.completion)


def _file(folder: Path, name: str) -> Path | None:
    """Return the file or folder of a clip's poses; None if it does not exist."""
    place = folder / name
    return (pose_paths(place.parent) or {}).get(place.name) if place.parent.is_dir() else None


@cache
def _loaded(hand_in: HandIn) -> Callable:
    """Return the function of a hand-in. It is loaded once per process, because weights are large."""
    return hand_in.function()
