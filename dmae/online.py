"""Capture while it happens: frame by frame, with a bounded delay."""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING

import numpy as np

from dmae.baselines import fill_pchip_body
from dmae.cameras import CameraRig
from dmae.capture import CaptureConfig, choose_again, paths, prune, sightings
from dmae.clip import Clip, Detections2D, Poses3D, Source
from dmae.identify import Tracked, Tracker, stack
from dmae.prune import LONGEST_JUMP, by_chance, merge, same_person
from dmae.seen import Seen
from dmae.skeleton import Skeleton
from dmae.stream import BATCH, FinishedFrame, OnlineCompleter

if TYPE_CHECKING:
    from dmae.complete import Completer

_MEMORY = 2.0
"""s that are remembered, at least: bones are measured over them."""


class OnlineCapture:
    """`dmae.capture.capture` for one frame after the other.

    The steps are the same, and so is the code; each looks ahead by no more than the delay. What that
    leaves out: who comes back is recognised by the build of the first moments, and a double that was
    taken for somebody before it came near is not taken back; paths are bridged and joints pruned by
    what is known within the delay, and bones are measured over the last seconds.
    Looks are not compared: there are no images.

    With `complete`, frames are completed as well (`dmae.stream.OnlineCompleter`), which adds to the delay.

    Attributes:
        delay: Frames pushed after one until it is finished, at most.
    """

    def __init__(
        self,
        rig: CameraRig,
        skeleton: Skeleton,
        fps: float,
        config: CaptureConfig,
        complete: Completer | None = None,
    ):
        """
        Args:
            rig: V cameras.
            skeleton: Of the detections.
            fps: Frames per second at which they come.
            config: As for `capture`.
            complete: What completes them, see `dmae.complete.completers`.

        Raises:
            ValueError: fewer than two cameras.
        """
        if len(rig) < 2:
            raise ValueError(f"capture needs at least 2 cameras, found {len(rig)}")
        self._rig, self._skeleton, self._fps, self._config = rig, skeleton, fps, config
        self._tracker = Tracker(skeleton, fps, config)
        self._batch = max(round(BATCH * fps), 1)
        self._jump = ceil(LONGEST_JUMP * fps) if config.prune else 0
        bridged = config.bridge if config.reach > 0 else 0
        self._looks_ahead = max(ceil(max(bridged, config.least_life) * fps), self._jump) + self._batch - 1
        self._completing = OnlineCompleter(complete, fps) if complete else None
        self.delay = self._looks_ahead + (self._completing.delay if self._completing else 0)
        self._memory = ceil(max(_MEMORY, 2 * config.rejoin) * fps)
        self._tracked: list[Tracked] = []
        self._finished: list[tuple[np.ndarray, np.ndarray]] = []
        self._waiting: list[Detections2D] = []
        self._number = 0
        self._person: dict[int, int] = {}
        self._life: dict[int, int] = {}

    def push(self, detections: Detections2D) -> list[FinishedFrame]:
        """Take the next frame, of shape (1, V, D, J, ...) with any D; return those finished by it, in order.

        Raises:
            ValueError: not one frame, or not of the cameras and joints announced.
        """
        if len(detections.xy) != 1 or detections.skeleton != self._skeleton:
            raise ValueError(
                f"expected one frame of {self._skeleton.name}, found {len(detections.xy)} of {detections.skeleton.name}"
            )
        seen = self._seen([detections], self._config.th_p)
        self._tracked.append(self._tracker.step(seen, 0))
        self._waiting.append(detections)
        captured = self._finish(self._batch) if len(self._waiting) > self._looks_ahead else []
        return self._completing.push(captured) if self._completing else captured

    def flush(self) -> list[FinishedFrame]:
        """The frames that are still waiting: there will be no more."""
        captured = self._finish(len(self._waiting)) if self._waiting else []
        return self._completing.push(captured) + self._completing.flush() if self._completing else captured

    def _seen(self, frames: list[Detections2D], least: float) -> Seen:
        most = max(frame.xy.shape[2] for frame in frames)
        xy = np.full((len(frames), len(self._rig), most, len(self._skeleton), 2), np.nan)
        for i, frame in enumerate(frames):
            if frame.xy.shape[1] != len(self._rig):
                raise ValueError(f"{len(self._rig)} cameras but detections in {frame.xy.shape[1]} views")
            xy[i, :, : frame.xy.shape[2]] = frame.xy[0]
        score = np.full(xy.shape[:-1], np.nan)
        for i, frame in enumerate(frames):
            score[i, :, : frame.xy.shape[2]] = frame.score[0]
        return Seen.of(Clip("", self._fps, self._rig, Detections2D(self._skeleton, xy, score)), least, self._config)

    def _finish(self, count: int) -> list[FinishedFrame]:
        """Finish the first so many of the frames that wait, as `capture` would with all that is remembered."""
        config, skeleton, fps = self._config, self._skeleton, self._fps
        past = len(self._tracked) - len(self._waiting)
        people, chosen, xyz = self._people(slice(past, past + count))
        ahead = min(count + self._jump, len(self._waiting))
        now = slice(past, past + ahead)
        seen = self._seen(self._waiting[:ahead], config.th_p if config.reach == 0 else config.th_p_again)
        first = chosen = chosen[now]
        if config.reach > 0:
            chosen = choose_again(seen, first, paths(xyz, skeleton, fps, config)[now], config.reach)
        points = seen.triangulate(np.arange(ahead)[:, None, None, None], chosen)
        before = np.full((past, *xyz.shape[1:]), np.nan)
        for frame, (who, joints) in zip(before, self._finished, strict=True):
            both = np.isin(who, people)
            frame[np.searchsorted(people, who[both])] = joints[both]
        final = np.concatenate([before, points.xyz])
        final = prune(final, skeleton, fps) if config.prune else final
        everything = Poses3D(skeleton, np.concatenate([final, xyz[now.stop :]]))
        final = final[past:]
        absent = np.isnan(final[..., 0])
        rays = sightings(seen, absent, fill_pchip_body(everything, fps).xyz[now], chosen, first)

        finished = []
        for i in range(count):
            here = np.flatnonzero(~absent[i].all(-1))
            now, lacking = np.s_[i : i + 1, here], absent[i : i + 1, here]
            poses = Poses3D(
                skeleton,
                final[now],
                np.where(lacking, Source.ABSENT, Source.MEASURED),
                np.where(lacking[..., None, None], np.nan, points.cov[now]),
                np.where(lacking, 0, points.views[now]),
                rays[now],
            )
            finished.append(FinishedFrame(self._number + i, people[here], poses))
            self._finished.append((people, points.xyz[i]))
        self._number += count
        del self._waiting[:count]
        self._tracked = self._tracked[-self._memory - len(self._waiting) :]
        self._finished = self._finished[len(self._finished) - (len(self._tracked) - len(self._waiting)) :]
        return finished

    def _people(self, now: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Who (P,), ascending, is no ghost, with detections and joints; settles who is in the frames `now`."""
        tracks = np.unique(np.concatenate([index for index, *_ in self._tracked]))
        chosen, xyz = stack(self._tracked, tracks, len(self._rig), len(self._skeleton))
        person = np.array([self._person.get(track, track) for track in tracks.tolist()], int)
        label = np.array([np.flatnonzero(person == p)[0] for p in person], int)
        chosen, xyz = merge(chosen, xyz, label)
        first = np.unique(label)
        settled = np.array([track in self._person for track in tracks.tolist()], bool)[first]
        who = person[first]
        joined = same_person(xyz, self._skeleton, self._fps, self._config.rejoin)
        for i in np.flatnonzero(~settled):
            group = np.flatnonzero(joined == joined[i])
            joined_to = group[settled[group]] if settled[group].any() else group
            who[i] = person[first[joined_to[0]]]
        for track, i in zip(tracks.tolist(), np.searchsorted(first, label).tolist(), strict=True):
            if not np.isnan(xyz[now, i]).all():
                self._person[track] = int(who[i])

        order = np.argsort(who, kind="stable")
        who, chosen, xyz = who[order], chosen[:, order], xyz[:, order]
        chosen, xyz = merge(chosen, xyz, np.searchsorted(who, who))
        who = np.unique(who)
        whole = (~np.isnan(xyz[now.start :, :, :, 0])).sum(-1) >= self._config.birth_joints
        least = min(self._config.least_life * self._fps, (self._number + len(self._waiting)) / 2)
        lived = np.array([self._life.get(p, 0) for p in who.tolist()], int)
        alive = (lived + whole.sum(0) >= least) & ~by_chance(xyz, chosen, self._config.th_v)
        for p, more in zip(who.tolist(), whole[: now.stop - now.start].sum(0).tolist(), strict=True):
            self._life[p] = self._life.get(p, 0) + more
        return who[alive], chosen[:, alive], xyz[:, alive]
