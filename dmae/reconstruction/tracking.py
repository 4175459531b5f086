"""Tracking, frame by frame: identity propagation and identity matching (Algorithm 1 of the paper)."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.data.clip import Clip
from dmae.data.skeleton import PERSON_M, Skeleton
from dmae.files.mapped import release
from dmae.numerics.statistics import median_known
from dmae.progress import progress
from dmae.reconstruction.appearance import TorsoColours, has_appearance
from dmae.reconstruction.association import NONE, Candidates, find_groups, highest_affinity, propagate
from dmae.reconstruction.compiled.assigned import assign_joints
from dmae.reconstruction.compiled.chance import beyond_chance
from dmae.reconstruction.config import CaptureConfig, ComparedJoints, DistanceUnit, fewer_of_few
from dmae.reconstruction.evidence import Evidence, evidence_blocks
from dmae.reconstruction.people.sides import Sides, exchange, find_exchanged, nearer_side
from dmae.reconstruction.tracks import TrackedFrame, Tracks, TrackState

_MIN_JOINTS = 3
"""Smallest number of joints of a measured person, and of a detection that is compared."""
_LONGEST_BONE = 0.8
"""m; a person with a longer bone consists of detections of two people. In your own skeletons, bones may have the length
of the body."""
_DUPLICATE_DISTANCE = 0.2
"""m; a new person at a smaller median distance from a tracked one is a duplicate of it."""
_REENTRY_DISTANCE, _WALKING_SPEED = 0.3, 1.5
"""m and m/s: largest distance of a re-entry from the predicted place."""
_ITERATIONS = 2
"""Number of steps of refinement; points for assignment need not be exact."""


class Tracker:
    """Assign detections to people frame by frame, without looking ahead."""

    def __init__(self, skeleton: Skeleton, fps: float, config: CaptureConfig):
        self._config, self._dt = config, 1 / fps
        self._compared = _compared_joints(skeleton, config.association.joints)
        self._sides, self._mirror = Sides.of(skeleton), list(skeleton.mirror)
        self._bones = np.array(skeleton.bones, int).reshape(-1, 2)
        self._state = TrackState.birth(0, np.empty((0, len(skeleton), 3)))
        self._births = 0
        self._longest = PERSON_M if skeleton.defined else _LONGEST_BONE
        self._fewest = _fewest(len(skeleton))
        self._birth_joints = config.tracking.births(len(skeleton))

    def step(self, evidence: Evidence, frame: int, colours: Callable[[int], np.ndarray] | None = None) -> TrackedFrame:
        """Track people into the next frame, which has index `frame` in the evidence."""
        config, bones = self._config, self._bones
        colours_here = None if colours is None else partial(colours, frame)
        state = self._state.predicted(self._dt)
        assigned, owner = _propagate(evidence, frame, state, self._sides, self._mirror)
        wrong = find_exchanged(evidence, slice(frame, frame + 1), assigned[None], state.xyz[None], self._sides)
        if wrong[0].any():
            evidence, frame = exchange(evidence.at(frame), 0, *wrong, self._sides), 0
        points = evidence.triangulate(frame, assigned, _ITERATIONS)
        xyz, used = points.xyz, points.used
        plausible = _plausible(xyz, assigned, bones, self._longest, self._fewest, config.th_v)
        xyz[~plausible] = np.nan
        free = (owner == NONE) | ~np.append(plausible, False)[owner]
        groups = _match(evidence, frame, free, colours_here, self._compared)
        if len(groups):
            points = evidence.triangulate(frame, groups, _ITERATIONS)
            plausible = _plausible(points.xyz, groups, bones, self._longest, self._birth_joints, config.th_v)
            groups, new, used = groups[plausible], points.xyz[plausible], np.concatenate([used, points.used[plausible]])
        else:
            new = np.empty((0, *xyz.shape[1:]))
        supported = _supported(evidence, frame, np.concatenate([assigned, groups]), np.concatenate([xyz, new]), used)
        groups, new, supported = groups[supported[len(xyz) :]], new[supported[len(xyz) :]], supported[: len(xyz)]
        if len(groups):
            track, born = _reenter(new, state, np.isnan(xyz[..., 0]).all(-1))
            found = track != NONE
            assigned[track[found]], xyz[track[found]], supported[track[found]] = groups[found], new[found], True
            state += TrackState.birth(self._births, new[born])
            self._births += born.sum()
            assigned, xyz = np.concatenate([assigned, groups[born]]), np.concatenate([xyz, new[born]])
            supported = np.concatenate([supported, np.ones(born.sum(), bool)])
        state = state.updated(xyz, supported, self._dt, config.tracking.velocity_gain)
        absent = np.isnan(xyz[..., 0]).all(-1)
        coasting_s = config.tracking.coasting_s
        state.xyz[state.joint_unseen > coasting_s] = np.nan
        lasting = (state.unseen <= coasting_s) & (state.unsupported <= coasting_s)
        self._state = state[lasting & ~np.isnan(state.xyz[..., 0]).all(-1)]
        return TrackedFrame(state.track, np.where(absent[:, None, None], NONE, assigned), xyz, supported & ~absent)


def track(clip: Clip, config: CaptureConfig) -> Tracks:
    """Assign the detections of a clip to people, in the order of the births of their tracks."""
    frames, views, _, joints = clip.detections.score.shape
    return Tracks.of_blocks(_tracked(clip, config), frames, views, joints)


def _tracked(clip: Clip, config: CaptureConfig) -> Iterator[list[TrackedFrame]]:
    """Yield the tracked frames of a clip, in blocks."""
    colours = TorsoColours(clip) if has_appearance(clip, config) else None
    tracker = Tracker(clip.detections.skeleton, clip.fps, config)
    numbers = iter(progress(range(len(clip)), "tracking people"))
    for part in evidence_blocks(clip):
        evidence = Evidence.of(clip, config.th_p, config, part)
        release(clip.detections.xy, clip.detections.score)
        yield [
            tracker.step(evidence, frame - part.start, colours and partial(_colours, colours, part.start))
            for frame in islice(numbers, part.stop - part.start)
        ]


def _colours(colours: TorsoColours, start: int, frame: int) -> np.ndarray:
    """Return the colours of a frame, with its index counted from `start`."""
    return colours(start + frame)


def _compared_joints(skeleton: Skeleton, joints: ComparedJoints) -> list[int]:
    """Return the indices of the joints to compare."""
    if joints == ComparedJoints.all:
        return list(range(len(skeleton)))
    if skeleton.defined and not {"l_hip", "r_hip"} <= set(skeleton.joints) and "mid_hip" not in skeleton.joints:
        raise ValueError(f"association.joints={joints}: skeleton {skeleton.name!r} has no hips; compare all joints")
    return skeleton.index("mid_hip") if "mid_hip" in skeleton.joints else skeleton.index("l_hip", "r_hip")


def _fewest(joints: int) -> int:
    """Return the smallest number of joints of a measured person, for a skeleton with a given number of joints."""
    return min(_MIN_JOINTS, fewer_of_few(joints))


def _propagate(
    evidence: Evidence, frame: int, state: TrackState, sides: Sides, mirror: list[int]
) -> tuple[np.ndarray, np.ndarray]:
    """Identity propagation: assign detections to the T tracks, those with left and right exchanged as well.

    Args:
        sides: Of the skeleton.
        mirror: (J,) index of the partner of each joint.

    Returns:
        assigned: (T, V, J) detections, or `NONE`.
        owner: (V, D) index of the track of each detection, or `NONE`.
    """
    config, confidence = evidence.config, evidence.confidence[frame]
    present = ~np.isnan(confidence)
    here, unit = slice(frame, frame + 1), config.th_d_unit
    distance = evidence.distances(here, state.xyz[None], unit)[0]
    if unit == DistanceUnit.metres:
        exchanged = evidence.distances(here, state.xyz[None][:, :, mirror], unit)[0]
        distance = nearer_side(distance, exchanged, sides)
    closeness = confidence[:, None] * np.maximum(1 - distance / config.th_d, -1)
    owner, primary = propagate(closeness, state.age > config.tracking.confirmation_s)
    assigned = np.empty((*primary.shape, confidence.shape[-1]), np.int64)
    assign_joints(primary, owner, present, closeness, assigned)
    return assigned.swapaxes(0, 1), owner


def _match(
    evidence: Evidence, frame: int, free: np.ndarray, colours: Callable[[], np.ndarray] | None, compared: list[int]
) -> np.ndarray:
    """Identity matching: group free detections (V, D) by rays and clothes; return (G, V, J) detections, or `NONE`."""
    config, confidence = evidence.config.association, evidence.confidence[frame]
    present = ~np.isnan(confidence)
    view, detection = np.nonzero(
        free & (present.sum(-1) >= _fewest(present.shape[-1])) & present[..., compared].any(-1)
    )
    if len(np.unique(view)) < 2:
        return np.empty((0, len(confidence), confidence.shape[-1]), int)
    rays = evidence.rays(frame, view, detection)[:, compared]
    candidates = Candidates.of(view, evidence.rig.centers, rays, confidence[view, detection][:, compared])
    if colours is not None:
        # Images are decoded only if clothes of the same colour could make a pair.
        highest = highest_affinity(candidates, config)
        if highest + config.colour_weight * (1 - highest) >= config.min_affinity:
            colour = colours()[view, detection].astype(np.float32)
            candidates = replace(candidates, colours=colour)
    members = find_groups(candidates, config)
    found = np.where(members == NONE, NONE, detection[members])
    shown = (members != NONE)[..., None] & present[np.arange(len(confidence)), found]
    return np.where(shown, found[..., None], NONE)


def _plausible(
    xyz: np.ndarray, assigned: np.ndarray, bones: np.ndarray, longest: float, min_joints: int, views: int
) -> np.ndarray:
    """Return (T,) True where assigned detections (T, V, J) show one person, judging by their joints (T, J, 3).

    At least `min_joints` must be known, and at least half of the joints that enough views detected, because the rays of
    two different people hardly ever meet. No bone may be longer than `longest`, m.
    """
    known = (~np.isnan(xyz[..., 0])).sum(-1)
    detected = ((assigned != NONE).sum(1) >= views).sum(-1)
    length = np.linalg.norm(xyz[:, bones[:, 0]] - xyz[:, bones[:, 1]], axis=-1)
    return (known >= min_joints) & (2 * known >= detected) & ~(length > longest).any(-1)


def _supported(evidence: Evidence, frame: int, assigned: np.ndarray, xyz: np.ndarray, used: np.ndarray) -> np.ndarray:
    """Return (P,) True for people with views that agree better than unrelated figures would, see `beyond_chance`.

    Args:
        assigned: (P, V, J) detections, or `NONE`.
        xyz: (P, J, 3) m.
        used: (P, J, V) True for the views that a joint was triangulated from.
    """
    rig, most = evidence.rig, evidence.config.tracking.max_by_chance
    supported = np.ones(len(assigned), bool)
    if len(assigned) and most is not None:
        figures = ((~np.isnan(evidence.confidence[frame])).sum(-1) >= _fewest(xyz.shape[1])).sum(-1).astype(float)
        focal, width = rig.focal, rig.size[:, 0].astype(float)
        beyond_chance(
            rig.projections, focal, width, evidence.xy[frame], assigned, xyz, used, figures, float(most), supported
        )
    return supported


def _reenter(new: np.ndarray, state: TrackState, unmeasured: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Assign G new persons to tracks that are not measured in this frame and that they re-enter.

    Args:
        new: (G, J, 3) m.
        unmeasured: (T,) True for tracks without a measurement.

    Returns:
        track: (G,) index of the track that each person re-enters, or `NONE`.
        born: (G,) True for persons that start a new track; the others are duplicates of measured ones.
    """
    offset = np.linalg.norm(new[:, None] - state.xyz[None], axis=-1)
    distance = median_known(offset[..., None])[..., 0]
    distance = np.where(np.isnan(distance), np.inf, distance)
    duplicate = (distance[:, ~unmeasured] < _DUPLICATE_DISTANCE).any(-1)
    reachable = distance < _REENTRY_DISTANCE + _WALKING_SPEED * state.unseen
    allowed = unmeasured & ~duplicate[:, None] & reachable
    track = np.full(len(new), NONE)
    for g, t in zip(*linear_sum_assignment(np.where(allowed, distance, 1e6)), strict=True):
        if allowed[g, t]:
            track[g] = t
    return track, ~duplicate & (track == NONE)
