"""Completion online: frames come in one by one and are completed with a stated delay."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dmae.completion.config import DELAY
from dmae.completion.methods import completion_method
from dmae.data.clip import Poses3D, Source
from dmae.numerics.filling import LONGEST_ABSENCE, smooth

if TYPE_CHECKING:
    from dmae.completion.complete import Completer
    from dmae.data.conversion import Fill


BATCH = 0.2
"""s of frames that are completed together."""
TURN = 0.32
"""s of frames that are completed together while cameras run, in a thread that has as long again for it."""
MEMORY = 5.0
"""s of frames that are kept before those that wait."""


@dataclass(frozen=True)
class FinishedFrame:
    """One frame that will not change any more."""

    number: int  # Number of the frame, from 0 on
    people: np.ndarray  # (P,) numbers of the people who are present; a number is the same person in all frames
    poses: Poses3D  # (1, P, J, ...) with joints, sources, covariances and views


def split_frames(poses: Poses3D, people: np.ndarray, number: int = 0) -> list[FinishedFrame]:
    """Return poses (F, P, J) of people (P,) frame by frame, numbered from `number`, each with the people present."""
    frames = []
    for i, present in enumerate((poses.source != Source.ABSENT).any(-1)):
        frames.append(FinishedFrame(number + i, people[present], poses.select(slice(i, i + 1), present)))
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
    for name, array in whole.arrays.items():
        joints[name] = array.copy()
        joints[name][place] = np.concatenate([getattr(frame.poses, name)[0] for frame in frames])[wanted]
    return Poses3D(skeleton, **joints)


class OnlineCompleter:
    """`dmae.completion.complete.Completer` for frames as they come in.

    A frame is returned when `delay` frames after it are known. It is completed as in a recording that ends there and
    began five seconds before the frames that wait. The whole recording up to there would give another result for
    joints hidden for those five seconds, for limbs that the Gaussian process predicts from earlier frames, and where
    windows are no whole number of frames apart. A person without measurements in a frame is returned only if
    measured again within the delay.

    With `turn` that many frames are completed together, by a thread in the background, while as many others come in.
    What comes out depends on the pushes alone, not on how fast the thread is: a push waits for it where frames are due.

    Attributes:
        delay: Largest number of frames after one that are known when it is returned.
    """

    def __init__(self, completer: Completer, fps: float, delay: float = DELAY, turn: int = 0):
        """
        Args:
            fps: Frames per second at which they come in.
            delay: s.
            turn: Frames that are completed together in the background; 0 completes frames with the push that brings
                the last frame that they wait for.

        Raises:
            ValueError: fps is not positive, the delay is negative, or the completer has the paper's network.
        """
        if not (np.isfinite(fps) and fps > 0 and np.isfinite(delay) and delay >= 0):
            raise ValueError(f"fps must be positive and delay not negative, found {fps} and {delay}")
        if not completer.model.config.residual:
            raise ValueError("the paper's network completes recordings alone; leave out online and its weights")
        self._known_after, self._turn = round(delay * fps), turn
        self.delay = self._known_after + max(2 * turn - 1, 0)
        # Completion does not smooth: smoothing is applied later, to frames that are already completed.
        self._completer, self._smooth, self._fps = replace(completer, smooth=0.0), completer.smooth, fps
        self._reach = ceil(3 * completer.smooth * fps)
        self._step = max(round(completer.stride * fps), 1)
        self._memory = ceil(MEMORY * fps / self._step) * self._step
        self._frames: list[FinishedFrame] = []
        self._waiting = 0
        self._completed: list[FinishedFrame] = []
        self._ended = 0  # number of the first frame that is not completed, nor being completed
        self._thread = ThreadPoolExecutor(1) if turn else None
        self._job: tuple[int, Future[list[FinishedFrame]]] | None = None

    def push(self, frames: Sequence[FinishedFrame]) -> list[FinishedFrame]:
        """Take the next frames; return those that are complete now, in order."""
        self._frames += frames
        self._waiting += len(frames)
        if not self._frames:
            return []
        known = self._frames[-1].number + 1
        if known - self._known_after - self._ended >= max(self._turn, 1):
            self._collect()
            self._complete(known - self._known_after)
        due = known - self.delay
        if self._job is not None and due > self._job[0]:
            self._collect()
        return self._take(due - self._first)

    def flush(self) -> list[FinishedFrame]:
        """Return the frames that still wait, at the end of the recording."""
        self._collect()
        if self._waiting:
            self._complete(self._first + self._waiting)
            self._collect()
        return self._take(self._waiting)

    @property
    def _first(self) -> int:
        return self._frames[-1].number + 1 - self._waiting

    def _complete(self, end: int) -> None:
        """Complete frames up to `end`, and those after it that take part in smoothing."""
        start, self._ended, frames = self._ended, end, [*self._frames]
        # People who may be present in frames that wait.
        recent = frames[-(self._waiting + ceil(LONGEST_ABSENCE * self._fps) + 1) :]
        people = np.unique(np.concatenate([frame.people for frame in recent]))

        def done() -> list[FinishedFrame]:
            poses, first = join_frames(frames, people), frames[0].number
            asked = slice(start - first, min(end + self._reach - first, len(frames)))
            return split_frames(self._completer(poses, self._fps, asked), people, start)

        if self._thread is None:
            self._keep(start, done())
        else:
            self._job = start, self._thread.submit(done)

    def _collect(self) -> None:
        if self._job is not None:
            (start, job), self._job = self._job, None
            self._keep(start, job.result())

    def _keep(self, start: int, done: list[FinishedFrame]) -> None:
        self._completed = [frame for frame in self._completed if frame.number < start] + done

    def _take(self, count: int) -> list[FinishedFrame]:
        """Return the first `count` frames that wait, smoothed; forget those that are not needed any more."""
        if count <= 0:
            return []
        first, reach = self._first, self._reach
        around = [frame for frame in self._completed if first - reach <= frame.number < first + count + reach]
        people = np.unique(np.concatenate([frame.people for frame in around]))
        now = slice(first - around[0].number, first - around[0].number + count)
        poses = smooth(join_frames(around, people), self._fps, self._smooth, now)
        self._waiting -= count
        self._completed = [frame for frame in self._completed if frame.number >= first + count - reach]
        spare = max(len(self._frames) - self._waiting - self._memory, 0)
        del self._frames[: spare - spare % self._step]
        return split_frames(poses, people, first)


@completion_method("dmae_online", learned=True, smooths=True)
def dmae_online(weights: Path | None) -> Fill:
    """As dmae_denoise, smoothed; each frame is completed from the frames until 0.28 s after it."""
    from dmae.completion.complete import completers

    completer_for = completers(weights)
    return lambda poses, fps: complete_online(completer_for(poses.skeleton), poses, fps)


def complete_online(completer: Completer, poses: Poses3D, fps: float, delay: float = DELAY) -> Poses3D:
    """Return poses as they would have been completed while they were captured, 0.2 s of frames at a time."""
    online = OnlineCompleter(completer, fps, delay)
    people = np.arange(poses.xyz.shape[1])
    frames, step = split_frames(poses, people), max(round(BATCH * fps), 1)
    done = [frame for start in range(0, len(frames), step) for frame in online.push(frames[start : start + step])]
    done += online.flush()
    return join_frames(done, people) if done else poses
