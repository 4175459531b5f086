"""Who is who, frame by frame: identity propagation and identity matching (Algorithm 1 of the paper)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from enum import StrEnum
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.appearance import Looks
from dmae.associate import NONE, affinity, cluster, propagate, ray_distances
from dmae.clip import Clip
from dmae.progress import progress
from dmae.seen import Seen
from dmae.skeleton import Skeleton

if TYPE_CHECKING:
    from dmae.capture import CaptureConfig

_FEWEST = 3
"""Joints without which nobody is measured, and nothing is compared."""
_LONGEST_BONE = 0.8
"""m; what has longer ones is made of two people."""
_TWIN = 0.2
"""m; a new person whose joints are nearer than this to somebody's is a double of that person."""
_REACH, _PACE = 0.3, 1.5
"""m and m/s: how far from where they are expected people are found again."""
_STEPS = 2
"""Of refinement: to tell whose joints are, they need not be exact."""
_DAMPING = 0.5
"""s; velocities fade by 1/e in this time unless measured anew."""


class Joints(StrEnum):
    """By which joints detections are compared between views."""

    all = "all"
    mid_hip = "mid_hip"
    """Or both hips, where the detector has no middle."""


@dataclass
class _People:
    """The T people around now; `index` (T,) is their row in the result, times are in s.

    Attributes:
        xyz: (T, J, 3) joints where they are expected, NaN where nothing is known.
        velocity: (T, 3) of the whole body, m/s.
        unseen: (T, J) since the joint was measured.
        lost: (T,) since the person was measured.
        life: (T,) that the person was measured for.
    """

    index: np.ndarray
    xyz: np.ndarray
    velocity: np.ndarray
    unseen: np.ndarray
    lost: np.ndarray
    life: np.ndarray

    @classmethod
    def born(cls, first: int, xyz: np.ndarray) -> _People:
        count, joints = xyz.shape[:2]
        nothing = np.zeros(count)
        return cls(first + np.arange(count), xyz, np.zeros((count, 3)), np.zeros((count, joints)), nothing, nothing)

    def __getitem__(self, which) -> _People:
        return _People(*(getattr(self, f.name)[which] for f in fields(self)))

    def __add__(self, others: _People) -> _People:
        return _People(*(np.concatenate([getattr(self, f.name), getattr(others, f.name)]) for f in fields(self)))

    def predicted(self, dt: float) -> _People:
        return replace(
            self,
            xyz=self.xyz + self.velocity[:, None] * dt,
            velocity=self.velocity * np.exp(-dt / _DAMPING),
            unseen=self.unseen + dt,
            lost=self.lost + dt,
        )

    def measured(self, xyz: np.ndarray, dt: float, inertia: float) -> _People:
        """With what is known (T, J, 3) of them now; NaN for joints not measured, all NaN for people not measured."""
        known = ~np.isnan(xyz[..., 0])
        velocity = self.velocity.copy()
        step = _median(xyz - self.xyz)
        moved = ~np.isnan(step[:, 0])
        velocity[moved] += inertia * step[moved] / dt
        return replace(
            self,
            xyz=np.where(known[..., None], xyz, self.xyz),
            velocity=velocity,
            unseen=np.where(known, 0, self.unseen),
            lost=np.where(known.any(-1), 0, self.lost),
            life=self.life + np.where(known.any(-1), dt, 0),
        )


