"""Completion online: frames come in one by one and are completed with a stated delay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
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
    from dmae.completion.gaussian_process import Steps
    from dmae.data.conversion import Fill


BATCH = 0.2
"""s of frames that are completed together."""
TURN = 0.48
"""s in which each person is completed once while cameras run, in steps, so that frames take about the same time."""
_GROUPS = 2
"""Groups in which people are completed, one after the other."""
_JOB_COST = 5.0
"""Of preparing a job and of keeping its results, see `dmae.completion.gaussian_process.Steps`."""
_USUAL_COST = 60.0
"""Of completing a person in a turn, before it is known."""
_CHANGE = 0.1
"""Share of the last job in what is taken as usual, where it cost less than that."""
MEMORY = 5.0
"""s of frames that are kept before those that wait."""
JOINTS = [field.name for field in fields(Poses3D) if field.name != "skeleton"]
"""What poses hold of each joint."""


@dataclass(frozen=True)
class FinishedFrame:
    """One frame that will not change any more.

    Attributes:
        number: Number of the frame, from 0 on.
        people: (P,) numbers of the people who are present; a number is the same person in all frames.
        poses: (1, P, J, ...) with joints, sources, covariances and views.
    """

    number: int
    people: np.ndarray
    poses: Poses3D


def split_frames(poses: Poses3D, people: np.ndarray, number: int = 0) -> list[FinishedFrame]:
    """Return poses (F, P, J) of people (P,) frame by frame, numbered from `number`, each with the people present."""
    frames = []
    for i, present in enumerate((poses.source != Source.ABSENT).any(-1)):
        joints = {name: getattr(poses, name)[i : i + 1, present] for name in JOINTS}
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
    for name in JOINTS:
        joints[name] = getattr(whole, name).copy()
        joints[name][place] = np.concatenate([getattr(frame.poses, name)[0] for frame in frames])[wanted]
    return Poses3D(skeleton, **joints)


@dataclass(frozen=True)
class _Completed:
    """Completed frames of one person, not smoothed.

    Attributes:
        first: Number of the first one.
        end: Number of the first frame that is completed again later; those from it on are for smoothing alone.
        joints: (n, J, ...) by name, as in `Poses3D`.
    """

    first: int
    end: int
    joints: dict[str, np.ndarray]

    def since(self, first: int) -> _Completed:
        """Return the frames from a number on."""
        spare = max(first - self.first, 0)
        return _Completed(self.first + spare, self.end, {name: part[spare:] for name, part in self.joints.items()})


@dataclass
class _Job:
    """The completion of some people from frame `start` to `end`; `over` after the last step.

    `cost` is that of the steps so far, done in this number of `pushes`.
    """

    people: list[int]
    start: int
    end: int
    steps: Steps[Poses3D]
    over: bool = False
    cost: float = _JOB_COST
    pushes: int = 0


class OnlineCompleter:
    """`dmae.completion.complete.Completer` for frames as they come in.

    A frame is returned when `delay` frames after it are known. It is completed as in a recording that ends there and
    began five seconds before the frames that wait. The whole recording up to there would give another result for
    joints hidden for those five seconds, for limbs that the Gaussian process predicts from earlier frames, and where
    windows are no whole number of frames apart. A person without measurements in a frame is returned only if
    measured again within the delay.

    With `turns` people are completed in two groups, one after the other and step by step, so that all pushes take about
    as long. Frames then wait until the turn of each group has come, and is over.

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
        self._pushes = ceil(turns / _GROUPS)
        self.delay = self._known_after + (turns + self._pushes - 2 if turns > 1 else 0)
        # Completion does not smooth: smoothing is applied later, to frames that are already completed.
        self._completer, self._smooth, self._fps = replace(completer, smooth=0.0), completer.smooth, fps
        self._reach = ceil(3 * completer.smooth * fps)
        self._step = max(round(completer.stride * fps), 1)
        self._memory = ceil(MEMORY * fps / self._step) * self._step
        self._frames: list[FinishedFrame] = []
        self._waiting = 0
        self._completed: dict[int, _Completed] = {}
        self._job: _Job | None = None
        self._usual = _USUAL_COST

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
        people = self._recent_people().tolist()
        if self._turns == 1:
            self._finish(self._started(people, end))
            return self._take(end - first)
        last = self._frames[-1].number + 1 - self.delay
        self._work(people, end)
        # If a person's frames are already due, because there are more people than before, complete them immediately.
        if self._job is not None and min(map(self._end_of, self._job.people)) < last:
            self._finish(self._job)
        self._finish(self._started([person for person in people if self._end_of(person) < last], end))
        return self._take(last - first)

    def _work(self, people: list[int], end: int) -> None:
        """Do a share of the work on the job that is not over, or on the next one."""
        if self._job is None:
            self._job = self._started(self._next_group(people, end), end)
        job = self._job
        if job is None:
            return
        job.pushes += 1
        # Do the work that completes the job within the pushes of a turn, if it costs as much as earlier jobs.
        due = self._usual * len(job.people) * job.pushes / self._pushes
        while not job.over and job.cost < due:
            self._step_on(job)

    def _next_group(self, people: list[int], end: int) -> list[int]:
        """Return the people to be completed next, those with the most frames that wait; none while it is early."""
        done = sorted((self._end_of(person), person) for person in people)
        size = ceil(len(done) / _GROUPS)
        # Begin early enough for the people of later groups, who wait until this group is completed.
        waited = (end - each + self._turns * (k // size) / _GROUPS for k, (each, _) in enumerate(done))
        return sorted(person for _, person in done[:size]) if max(waited, default=0) >= self._turns else []

    def flush(self) -> list[FinishedFrame]:
        """Return the frames that still wait, at the end of the recording."""
        if self._job is not None:
            self._finish(self._job)
        if self._waiting:
            self._finish(self._started(self._recent_people().tolist(), self._first + self._waiting))
        return self._take(self._waiting)

    @property
    def _first(self) -> int:
        """Number of the first frame that waits."""
        return self._frames[-1].number + 1 - self._waiting

    def _end_of(self, person: int) -> int:
        """Return the number of the first frame in which a person is present and not completed yet."""
        if person in self._completed:
            return max(self._completed[person].end, self._first - self._reach)
        waiting = self._frames[len(self._frames) - self._waiting :]
        return next((frame.number for frame in waiting if person in frame.people), self._first)

    def _recent_people(self) -> np.ndarray:
        """Return the people who may be present in frames that wait."""
        recent = self._waiting + ceil(LONGEST_ABSENCE * self._fps) + 1
        return np.unique(np.concatenate([frame.people for frame in self._frames[-recent:]]))

    def _started(self, people: list[int], end: int) -> _Job | None:
        """Begin to complete people up to frame `end`, and those frames after it that take part in smoothing."""
        start = min(map(self._end_of, people), default=end)
        if start >= end:
            return None
        kept, known = self._frames[0].number, self._frames[-1].number + 1
        poses = join_frames(self._frames, np.array(people))
        frames = slice(start - kept, min(end + self._reach, known) - kept)
        return _Job(people, start, end, self._completer.in_steps(poses, self._fps, frames, self._turns > 1))

    def _finish(self, job: _Job | None) -> None:
        while job is not None and not job.over:
            self._step_on(job)

    def _step_on(self, job: _Job) -> None:
        """Do the next step of a job; keep the results of the last one."""
        from dmae.completion.complete import one_thread

        if not job.over:
            try:
                with one_thread():
                    job.cost += next(job.steps)
            except StopIteration as over:
                job.over = True
                self._keep(job, over.value)
                found = job.cost / len(job.people)
                # The expected cost rises immediately. Otherwise the last pushes of expensive jobs would take long.
                self._usual = max(found, self._usual + _CHANGE * (found - self._usual))
        if job is self._job and job.over:
            self._job = None

    def _keep(self, job: _Job, done: Poses3D) -> None:
        for i, person in enumerate(job.people):
            joints = {name: getattr(done, name)[:, i] for name in JOINTS}
            first, before = job.start, self._completed.get(person)
            count = job.start - before.first if before else -1
            if 0 <= count <= len(before.joints["xyz"]):
                first = before.first
                joints = {name: np.concatenate([before.joints[name][:count], joint]) for name, joint in joints.items()}
            self._completed[person] = _Completed(first, job.end, joints)

    def _take(self, count: int) -> list[FinishedFrame]:
        """Return the first `count` frames that wait; forget those that are not needed any more."""
        if count <= 0:
            return []
        first, reach = self._first, self._reach
        around = max(first - reach, 0)
        # Joints of a person are absent in frames that are not completed for that person.
        skeleton = self._completer.target or self._frames[-1].poses.skeleton
        people = np.array(sorted(self._completed), int)
        length = first + count + reach - around
        poses = Poses3D(skeleton, np.full((length, len(people), len(skeleton), 3), np.nan))
        joints = {name: getattr(poses, name).copy() for name in JOINTS}
        for i, person in enumerate(people.tolist()):
            done = self._completed[person].since(around)
            begin = done.first - around
            for name, part in done.joints.items():
                end = max(min(begin + len(part), length), begin)
                joints[name][begin:end, i] = part[: end - begin]
        now = slice(first - around, first - around + count)
        poses = smooth(Poses3D(skeleton, **joints), self._fps, self._smooth, now)
        self._waiting -= count
        first += count
        for person, done in list(self._completed.items()):
            # Frames that smoothing still needs are kept. The number of the first frame that is not completed yet is
            # kept while the person may be measured again.
            if done.end < first - reach - ceil(LONGEST_ABSENCE * self._fps):
                del self._completed[person]
            else:
                self._completed[person] = done.since(first - reach)
        spare = max(len(self._frames) - self._waiting - self._memory, 0)
        del self._frames[: spare - spare % self._step]
        return split_frames(poses, people, first - count)


@completion_method("dmae_online", learned=True, smooths=True)
def dmae_online(weights: Path | None) -> Fill:
    """As dmae_denoise, smoothed; each frame is completed from the frames until 0.28 s after it."""
    from dmae.completion.complete import SMOOTHING, completers

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
