"""Poses that come one frame after the other, and their completion with a stated delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from dmae.clip import Poses3D, Source

if TYPE_CHECKING:
    from dmae.complete import Completer

BATCH = 0.2
"""s of frames that are finished together."""
DELAY = 0.28
"""s; half a window of the default model."""
MEMORY = 5.0
"""s before the frames that wait that are remembered."""

_JOINTS = [field.name for field in fields(Poses3D) if field.name != "skeleton"]


@dataclass(frozen=True)
class FinishedFrame:
    """One frame, of which nothing will change any more.

    Attributes:
        number: Of the frame, from 0 on.
        people: (P,) who is there; a number stands for the same person in all frames.
        poses: (1, P, J, ...) with joints, sources, covariances and views.
    """

    number: int
    people: np.ndarray
    poses: Poses3D


class OnlineCompleter:
    """`dmae.complete.Completer` for frames as they come.

    A frame comes out when so many are known after it, as the completer has it in a recording that ends there and
    began five seconds before the frames that wait. The whole recording up to there would differ in what was hidden
    for those five seconds, in limbs that are recalled (`dmae.recall`) from before, and where windows are no whole
    number of frames apart. Of what is missing when a frame comes out, nothing is known of its return: a person of whom
    nothing is measured comes out only if measured again within the delay.

    Attributes:
        delay: Frames that are known after one when it comes out, at least.
    """

    def __init__(self, completer: Completer, fps: float, delay: float = DELAY):
        """
        Args:
            fps: Frames per second at which they come.
            delay: s.

        Raises:
            ValueError: fps is not positive or the delay negative.
        """
        if not (np.isfinite(fps) and fps > 0 and np.isfinite(delay) and delay >= 0):
            raise ValueError(f"fps must be positive and delay not negative, found {fps} and {delay}")
        self.delay = round(delay * fps)
        self._completer, self._fps = completer, fps
        self._step = max(round(completer.stride * fps), 1)
        self._memory = ceil(MEMORY * fps / self._step) * self._step
        self._frames: list[FinishedFrame] = []
        self._waiting = 0

    @property
    def began(self) -> int:
        """Number of the first frame that is remembered."""
        return self._frames[0].number if self._frames else 0

    def push(self, frames: Sequence[FinishedFrame]) -> list[FinishedFrame]:
        """Take the next frames; return those that are complete by them, in order."""
        self._frames += frames
        self._waiting += len(frames)
        return self._complete(self._waiting - self.delay)

    def flush(self) -> list[FinishedFrame]:
        """The frames that still wait: there will be no more."""
        return self._complete(self._waiting)

    def _complete(self, count: int) -> list[FinishedFrame]:
        """Complete the first so many of those that wait."""
        if count <= 0:
            return []
        first = len(self._frames) - self._waiting
        now = slice(first, first + count)
        people = np.unique(np.concatenate([frame.people for frame in self._frames]))
        poses = joined(self._frames, people)
        done = apart(self._completer(poses, self._fps, now), people, self._frames[first].number)
        self._waiting -= count
        spare = max(len(self._frames) - self._waiting - self._memory, 0)
        del self._frames[: spare - spare % self._step]
        return done


def replayed(completer: Completer, poses: Poses3D, fps: float, delay: float = DELAY) -> Poses3D:
    """Poses completed as they would have been while they were captured, 0.2 s of frames at a time."""
    online = OnlineCompleter(completer, fps, delay)
    people = np.arange(poses.xyz.shape[1])
    frames, step = apart(poses, people), max(round(BATCH * fps), 1)
    done = [frame for start in range(0, len(frames), step) for frame in online.push(frames[start : start + step])]
    done += online.flush()
    return joined(done, people) if done else poses


def apart(poses: Poses3D, people: np.ndarray, number: int = 0) -> list[FinishedFrame]:
    """Poses (F, P, J) of people (P,) frame by frame, from that number on; of each frame those who are there."""
    frames = []
    for i, there in enumerate((poses.source != Source.ABSENT).any(-1)):
        joints = {name: getattr(poses, name)[i : i + 1, there] for name in _JOINTS}
        frames.append(FinishedFrame(number + i, people[there], Poses3D(poses.skeleton, **joints)))
    return frames


def joined(frames: Sequence[FinishedFrame], people: np.ndarray) -> Poses3D:
    """Poses (F, P, J) of one frame or more, with a row for each of the people (P,), ascending."""
    skeleton = frames[0].poses.skeleton
    whole = Poses3D(skeleton, np.full((len(frames), len(people), len(skeleton), 3), np.nan))
    for i, frame in enumerate(frames):
        row = np.searchsorted(people, frame.people)
        for name in _JOINTS:
            getattr(whole, name)[i, row] = getattr(frame.poses, name)[0]
    return whole
