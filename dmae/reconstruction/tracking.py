"""Tracking, frame by frame: identity propagation and identity matching (Algorithm 1 of the paper)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import islice
from tempfile import TemporaryFile
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.data.clip import Clip
from dmae.data.skeleton import PERSON_M, Skeleton
from dmae.files.mapped import by_frames, empty, in_steps
from dmae.numerics.compiled import compiled
from dmae.numerics.statistics import median_known
from dmae.progress import progress
from dmae.reconstruction.appearance import TorsoColours, has_appearance
from dmae.reconstruction.association import (
    NONE,
    Candidates,
    exchange_members,
    find_groups,
    highest_affinity,
    pair_evidence,
    propagate,
)
from dmae.reconstruction.chance import expected_by_chance
from dmae.reconstruction.config import CaptureConfig, ComparedJoints, DistanceUnit, fewer_of_few
from dmae.reconstruction.evidence import Evidence, evidence_blocks
from dmae.reconstruction.noise import DetectionNoise
from dmae.reconstruction.sides import Sides, correct_sides, nearer_side
from dmae.reconstruction.triangulation import Points

_VELOCITY_FADE = 0.5  # s; velocities decay to 1/e in this time unless they are measured again


class TrackedFrame(NamedTuple):
    """The T persons of one frame."""

    track: np.ndarray  # (T,) index of their tracks
    assigned: np.ndarray  # (T, V, J) index of the detection that shows the joint in the view, or `NONE`
    xyz: np.ndarray  # (T, J, 3) m, joints triangulated from these; NaN where absent
    chance: np.ndarray  # (T,) number of people expected by chance whose views agree as well; inf where not measured


@dataclass(frozen=True)
class Tracks:
    """P tracks over F frames."""

    assigned: np.ndarray  # (F, P, V, J) index of the detection that shows the joint in the view, or `NONE`
    xyz: np.ndarray  # (F, P, J, 3) m, joints triangulated from these; NaN where absent
    chance: np.ndarray  # (F, P) number of people expected by chance whose views agree as well; inf where not measured

    @classmethod
    def of(cls, frames: Sequence[TrackedFrame], track: np.ndarray, views: int, joints: int) -> Tracks:
        """Return the tracks with indices `track` (P,), ascending, from tracked frames."""
        assigned = np.full((len(frames), len(track), views, joints), NONE, np.int16)
        xyz = np.full((len(frames), len(track), joints, 3), np.nan)
        chance = np.full((len(frames), len(track)), np.inf, np.float32)
        if frames:
            number = np.repeat(np.arange(len(frames)), [len(frame.track) for frame in frames])
            tracks, *parts = (np.concatenate(part) for part in zip(*frames, strict=True))
            wanted = np.isin(tracks, track)
            place = number[wanted], np.searchsorted(track, tracks[wanted])
            arrays: tuple[np.ndarray, ...] = (assigned, xyz, chance)
            for array, part in zip(arrays, parts, strict=True):
                array[place] = part[wanted]
        return cls(assigned, xyz, chance)

    @classmethod
    def of_blocks(cls, blocks: Iterable[Sequence[TrackedFrame]], frames: int, views: int, joints: int) -> Tracks:
        """Return all tracks of `frames` frames, which come in blocks. Only one block is in memory at a time."""
        births, sizes = 0, []
        with TemporaryFile(prefix="dmae-") as file:
            for block in blocks:
                index = np.unique(np.concatenate([np.empty(0, int), *(frame.track for frame in block)]))
                births = max(births, index.max(initial=-1) + 1)
                if len(block) == frames:
                    return cls.of(block, np.arange(births), views, joints)
                part = cls.of(block, index, views, joints)
                for array in (index, part.assigned, part.xyz, part.chance):
                    np.save(file, array)
                sizes.append(len(block))
            file.seek(0)
            tracks = cls(
                empty((frames, births, views, joints), np.int16),
                empty((frames, births, joints, 3), np.float64),
                empty((frames, births), np.float32),
            )
            arrays, start = (tracks.assigned, tracks.xyz, tracks.chance), 0
            for size in in_steps(sizes):
                index, here = np.load(file), slice(start, start + size)
                for array, absent in zip(arrays, (NONE, np.nan, np.inf), strict=True):
                    array[here] = absent
                    array[here, index] = np.load(file)
                start += size
        return tracks

    def select(self, persons: np.ndarray) -> Tracks:
        """Return some of the tracks, by indices or by a mask (P,)."""
        arrays = (self.assigned, self.xyz, self.chance)
        return Tracks(*(by_frames(lambda array: array[:, persons], array) for array in arrays))


@dataclass
class TrackState:
    """State of the T currently followed tracks."""

    track: np.ndarray  # (T,) index of each track in the result
    xyz: np.ndarray  # (T, J, 3) m, expected joints; NaN where unknown
    velocity: np.ndarray  # (T, 3) m/s of the whole body
    joint_unseen: np.ndarray  # (T, J) s since the joint was measured
    unseen: np.ndarray  # (T,) s since the person was measured
    age: np.ndarray  # (T,) s for which the person has been measured with support
    unsupported: np.ndarray  # (T,) s since the person was measured with support
    mixed: np.ndarray  # (T,) s for which its views showed different people, see `_mixed_views`

    @classmethod
    def birth(cls, first: int, xyz: np.ndarray) -> TrackState:
        """Return new tracks, numbered from `first` on, of people with joints (T, J, 3)."""
        count, joints = xyz.shape[:2]
        zero = np.zeros(count)
        return cls(
            first + np.arange(count), xyz, np.zeros((count, 3)), np.zeros((count, joints)), zero, zero, zero, zero
        )

    def __getitem__(self, index) -> TrackState:
        return TrackState(*(getattr(self, f.name)[index] for f in fields(self)))

    def __add__(self, others: TrackState) -> TrackState:
        return TrackState(*(np.concatenate([getattr(self, f.name), getattr(others, f.name)]) for f in fields(self)))

    def predicted(self, dt: float) -> TrackState:
        """Return the state after `dt` s without a measurement."""
        return replace(
            self,
            xyz=self.xyz + self.velocity[:, None] * dt,
            velocity=self.velocity * np.exp(-dt / _VELOCITY_FADE),
            joint_unseen=self.joint_unseen + dt,
            unseen=self.unseen + dt,
            unsupported=self.unsupported + dt,
        )

    def updated(self, xyz: np.ndarray, supported: np.ndarray, dt: float, velocity_gain: float) -> TrackState:
        """Return the state with measured joints.

        Args:
            xyz: (T, J, 3) m; NaN where a joint or a person was not measured.
            supported: (T,) True where views agree better than unrelated figures would.
            dt: s since the frame before.
            velocity_gain: Share of each step that is added to the velocity.
        """
        measured = ~np.isnan(xyz[..., 0])
        velocity = self.velocity.copy()
        step = median_known(xyz - self.xyz)
        moved = ~np.isnan(step[:, 0])
        velocity[moved] += velocity_gain * step[moved] / dt
        return replace(
            self,
            xyz=np.where(measured[..., None], xyz, self.xyz),
            velocity=velocity,
            joint_unseen=np.where(measured, 0, self.joint_unseen),
            unseen=np.where(measured.any(-1), 0, self.unseen),
            age=self.age + np.where(measured.any(-1) & supported, dt, 0),
            unsupported=np.where(measured.any(-1) & supported, 0, self.unsupported),
        )


_CONFIRMATION_S = 0.2  # s; measured time after which a track is confirmed. Confirmed tracks take detections first.
MIN_JOINTS = 3
"""Fewest joints of a measured person, and of a detection that is compared."""
_LONGEST_BONE = 0.8
"""m; no person has a longer bone. In your own skeletons, bones may have the length of the body."""
_DUPLICATE_NEWCOMER_DISTANCE = 0.2  # m; a new person at a smaller median distance from a tracked one duplicates it
_DISTANCE_FROM_PREDICTED, _WALKING_SPEED = 0.3, 1.5  # m and m/s: largest distance of a re-entry from its prediction
_MIXED_S = 0.2  # s; time after which a track ends whose views show different people
_ITERATIONS = 2  # Number of steps of refinement; points for assignment need not be exact


class Tracker:
    """Assign detections to people frame by frame, without looking ahead.

    Args:
        strangers: (V,) as for `expected_by_chance`, if all frames show the same still; None in a video.
    """

    def __init__(self, skeleton: Skeleton, fps: float, config: CaptureConfig, strangers: np.ndarray | None = None):
        self._config, self._dt, self._strangers = config, 1 / fps, strangers
        self._compared = _compared_joints(skeleton, config.association.joints)
        self._sides, self._mirror = Sides.of(skeleton), list(skeleton.mirror)
        self._bones = np.array(skeleton.bones, int).reshape(-1, 2)
        self._state = TrackState.birth(0, np.empty((0, len(skeleton), 3)))
        self._births = 0
        self._longest = longest_bone(skeleton)
        self._fewest = fewest_joints(len(skeleton))
        self._most = np.inf if config.tracking.max_by_chance is None else config.tracking.max_by_chance
        self._birth_joints = config.tracking.births(len(skeleton))

    def step(self, evidence: Evidence, colours: Callable[[], np.ndarray] | None = None) -> TrackedFrame:
        """Track people into the next frame.

        Args:
            evidence: Of this frame alone.
            colours: Returns the colours (V, D, 3) of its detections; None without images.
        """
        config, state = evidence.config, self._state.predicted(self._dt)
        assigned, primary = _propagate(evidence, state, self._sides, self._mirror, self._dt)
        evidence = correct_sides(evidence, assigned[None], state.xyz[None], self._sides, self._dt)
        points = evidence.triangulate(assigned[None], _ITERATIONS)
        confirmed = state.age > _CONFIRMATION_S
        xyz, plausible = self._plausible(points, assigned, self._fewest, confirmed)
        used, xyz[~plausible] = points.used[0], np.nan
        mixed = self._split(evidence, state, assigned, primary, xyz)
        # What is left over near a person, a fragment or a duplicate, may also show somebody behind or in front.
        view, person = np.nonzero((primary != NONE) & plausible)
        free = np.ones(evidence.xy.shape[1:3], bool)
        free[view, primary[view, person]] = False
        groups, new, used_by_new = self._new_people(evidence, free, colours, mixed)
        used = np.concatenate([used, used_by_new])
        people = np.concatenate([assigned, groups]), np.concatenate([xyz, new]), used
        chance = _by_chance(evidence, *people, self._strangers)
        supported = chance <= self._most
        groups, new, better = (each[supported[len(xyz) :]] for each in (groups, new, chance[len(xyz) :]))
        chance = chance[: len(xyz)]
        if len(groups):
            track, born = _reenter(new, state, np.isnan(xyz[..., 0]).all(-1))
            found = track != NONE
            assigned[track[found]], xyz[track[found]], chance[track[found]] = groups[found], new[found], better[found]
            state += TrackState.birth(self._births, new[born])
            self._births += born.sum()
            assigned, xyz = np.concatenate([assigned, groups[born]]), np.concatenate([xyz, new[born]])
            chance = np.concatenate([chance, better[born]])
        state = state.updated(xyz, chance <= self._most, self._dt, config.tracking.velocity_gain)
        absent = np.isnan(xyz[..., 0]).all(-1)
        coasting_s = config.tracking.coasting_s
        state.xyz[state.joint_unseen > coasting_s] = np.nan
        lasting = (state.unseen <= coasting_s) & (state.unsupported <= coasting_s)
        self._state = state[lasting & ~np.isnan(state.xyz[..., 0]).all(-1)]
        assigned = np.where(absent[:, None, None], NONE, assigned)
        return TrackedFrame(state.track, assigned, xyz, np.where(absent, np.inf, chance))

    def alone(self, evidence: Evidence) -> np.ndarray:
        """Return the detections (P, V, J) of the people of a frame, which a new tracker would find; `NONE` for none."""
        groups, xyz, used = self._new_people(evidence, np.ones(evidence.xy.shape[1:3], bool))
        return groups[_by_chance(evidence, groups, xyz, used, self._strangers) <= self._most]

    def _new_people(
        self,
        evidence: Evidence,
        free: np.ndarray,
        colours: Callable[[], np.ndarray] | None = None,
        mixed: bool = False,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return people of free detections (V, D): these (G, V, J), joints (G, J, 3), and (G, J, V) the views used."""
        groups = _match(evidence, free, colours, self._compared, mixed or self._strangers is not None)
        if not len(groups):
            return groups, np.empty((0, groups.shape[2], 3)), np.empty((0, *groups.shape[:0:-1]), bool)
        points = evidence.triangulate(groups[None], _ITERATIONS)
        xyz, plausible = self._plausible(points, groups, self._birth_joints, np.zeros(len(groups), bool))
        return groups[plausible], xyz[plausible], points.used[0, plausible]

    def _split(
        self, evidence: Evidence, state: TrackState, assigned: np.ndarray, primary: np.ndarray, xyz: np.ndarray
    ) -> bool:
        """End the tracks whose two views have shown different people for a while, and return whether there are any."""
        if self._strangers is not None:
            return False
        state.mixed = np.maximum(state.mixed + np.where(_mixed_views(evidence, primary), self._dt, -self._dt), 0)
        ended = state.mixed >= _MIXED_S
        assigned[ended], primary[:, ended], xyz[ended], state.xyz[ended] = NONE, NONE, np.nan, np.nan
        return bool(ended.any())

    def _plausible(
        self, points: Points, assigned: np.ndarray, min_joints: int, confirmed: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return joints (T, J, 3), and (T,) True where assigned detections (T, V, J) show one person by these joints.

        Of the joints that enough views detect, `min_joints` and half must be known: rays of two people hardly ever
        meet. A bone that is longer than that of any person tells of views of two people, or of one joint that is off.
        It is a joint in a still, where later frames do not help, and where three views agree on `min_joints` of a
        confirmed track, which those of two people hardly ever do: then its two joints are dropped. Otherwise the
        person is, in this frame.

        Args:
            points: (1, T, J), triangulated from the detections.
            confirmed: (T,) True for tracks that have lasted.
        """
        xyz, start, end = points.xyz[0], *self._bones.T
        impossible = np.linalg.norm(xyz[:, start] - xyz[:, end], axis=-1) > self._longest
        one = confirmed & ((points.views[0] >= 3).sum(-1) >= min_joints) | (self._strangers is not None)
        person, bone = np.nonzero(impossible & one[:, None])
        xyz = xyz.copy()
        xyz[person, start[bone]] = xyz[person, end[bone]] = np.nan
        known = (~np.isnan(xyz[..., 0])).sum(-1)
        detected = ((assigned != NONE).sum(1) >= self._config.th_v).sum(-1)
        return xyz, (known >= min_joints) & (2 * known >= detected) & (one | ~impossible.any(-1))


def track(
    clip: Clip, config: CaptureConfig, noise: DetectionNoise | None = None, strangers: np.ndarray | None = None
) -> Tracks:
    """Assign the detections of a clip to people, in the order of the births of their tracks.

    Args:
        noise: How far detections scatter; by default as `config.noise` says.
        strangers: See `Tracker`.
    """
    frames, views, _, joints = clip.detections.score.shape
    colours = TorsoColours(clip) if has_appearance(clip, config) else None
    tracker = Tracker(clip.detections.skeleton, clip.fps, config, strangers)

    def blocks() -> Iterator[list[TrackedFrame]]:
        numbers = iter(progress(range(frames), "tracking people"))
        for part in in_steps(evidence_blocks(clip)):
            evidence = Evidence.of(clip, config.th_p, config, part, noise)
            yield [
                tracker.step(evidence.at(frame - part.start), None if colours is None else partial(colours, frame))
                for frame in islice(numbers, part.stop - part.start)
            ]

    return Tracks.of_blocks(blocks(), frames, views, joints)


def _compared_joints(skeleton: Skeleton, joints: ComparedJoints) -> list[int]:
    if joints == ComparedJoints.all:
        return list(range(len(skeleton)))
    if skeleton.defined and not {"l_hip", "r_hip"} <= set(skeleton.joints) and "mid_hip" not in skeleton.joints:
        raise ValueError(f"association.joints={joints}: skeleton {skeleton.name!r} has no hips; compare all joints")
    return skeleton.index("mid_hip") if "mid_hip" in skeleton.joints else skeleton.index("l_hip", "r_hip")


def longest_bone(skeleton: Skeleton) -> float:
    """Return the length, m, above which a bone joins detections of two people, or a joint that is somewhere else."""
    return PERSON_M if skeleton.defined else _LONGEST_BONE


def fewest_joints(joints: int) -> int:
    """Return the smallest number of joints of a measured person, for a skeleton with a given number of joints."""
    return min(MIN_JOINTS, fewer_of_few(joints))


def _propagate(
    evidence: Evidence, state: TrackState, sides: Sides, mirror: list[int], ahead_s: float
) -> tuple[np.ndarray, np.ndarray]:
    """Identity propagation: return detections (T, V, J) of the tracks, which were predicted for `ahead_s`, and the
    detection (V, T) that each was matched with; `NONE` where there is none.

    Detections with left and right exchanged are assigned as well; `mirror` (J,) is the partner of each joint.
    """
    config, confidence = evidence.config, evidence.confidence[0]
    present = ~np.isnan(confidence)
    distance = evidence.distances(state.xyz[None], config.th_d_unit)[0]
    if config.th_d_unit == DistanceUnit.metres:
        exchanged = evidence.distances(state.xyz[None][:, :, mirror], config.th_d_unit)[0]
        distance = nearer_side(distance, exchanged, sides, ahead_s)
    closeness = confidence[:, None] * np.maximum(1 - distance / config.th_d, -1)
    owner, primary = propagate(closeness, state.age > _CONFIRMATION_S)
    return assign_joints(primary, owner, present, closeness), primary


def _match(
    evidence: Evidence, free: np.ndarray, colours: Callable[[], np.ndarray] | None, compared: list[int], exchange: bool
) -> np.ndarray:
    """Identity matching: group free detections (V, D) by rays and clothes; return (G, V, J) detections, or `NONE`.

    With `exchange`, fragments of a joint or two are grouped as well, and groups are improved as a whole. Stills need
    it, as no later frame adds what was left out or separates who was mixed; so do people who were just told apart.
    """
    config, confidence = evidence.config.association, evidence.confidence[0]
    present = ~np.isnan(confidence)
    fewest = 1 if exchange else fewest_joints(present.shape[-1])
    view, detection = np.nonzero(free & (present.sum(-1) >= fewest) & present[..., compared].any(-1))
    if len(np.unique(view)) < 2:
        return np.empty((0, len(confidence), confidence.shape[-1]), int)
    rays = evidence.rays(0, view, detection)[:, compared]
    candidates = Candidates.of(view, evidence.rig.centers, rays, confidence[view, detection][:, compared])
    if colours is not None:
        # Images are decoded only if clothes of the same colour could make a pair.
        highest = highest_affinity(candidates, config)
        if highest + config.colour_weight * (1 - highest) >= config.min_affinity:
            colour = colours()[view, detection].astype(np.float32)
            candidates = candidates._replace(colours=colour)
    members = find_groups(candidates, config, exchange)
    found = np.where(members == NONE, NONE, detection[members])
    shown = (members != NONE)[..., None] & present[np.arange(len(confidence)), found]
    return np.where(shown, found[..., None], NONE)


def _mixed_views(evidence: Evidence, primary: np.ndarray) -> np.ndarray:
    """Return (T,) True for people of two views, `primary` (V, T), one of which fits detections of other views better.

    A wrong pair of views finds itself again, at the same wrong place, for as long as two people rest.
    """
    mixed, config = np.zeros(primary.shape[1], bool), evidence.config.association
    if len(primary) < 3 or not ((primary != NONE).sum(0) == 2).any():
        return mixed
    confidence, views = evidence.confidence[0], np.arange(len(primary))
    known = (~np.isnan(confidence)).sum(-1)
    view, detection = np.nonzero(known >= fewest_joints(confidence.shape[-1]))
    rays, alone = evidence.rays(0, view, detection), np.arange(len(view))
    candidates = Candidates.of(view, evidence.rig.centers, rays, confidence[view, detection])
    number = np.full((len(views), known.shape[1] + 1), NONE)
    number[view, detection] = alone
    people = number[views[:, None], primary]  # (V, T) their candidates
    members = np.where(view[:, None] == views, alone[:, None], NONE)
    for own in people.T:
        at = own[own != NONE]
        members[at] = NONE
        members[at[:1]] = own
    lengths = np.array([config.ray_distance_m, 0, config.min_affinity], np.float32)
    exchange_members(members, view, pair_evidence(candidates, *lengths), lengths[-1])
    row, column = np.nonzero(members != NONE)
    group, size = np.empty(len(view), int), (members != NONE).sum(1)
    group[members[row, column]] = row
    for t in np.flatnonzero((people != NONE).sum(0) == 2):
        one, other = group[people[people[:, t] != NONE, t]]
        mixed[t] = one != other and max(size[one], size[other]) > 1
    return mixed


def _by_chance(
    evidence: Evidence, assigned: np.ndarray, xyz: np.ndarray, used: np.ndarray, strangers: np.ndarray | None
) -> np.ndarray:
    """Return (P,) the number of people expected by chance whose views agree as well, see `expected_by_chance`.

    `assigned` is (P, V, J), `xyz` (P, J, 3) m, `used` (P, J, V) True for the views that a joint was triangulated from.
    """
    rig, most = evidence.rig, evidence.config.tracking.max_by_chance
    if not len(assigned) or most is None:
        return np.zeros(len(assigned))
    figures, assigned = count_figures(evidence).astype(float), np.ascontiguousarray(assigned)
    strangers = np.full(len(rig), np.inf) if strangers is None else strangers
    return expected_by_chance(
        rig.projections, rig.focal, rig.size, evidence.xy[0], assigned, xyz, used, figures, strangers, float(most)
    )


def count_figures(evidence: Evidence) -> np.ndarray:
    """Return the numbers (V,) of detections of one frame that have enough joints of a person."""
    known = ~np.isnan(evidence.confidence[0])
    return (known.sum(-1) >= fewest_joints(known.shape[-1])).sum(-1)


def _reenter(new: np.ndarray, state: TrackState, unmeasured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Assign G new persons, (G, J, 3) m, to tracks that they re-enter: of those `unmeasured` (T,) in this frame.

    Return the track (G,) or `NONE`, and (G,) True for persons that start a track; others are duplicates of measured
    ones.
    """
    offset = np.linalg.norm(new[:, None] - state.xyz[None], axis=-1)
    distance = median_known(offset[..., None])[..., 0]
    distance = np.where(np.isnan(distance), np.inf, distance)
    duplicate = np.any(distance[:, ~unmeasured] < _DUPLICATE_NEWCOMER_DISTANCE, -1)
    reachable = distance < _DISTANCE_FROM_PREDICTED + _WALKING_SPEED * state.unseen
    allowed = unmeasured & ~duplicate[:, None] & reachable
    track = np.full(len(new), NONE)
    for g, t in zip(*linear_sum_assignment(np.where(allowed, distance, 1e6)), strict=True):
        if allowed[g, t]:
            track[g] = t
    return track, ~duplicate & (track == NONE)


@compiled()
def assign_joints(primary, owner, present, closeness):
    """Return the detection that shows each joint of each track in each view, (T, V, J); -1 where none does.

    This is the primary detection of the track. A fragment or a duplicate supplies the joints that the primary detection
    lacks, if they are near.

    Args:
        primary: (V, T) primary detection of each track; negative for none.
        owner: (V, D) track of each detection; negative for none.
        present: (V, D, J) True for detected joints.
        closeness: (V, T, D, J), positive for joints near the track; NaN where either is absent.
    """
    views, tracks, _, joints = closeness.shape
    assigned = np.full((tracks, views, joints), -1)
    for v in range(views):
        for t in range(tracks):
            d = primary[v, t]
            for j in range(joints):
                if d >= 0 and present[v, d, j]:
                    assigned[t, v, j] = d
        for d in range(owner.shape[1]):
            t = owner[v, d]
            if t < 0 or primary[v, t] == d:
                continue
            for j in range(joints):
                if present[v, d, j] and assigned[t, v, j] < 0 and not closeness[v, t, d, j] <= 0:
                    assigned[t, v, j] = d
    return assigned
