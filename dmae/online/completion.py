"""Completion online: frames come in one by one and are completed with a stated delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D, Source

if TYPE_CHECKING:
    from dmae.completion.completer import Completer
    from dmae.completion.methods.registry import Fill

BATCH = 0.2
"""s of frames that are completed together."""
DELAY = 0.28
"""s; half a window of the default model."""
MEMORY = 5.0
"""s of frames that are kept before those that wait."""

_JOINTS = [field.name for field in fields(Poses3D) if field.name != "skeleton"]


@dataclass(frozen=True)
class FinishedFrame:
    """One frame that will not change any more.

    Attributes:
        number: Of the frame, from 0 on.
        people: (P,) numbers of the people who are present; a number is the same person in all frames.
        poses: (1, P, J, ...) with joints, sources, covariances and views.
    """

    number: int
    people: np.ndarray
    poses: Poses3D


class OnlineCompleter:
    """`dmae.completion.completer.Completer` for frames as they come in.

    A frame is returned when `delay` frames after it are known. It is completed as in a recording that ends there and
    began five seconds before the frames that wait. The whole recording up to there would give another result for
    joints hidden for those five seconds, for limbs that the Gaussian process predicts from earlier frames, and where
    windows are no whole number of frames apart. A person without measurements in a frame is returned only if
    measured again within the delay.

    Attributes:
        delay: Least number of frames after one that are known when it is returned.
    """

    def __init__(self, completer: Completer, fps: float, delay: float = DELAY):
        """
        Args:
            fps: Frames per second at which they come in.
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
    def first_kept(self) -> int:
        """Number of the first frame that is kept."""
        return self._frames[0].number if self._frames else 0

    def push(self, frames: Sequence[FinishedFrame]) -> list[FinishedFrame]:
        """Take the next frames; return those that are complete now, in order."""
        self._frames += frames
        self._waiting += len(frames)
        return self._complete(self._waiting - self.delay)

    def flush(self) -> list[FinishedFrame]:
        """Return the frames that still wait, at the end of the recording."""
        return self._complete(self._waiting)

    def _complete(self, count: int) -> list[FinishedFrame]:
        """Complete and return the first `count` frames that wait."""
        if count <= 0:
            return []
        first = len(self._frames) - self._waiting
        now = slice(first, first + count)
        people = np.unique(np.concatenate([frame.people for frame in self._frames]))
        poses = join_frames(self._frames, people)
        done = split_frames(self._completer(poses, self._fps, now), people, self._frames[first].number)
        self._waiting -= count
        spare = max(len(self._frames) - self._waiting - self._memory, 0)
        del self._frames[: spare - spare % self._step]
        return done


@completion_method("dmae_online", learned=True, smooths=True)
def dmae_online(weights: Path | None) -> Fill:
    """As dmae_denoise and smoothed, each frame by what is known 0.28 s after it."""
    from dmae.completion.pipeline import SMOOTHING, completers

    completer_for = completers(weights, denoise=None, reject=True, smooth=SMOOTHING)
    return lambda poses, fps: complete_online(completer_for(poses.skeleton), poses, fps)


def complete_online(completer: Completer, poses: Poses3D, fps: float, delay: float = DELAY) -> Poses3D:
    """Return poses as they would have been completed while they were captured, 0.2 s of frames at a time."""
    online = OnlineCompleter(completer, fps, delay)
    people = np.arange(poses.xyz.shape[1])
    frames, step = split_frames(poses, people), max(round(BATCH * fps), 1)
    done = [frame for start in range(0, len(frames), step) for frame in online.push(frames[start : start + step])]
    done += online.flush()
    return join_frames(done, people) if done else poses


def split_frames(poses: Poses3D, people: np.ndarray, number: int = 0) -> list[FinishedFrame]:
    """Return poses (F, P, J) of people (P,) frame by frame, numbered from `number`, each with the people present."""
    frames = []
    for i, present in enumerate((poses.source != Source.ABSENT).any(-1)):
        joints = {name: getattr(poses, name)[i : i + 1, present] for name in _JOINTS}
        frames.append(FinishedFrame(number + i, people[present], Poses3D(poses.skeleton, **joints)))
    return frames


def join_frames(frames: Sequence[FinishedFrame], people: np.ndarray) -> Poses3D:
    """Return poses (F, P, J) of one frame or more, with a row for each of the people (P,), ascending."""
    skeleton = frames[0].poses.skeleton
    whole = Poses3D(skeleton, np.full((len(frames), len(people), len(skeleton), 3), np.nan))
    for i, frame in enumerate(frames):
        row = np.searchsorted(people, frame.people)
        for name in _JOINTS:
            getattr(whole, name)[i, row] = getattr(frame.poses, name)[0]
    return whole
