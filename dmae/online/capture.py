"""Capture of frames as they come, with a bounded delay."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from dmae.completion.config import DELAY
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.conversion import resized_poses, resized_rig
from dmae.data.skeleton import Skeleton
from dmae.data.typed import check_arguments
from dmae.files.checks import check_rate
from dmae.online.completion import TURN, FinishedFrame, OnlineCompleter, split_frames
from dmae.reconstruction.body_size import resized_config
from dmae.reconstruction.chance import passing_ghosts, resting_ghosts
from dmae.reconstruction.config import ADAPTIVE, CaptureConfig, SubjectConfig
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.noise import DetectionNoise
from dmae.reconstruction.people import coincidental, inside_volume, merge, same_person, too_brief, well_measured
from dmae.reconstruction.pipeline import check_origin, measure
from dmae.reconstruction.pruning import LONGEST_JUMP
from dmae.reconstruction.reassignment import LONGEST_GAP
from dmae.reconstruction.tracking import TrackedFrame, Tracker, Tracks

if TYPE_CHECKING:
    from dmae.completion.complete import Completer

BATCH = 0.08
"""s of frames that are finished together. Their joints are measured with one frame, their rays with the next."""
_MIN_MEMORY = 2.0  # s of frames that are remembered at least: bone lengths are measured over them


class OnlineCapture:
    """`dmae.reconstruction.pipeline.capture` for frames as they come.

    The steps are the same; each looks ahead by no more than the delay. The result differs from the offline one where
    that needs to know more: a re-entry is recognised by the bone lengths of its first frames; a duplicate that was
    taken for a person before it came near is not withdrawn; paths are interpolated and joints pruned by what is known
    within the delay; bone lengths are measured, and ghosts that rest are recognised, over the last seconds; clothes are
    not compared, as there are no images.

    With `complete`, frames are completed as well (`dmae.online.completion.OnlineCompleter`), which adds to the delay.

    Attributes:
        delay: Largest number of frames pushed after a frame until it is finished.
    """

    @check_arguments
    def __init__(
        self,
        rig: CameraRig,
        skeleton: Skeleton,
        fps: float,
        config: CaptureConfig | None = None,
        complete: Completer | None = None,
        look_ahead: float | None = None,
        noise: DetectionNoise | None = None,
    ):
        """
        Args:
            rig: V cameras.
            skeleton: Skeleton of the detections.
            fps: Frames per second.
            config: As for `capture`; by default `CaptureConfig()`.
            complete: Completes captured poses, see `dmae.completion.complete.completers`; None for none.
            look_ahead: s; most that any step waits for what comes after a frame: less than the 0.4 of capture and the
                0.28 of completion costs accuracy, and people appear later. By default as much as steps use.
            noise: How far detections scatter, as `dmae.reconstruction.pipeline.learn_noise` finds it in a recording by
                the same cameras and detector. By default as `config.noise` says: nothing is learned online.

        Raises:
            ValueError: fewer than two cameras, cameras far from the origin (`check_origin`), a skeleton without a size,
                an impossible rate, a negative time, another method of capture, or people are asked for that only a
                whole recording tells.
        """
        fps, config = check_rate("fps", fps), config or CaptureConfig()
        if look_ahead is not None and not 0 <= look_ahead < np.inf:
            raise ValueError(f"look_ahead={look_ahead:g}: expected seconds, 0 or more")
        if len(rig) < 2:
            raise ValueError(f"capture needs at least 2 cameras, found {len(rig)}")
        check_origin(rig, "calibration")
        if config.method != ADAPTIVE:
            raise ValueError(f"capture.method={config.method} captures whole recordings, not frames as they come")
        if config.persons is not None or config.subject != SubjectConfig():
            raise ValueError(
                "capture.persons and capture.subject are decided over a whole recording, which is not known while "
                "cameras run; give capture.volume, or leave them out"
            )
        if skeleton.size_m is None:
            raise ValueError(
                f"skeleton {skeleton.name!r} states no size, which is not known before the recording; give size_m"
            )
        if skeleton.scale != 1:
            rig, config = resized_rig(rig, 1 / skeleton.scale), resized_config(config, 1 / skeleton.scale)
        self._rig, self._skeleton, self._fps, self._config = rig, skeleton, fps, config
        self._tracker = Tracker(skeleton, fps, config)
        self._noise = noise or DetectionNoise.prior(config.noise, len(rig), len(skeleton))
        self._batch = max(round(BATCH * fps), 1)
        self._jump = ceil(LONGEST_JUMP * fps) if config.prune else 0
        gap = LONGEST_GAP if config.reassignment.distance_m > 0 else 0
        ahead = max(ceil(max(gap, config.tracking.min_duration_s) * fps), self._jump)
        if look_ahead is not None:
            ahead = min(ahead, int(look_ahead * fps))
        self._ahead = ahead + self._batch - 1
        self._measuring: tuple[Callable[[int], Poses3D], np.ndarray, int] | None = None
        self._completing = None
        if complete:
            delay = DELAY if look_ahead is None else min(look_ahead, DELAY)
            self._completing = OnlineCompleter(complete, fps, delay, max(round(TURN * fps), 1))
        # If frames are processed in batches, rays are found one frame later.
        self.delay = self._ahead + min(self._batch - 1, 1) + (self._completing.delay if self._completing else 0)
        self._memory = ceil(max(_MIN_MEMORY, 2 * config.tracking.reentry_s) * fps)
        self._tracked: list[TrackedFrame] = []
        self._measured: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        self._detected: list[Detections2D] = []
        self._number = self._seen = self._waiting = 0
        self._person_of: dict[int, int] = {}
        self._frames_of: dict[int, np.ndarray] = {}

    def push(self, detections: Detections2D) -> list[FinishedFrame]:
        """Take the next frame, of shape (1, V, D, J, ...) with any D; return the frames that it finishes, in order.

        Raises:
            ValueError: not one frame, or not of the announced cameras and joints.
        """
        if len(detections.xy) != 1 or detections.skeleton != self._skeleton:
            raise ValueError(
                f"expected one frame of {self._skeleton.name}, found {len(detections.xy)} of {detections.skeleton.name}"
            )
        self._tracked.append(self._tracker.step(self._evidence([detections], self._config.th_p)))
        self._detected.append(detections)
        self._waiting += 1
        self._seen += 1
        captured = self._finish()
        if self._waiting > self._ahead:
            self._measure(self._batch)
            if self._batch == 1:
                captured = self._finish()
        return self._completing.push(captured) if self._completing else captured

    def flush(self) -> list[FinishedFrame]:
        """Return the frames that still wait, at the end of the recording."""
        captured = self._finish()
        if self._waiting:
            self._measure(self._waiting)
            captured += self._finish()
        return self._completing.push(captured) + self._completing.flush() if self._completing else captured

    def _clip(self, frames: list[Detections2D]) -> Clip:
        """Return frames with different numbers of detections together."""
        # Tracks also continue in frames in which no camera detects anyone.
        most = max(1, *(frame.xy.shape[2] for frame in frames))
        xy = np.full((len(frames), len(self._rig), most, len(self._skeleton), 2), np.nan)
        score = np.full(xy.shape[:-1], np.nan)
        for i, frame in enumerate(frames):
            if frame.xy.shape[1] != len(self._rig):
                raise ValueError(f"{len(self._rig)} cameras but detections in {frame.xy.shape[1]} views")
            xy[i, :, : frame.xy.shape[2]], score[i, :, : frame.xy.shape[2]] = frame.xy[0], frame.score[0]
        return Clip("", self._fps, self._rig, Detections2D(self._skeleton, xy, score))

    def _evidence(self, frames: list[Detections2D], th_p: float) -> Evidence:
        return Evidence.of(self._clip(frames), th_p, self._config, noise=self._noise)

    def _measure(self, count: int) -> None:
        """Measure the joints of the first `count` waiting frames, as `capture` would with all that are remembered."""
        past = len(self._tracked) - self._waiting
        persons, tracks = self._persons(slice(past, past + count))
        ahead = min(count + self._jump, self._waiting)
        reassignment = self._config.reassignment
        th_p = reassignment.th_p if reassignment.distance_m > 0 else self._config.th_p
        evidence = self._evidence(self._detected[past : past + ahead], th_p)
        before, votes = np.full((past, *tracks.xyz.shape[1:]), np.nan), np.zeros((past, len(persons)))
        if past:
            known, xyz, seen = (np.concatenate(part) for part in zip(*self._measured, strict=True))
            number = np.repeat(np.arange(past), [len(people) for people, *_ in self._measured])
            both = np.isin(known, persons)
            place = number[both], np.searchsorted(persons, known[both])
            before[place], votes[place] = xyz[both], seen[both]
        window = slice(past, past + ahead)
        joints, seen, poses = measure(evidence, tracks, window, before, votes, self._skeleton, self._fps)
        self._measuring = poses, persons, count
        self._measured += [(persons, *each) for each in zip(joints[:count], seen[:count], strict=True)]
        self._waiting -= count
        kept = self._memory + self._waiting
        self._tracked, self._detected = self._tracked[-kept:], self._detected[-kept:]
        self._measured = self._measured[len(self._measured) - (len(self._tracked) - self._waiting) :]

    def _finish(self) -> list[FinishedFrame]:
        if self._measuring is None:
            return []
        poses_of, persons, count = self._measuring
        self._measuring = None
        poses, scale = poses_of(count), self._skeleton.scale
        finished = split_frames(poses if scale == 1 else resized_poses(poses, scale), persons, self._number)
        self._number += count
        return finished

    def _persons(self, window: slice) -> tuple[np.ndarray, Tracks]:
        """Return the numbers (P,), ascending, and tracks of people; settle who is in the window, so that numbers never
        change."""
        config, fps = self._config, self._fps
        index = np.unique(np.concatenate([frame.track for frame in self._tracked]))
        tracks = Tracks.of(self._tracked, index, len(self._rig), len(self._skeleton))
        person = np.array([self._person_of.get(track, track) for track in index.tolist()], int)
        label = np.array([np.flatnonzero(person == p)[0] for p in person], int)
        tracks = merge(tracks, label)
        first = np.unique(label)
        settled = np.array([track in self._person_of for track in index.tolist()], bool)[first]
        number = person[first]
        tracks = inside_volume(tracks, config.volume)
        here = ~np.isnan(tracks.xyz[window]).all((0, 2, 3))
        same = first if settled.all() else same_person(tracks.xyz, self._skeleton, fps, config.tracking.reentry_s)
        for i in np.flatnonzero(~settled):
            group = np.flatnonzero(same == same[i])
            candidates = group[settled[group]] if settled[group].any() else group
            number[i] = person[first[candidates[0]]]
        for track, i in zip(index.tolist(), np.searchsorted(first, label).tolist(), strict=True):
            if here[i]:
                self._person_of[track] = int(number[i])

        order = np.argsort(number, kind="stable")
        number = number[order]
        tracks = merge(tracks.select(order), np.searchsorted(number, number))
        number = np.unique(number)
        measured = well_measured(tracks, config.tracking.births(len(self._skeleton)))[:, window.start :]
        earlier = np.array([self._frames_of.get(p, (0, 0)) for p in number.tolist()], float).reshape(-1, 2).T
        count, surprises = earlier + measured.sum(1)
        ghosts = passing_ghosts(count, surprises, self._seen, config.tracking.max_by_chance)
        brief = too_brief(count, self._seen, fps, config.tracking.min_duration_s)
        detected = self._clip(self._detected)
        kept = ~(brief | ghosts | coincidental(detected, tracks, config, self._noise))
        settled = earlier + measured[:, : window.stop - window.start].sum(1)
        self._frames_of |= dict(zip(number.tolist(), settled.T, strict=True))
        number, tracks = number[kept], tracks.select(kept)
        resting = resting_ghosts(detected, tracks.assigned, tracks.xyz, config, self._noise)
        return number[~resting], tracks.select(~resting)
