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
from dmae.numerics.filling import LONGEST_ABSENCE

if TYPE_CHECKING:
    from dmae.completion.completer import Completer
    from dmae.completion.methods.registry import Fill

BATCH = 0.2
"""s of frames that are completed together."""
DELAY = 0.28
"""s; half a window of the default model."""
TURN = 0.2
"""s in which each person is completed once while cameras run, one after the other, so that frames take alike."""
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

    With `turns` people are completed in turn, some with each push, so that all pushes take about as long. Frames then
    wait until the turn of each person has come.

    Attributes:
        delay: Largest number of frames after one that are known when it is returned.
    """

    def __init__(self, completer: Completer, fps: float, delay: float = DELAY, turns: int = 1):
        """
        Args:
            fps: Frames per second at which they come in.
            delay: s.
            turns: Pushes in which each person is completed once; 1 completes all people with each push.

        Raises:
            ValueError: fps is not positive or the delay negative.
        """
        if not (np.isfinite(fps) and fps > 0 and np.isfinite(delay) and delay >= 0):
            raise ValueError(f"fps must be positive and delay not negative, found {fps} and {delay}")
        self._known_after, self._turns = round(delay * fps), turns
        self.delay = self._known_after + turns - 1
        self._completer, self._fps = completer, fps
        self._step = max(round(completer.stride * fps), 1)
        self._memory = ceil(MEMORY * fps / self._step) * self._step
        self._frames: list[FinishedFrame] = []
        self._waiting = 0
        self._completed: dict[int, tuple[int, Poses3D]] = {}

    @property
    def first_kept(self) -> int:
        """Number of the first frame that is kept."""
        return self._frames[0].number if self._frames else 0

    def push(self, frames: Sequence[FinishedFrame]) -> list[FinishedFrame]:
        """Take the next frames; return those that are complete now, in order."""
        self._frames += frames
        self._waiting += len(frames)
        if not self._frames:
            return []
        first, end = self._first, self._frames[-1].number + 1 - self._known_after
        people = self._recent_people()
        done = [self._end_of(person) for person in people.tolist()]
        share = np.argsort(done, kind="stable")[: ceil(len(people) / self._turns)]
        last = end - self._turns + 1
        now = [i for i in range(len(people)) if done[i] < (end if i in share else last)]
        self._complete(people[now], end)
        return self._take(last - first)

    def flush(self) -> list[FinishedFrame]:
        """Return the frames that still wait, at the end of the recording."""
        if self._waiting:
            self._complete(self._recent_people(), self._first + self._waiting)
        return self._take(self._waiting)

    @property
    def _first(self) -> int:
        """Number of the first frame that waits."""
        return self._frames[-1].number + 1 - self._waiting

    def _end_of(self, person: int) -> int:
        """Return the number of the first frame in which a person is not completed yet."""
        if person not in self._completed:
            return 0
        first, poses = self._completed[person]
        return first + len(poses.xyz)

    def _recent_people(self) -> np.ndarray:
        """Return the people who may be present in frames that wait."""
        recent = self._waiting + ceil(LONGEST_ABSENCE * self._fps) + 1
        return np.unique(np.concatenate([frame.people for frame in self._frames[-recent:]]))

    def _complete(self, people: np.ndarray, end: int) -> None:
        """Complete people in the frames that wait, up to frame `end`."""
        start = self._first
        if len(people) and end > start:
            kept = self._frames[0].number
            poses = self._completer(join_frames(self._frames, people), self._fps, slice(start - kept, end - kept))
            for i, person in enumerate(people.tolist()):
                joints = {name: getattr(poses, name)[:, i : i + 1] for name in _JOINTS}
                self._completed[person] = start, Poses3D(poses.skeleton, **joints)

    def _take(self, count: int) -> list[FinishedFrame]:
        """Return the first `count` frames that wait; forget those that are not needed any more."""
        if count <= 0:
            return []
        first = self._first
        found = {}
        for person, (start, poses) in sorted(self._completed.items()):
            if start + len(poses.xyz) > first:
                found[person] = poses.select(slice(first - start, first - start + count))
        people = np.array(list(found), int)
        skeleton = self._completer.target or self._frames[-1].poses.skeleton
        poses = Poses3D(skeleton, np.empty((count, 0, len(skeleton), 3)))
        if found:
            poses = Poses3D(
                next(iter(found.values())).skeleton,
                **{name: np.concatenate([getattr(part, name) for part in found.values()], 1) for name in _JOINTS},
            )
        self._waiting -= count
        first += count
        self._completed = {p: piece for p, piece in self._completed.items() if piece[0] + len(piece[1].xyz) > first}
        spare = max(len(self._frames) - self._waiting - self._memory, 0)
        del self._frames[: spare - spare % self._step]
        return split_frames(poses, people, first - count)


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
    number = np.repeat(np.arange(len(frames)), [len(frame.people) for frame in frames])
    person = np.concatenate([frame.people for frame in frames])
    wanted = np.isin(person, people)
    place = number[wanted], np.searchsorted(people, person[wanted])
    joints = {}
    whole = Poses3D(skeleton, np.full((len(frames), len(people), len(skeleton), 3), np.nan))
    for name in _JOINTS:
        joints[name] = getattr(whole, name).copy()
        joints[name][place] = np.concatenate([getattr(frame.poses, name)[0] for frame in frames])[wanted]
    return Poses3D(skeleton, **joints)