def _median(values: np.ndarray) -> np.ndarray:
    """(..., 3) median of what is known of (..., J, 3), which is known or not for all three; NaN of nothing."""
    ordered, count = np.sort(values, -2), (~np.isnan(values[..., :1])).sum(-2, keepdims=True)
    low, high = (np.take_along_axis(ordered, np.maximum(count - k, 0) // 2, -2) for k in (1, 0))
    return ((low + high) / 2)[..., 0, :]


Tracked = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Of the T people of a frame: row (T,), detections chosen (T, V, J) or `NONE`, and joints (T, J, 3) m made of them."""


class Tracker:
    """Gives detections to people frame by frame, and looks only back."""

    def __init__(self, skeleton: Skeleton, fps: float, config: CaptureConfig):
        self._config, self._dt = config, 1 / fps
        self._compared = _compared(skeleton, config.matching)
        self._bones = np.array(skeleton.bones).reshape(-1, 2)
        self._people = _People.born(0, np.empty((0, len(skeleton), 3)))
        self._count = 0

    def step(self, seen: Seen, frame: int, looks: Looks | None = None) -> Tracked:
        """Who is in the next frame, which is number `frame` of what was seen."""
        config, bones = self._config, self._bones
        people = self._people.predicted(self._dt)
        chosen, owner = _propagate(seen, frame, people)
        xyz = seen.triangulate(frame, chosen, _STEPS).xyz
        sound = _plausible(xyz, chosen, bones, _FEWEST, config.th_v)
        xyz[~sound] = np.nan
        free = (owner == NONE) | ~np.append(sound, False)[owner]
        groups = _match(seen, frame, free, looks, self._compared)
        if len(groups):
            new = seen.triangulate(frame, groups, _STEPS).xyz
            sound = _plausible(new, groups, bones, config.birth_joints, config.th_v)
            groups, new = groups[sound], new[sound]
            person, born = _recognise(new, people, np.isnan(xyz[..., 0]).all(-1))
            back = person != NONE
            chosen[person[back]], xyz[person[back]] = groups[back], new[back]
            people += _People.born(self._count, new[born])
            self._count += born.sum()
            chosen, xyz = np.concatenate([chosen, groups[born]]), np.concatenate([xyz, new[born]])
        people = people.measured(xyz, self._dt, config.inertia)
        gone = np.isnan(xyz[..., 0]).all(-1)
        people.xyz[people.unseen > config.coast] = np.nan
        self._people = people[(people.lost <= config.coast) & ~np.isnan(people.xyz[..., 0]).all(-1)]
        return people.index, np.where(gone[:, None, None], NONE, chosen), xyz


def stack(history: Sequence[Tracked], rows: np.ndarray, views: int, joints: int) -> tuple[np.ndarray, np.ndarray]:
    """Detections (F, P, V, J) and joints (F, P, J, 3) of the people of some rows (P,), ascending."""
    all_chosen = np.full((len(history), len(rows), views, joints), NONE, np.int16)
    all_xyz = np.full((len(history), len(rows), joints, 3), np.nan)
    for frame, (index, chosen, xyz) in enumerate(history):
        wanted = np.isin(index, rows)
        column = np.searchsorted(rows, index[wanted])
        all_chosen[frame, column], all_xyz[frame, column] = chosen[wanted], xyz[wanted]
    return all_chosen, all_xyz


def identify(seen: Seen, clip: Clip, config: CaptureConfig) -> tuple[np.ndarray, np.ndarray]:
    """Give the detections of a clip to people.

    Returns:
        chosen: (F, P, V, J) index of the detection that shows the joint in the view, or `NONE`.
        xyz: (F, P, J, 3) m, the joints made of them.
    """
    frames, views, _, joints = seen.confidence.shape
    looks = Looks(clip) if looks_matter(clip, config) else None
    tracker = Tracker(clip.detections.skeleton, clip.fps, config)
    history = [tracker.step(seen, frame, looks) for frame in progress(range(frames), "finding people")]
    everybody = max((index.max(initial=-1) + 1 for index, *_ in history), default=0)
    return stack(history, np.arange(everybody), views, joints)


def looks_matter(clip: Clip, config: CaptureConfig) -> bool:
    """Whether there are colour images, and they are asked for."""
    return config.colour_weight > 0 and clip.images is not None and "rgb" in clip.images.kinds


def _compared(skeleton: Skeleton, joints: Joints) -> list[int]:
    if joints == Joints.all:
        return list(range(len(skeleton)))
    return skeleton.index("mid_hip") if "mid_hip" in skeleton.joints else skeleton.index("l_hip", "r_hip")


def _propagate(seen: Seen, frame: int, people: _People) -> tuple[np.ndarray, np.ndarray]:
    """Detections (T, V, J) chosen for people, and whose each detection is: (V, D) index of people or `NONE`."""
    config, confidence = seen.config, seen.confidence[frame]
    present = ~np.isnan(confidence)
    distance = seen.distance(slice(frame, frame + 1), people.xyz[None], config.th_d_unit)[0]
    closeness = confidence[:, None] * np.maximum(1 - distance / config.th_d, -1)
    owner, primary = propagate(closeness, people.life > config.seniority)
    view = np.arange(len(primary))[:, None]
    chosen = np.where(present[view, primary] & (primary != NONE)[..., None], primary[..., None], NONE)
    # A fragment, or a double, lends what the person lacks in this view, unless it lies elsewhere.
    for v, d in np.argwhere(owner != NONE):
        person = owner[v, d]
        if d != primary[v, person]:
            lent = present[v, d] & (chosen[v, person] == NONE) & ~(closeness[v, person, d] <= 0)
            chosen[v, person, lent] = d
    return chosen.swapaxes(0, 1), owner


def _match(seen: Seen, frame: int, free: np.ndarray, looks: Looks | None, compared: list[int]) -> np.ndarray:
    """Groups (G, V, J) of free detections (V, D) that are of one person, by rays and looks."""
    config, confidence = seen.config, seen.confidence[frame]
    present = ~np.isnan(confidence)
    view, detection = np.nonzero(free & (present.sum(-1) >= _FEWEST) & present[..., compared].any(-1))
    joints = confidence.shape[-1]
    if len(np.unique(view)) < 2:
        return np.empty((0, len(confidence), joints), int)
    rays = seen.rig.rays(seen.xy[frame][None])[0, view, detection][:, compared]
    sure = confidence[view, detection][:, compared]
    distances = ray_distances(seen.rig.centers[view], rays)
    alike = affinity(distances, np.sqrt(sure[:, None] * sure[None]), config.half_ray)
    at_best = np.where(view[:, None] != view, alike + config.colour_weight * (1 - alike), 0)
    if looks is not None and (at_best >= config.th_a).any():
        colour = looks(frame)[view, detection]
        like = 1 / (1 + ((colour[:, None] - colour[None]) ** 2).sum(-1) / config.half_colour**2)
        alike = np.where(np.isnan(like), alike, alike + config.colour_weight * (like - alike))
    found = cluster(alike, view, config.th_a)
    groups = np.full((len(found), len(confidence), joints), NONE)
    for group, members in zip(groups, found, strict=True):
        for v, d in zip(view[members], detection[members], strict=True):
            group[v] = np.where(present[v, d], d, NONE)
    return groups


def _plausible(xyz: np.ndarray, chosen: np.ndarray, bones: np.ndarray, least: int, views: int) -> np.ndarray:
    """(T,) True where chosen detections (T, V, J) are of one person, by the joints (T, J, 3) made of them.

    At least so many joints are known, and half of those detected in so many views: in those of two people
    hardly any two rays meet. No bone is too long for a body.
    """
    known = (~np.isnan(xyz[..., 0])).sum(-1)
    detected = ((chosen != NONE).sum(1) >= views).sum(-1)
    length = np.linalg.norm(xyz[:, bones[:, 0]] - xyz[:, bones[:, 1]], axis=-1)
    return (known >= least) & (2 * known >= detected) & ~(length > _LONGEST_BONE).any(-1)


def _recognise(new: np.ndarray, people: _People, lost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of new people (G, J, 3): who (G,) among the lost they are, or `NONE`; and which (G,) are really new."""
    gap = np.full((len(new), len(lost)), np.inf)
    for g, t in np.ndindex(gap.shape):
        off = np.linalg.norm(new[g] - people.xyz[t], axis=-1)
        if not np.isnan(off).all():
            gap[g, t] = np.nanmedian(off)
    twin = (gap[:, ~lost] < _TWIN).any(-1)
    allowed = lost & ~twin[:, None] & (gap < _REACH + _PACE * people.lost)
    person = np.full(len(new), NONE)
    for g, t in zip(*linear_sum_assignment(np.where(allowed, gap, 1e6)), strict=True):
        if allowed[g, t]:
            person[g] = t
    return person, ~twin & (person == NONE)
