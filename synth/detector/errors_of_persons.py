"""Errors of whole detections: times, swaps between people, merges, splits, ghosts, and lost frames."""

from dataclasses import dataclass, field, replace
from itertools import combinations
from math import inf

import numpy as np

from dmae.data.labels import JointError, Visibility
from dmae.data.skeleton import BODY25
from dmae.data.typed import Configuration
from dmae.numerics.noise import ar1_noise, beta_quantile, bursts
from synth.checks import check_range
from synth.detector.parts import LEG_KINDS, check_beta, joint_groups, kind_of
from synth.detector.view import ErrorStream, View, box, height


@dataclass(frozen=True)
class Timing(Configuration):
    """Cameras that do not expose their images at the times of the frames."""

    unsynchronised: float = 0.0
    """Frames: the images of each view are shifted in time by a constant, drawn uniformly from minus to plus this
    value."""
    rolling_shutter: float = 0.0
    """s; between the exposures of the first and the last row of an image."""

    def __post_init__(self):
        super().__post_init__()
        check_range("detector.timing", self, 0, inf, "unsynchronised", "rolling_shutter")

    def apply(self, view: View) -> View:
        """Move the truth of a view to the times of exposure.

        Positions are interpolated in the image, and extrapolated up to one frame beyond the ends of the clip.
        Visibility is taken from the nearest frame. Farther beyond the ends, nothing is known or detected.
        """
        frames, xy = len(view.true_xy), view.true_xy
        if not (self.unsynchronised or self.rolling_shutter) or frames < 2:
            return view
        time = np.arange(frames)[:, None, None] + self.unsynchronised * view.random(ErrorStream.TIMING).uniform(-1, 1)
        # Rows are taken at the time of the frame, because people move only a few rows while an image is read out.
        row = np.clip(np.nan_to_num(xy[..., 1]), 0, view.size[1])
        time = time + row / view.size[1] * self.rolling_shutter * view.fps
        before = np.clip(np.floor(time).astype(int), 0, frames - 2)
        after = (time - before)[..., None]
        person, joint = np.ogrid[: xy.shape[1], : xy.shape[2]]
        moved = xy[before, person, joint] * (1 - after) + xy[before + 1, person, joint] * after
        nearest = np.clip(np.rint(time).astype(int), 0, frames - 1)
        known = (time >= -1) & (time <= frames)
        code, occluder = view.visibility[nearest, person, joint], view.occluder[nearest, person, joint]
        # A person that leaves the image between two frames is not visible outside it. Other joints keep their codes.
        code = np.where(~view.inside(moved) & (code <= Visibility.HIDDEN_BY_OBJECT), Visibility.OUTSIDE_IMAGE, code)
        moved = np.where(known[..., None], moved, np.nan)
        code = np.where(known, code, Visibility.ABSENT)
        return replace(view, true_xy=moved, xy=moved, visibility=code, occluder=occluder)


# Swaps: joints that are detected on the same joint of another person

_NEAR = 0.06
"""Fraction of a person's height in the image. The same joint of another person within this distance can be confused."""


@dataclass(frozen=True)
class Swaps(Configuration):
    """Joints that are detected on the same joint of another person."""

    probability: float = 0.0
    """Probability of a swap, for a joint that is hidden by another person or has that person's near by."""

    def __post_init__(self):
        super().__post_init__()
        check_range("detector.swaps", self, 0, 1, "probability")

    def apply(self, view: View) -> View:
        persons = view.true_xy.shape[1]
        if not self.probability or persons < 2:
            return view
        xy, own = view.true_xy, view.owner
        # (F, P, P, 25): distance to the same joint of each other person.
        distance = np.linalg.norm(xy[:, :, None] - xy[:, None], axis=-1)
        distance = np.where(np.eye(persons, dtype=bool)[..., None] | np.isnan(distance), np.inf, distance)
        near = distance.min(2) < _NEAR * height(xy)[..., None]
        other = np.where(near, distance.argmin(2), own)
        other = np.where(view.visibility == Visibility.HIDDEN_BY_PERSON, view.occluder, other)
        owner = np.where(view.events(self.probability, own.shape, ErrorStream.SWAP), other, own)
        kind = np.where(owner == own, JointError.GOOD, JointError.SWAPPED).astype(np.uint8)
        swapped = np.take_along_axis(view.xy, owner[..., None].astype(int), 1)
        return replace(view, xy=swapped, owner=owner.astype(np.int16), kind=kind)


# Merges: two persons that become one detection

_GROUPS = joint_groups(
    dict.fromkeys(LEG_KINDS, "leg") | {"elbow": "arm", "wrist": "arm", "nose": "head", "eye": "head", "ear": "head"},
    "trunk",
    sided=("leg", "arm"),
)  # fmt: skip
_LIMBS = np.array([joints for name, joints in _GROUPS.items() if name != "trunk"])
"""(limbs, 25) True for the joints of each limb that a merged detection can have from either person."""


@dataclass(frozen=True)
class Merges(Configuration):
    """Two persons with overlapping boxes who become one detection, with some limbs from the other person."""

    probability: float = 0.0
    """Probability of a merge where the box of one person in the image lies within the other's; less where they overlap
    less."""
    remainder: float = 0.5
    """Probability that the other person's remaining joints are reported as well."""

    def __post_init__(self):
        super().__post_init__()
        check_range("detector.merges", self, 0, 1, "probability", "remainder")

    def apply(self, view: View) -> View:
        frames, persons = view.score.shape[:2]
        pairs = list(combinations(range(persons), 2))
        if not self.probability or not pairs:
            return view
        rng = view.random(ErrorStream.MERGE)
        event, side, rest = np.moveaxis(view.noise((frames, len(pairs), 3), rng=rng), -1, 0)
        limbs = view.noise((frames, len(pairs), len(_LIMBS)), rng=rng) < 0
        low, high = box(view.xy)
        free = np.any(view.observed, -1)
        arrays = {name: getattr(view, name).copy() for name in ("xy", "score", "owner", "kind")}
        for i, (a, b) in enumerate(pairs):
            both = np.clip(np.minimum(high[:, a], high[:, b]) - np.maximum(low[:, a], low[:, b]), 0, None).prod(-1)
            smaller = np.minimum((high[:, a] - low[:, a]).prod(-1), (high[:, b] - low[:, b]).prod(-1))
            overlap = both / np.maximum(smaller, 1e-9)
            frame = np.flatnonzero(bursts(self.probability * overlap, event[:, i]) & free[:, a] & free[:, b])
            free[frame, a] = free[frame, b] = False
            host = np.where(side[frame, i] < 0, a, b)
            keep_rest = bursts(self.remainder, rest[frame, i])
            _merge(arrays, frame, host, a + b - host, limbs[frame, i], keep_rest)
        return replace(view, **arrays)


def _merge(arrays: dict[str, np.ndarray], frame, host, guest, limbs, keep_rest) -> None:
    """Move `limbs` (n, limbs) of the guest to the host in n frames, in place; the guest keeps the rest if `keep_rest`
    (n,)."""
    given = (limbs[..., None] & _LIMBS).any(1) & np.isfinite(arrays["score"][frame, guest])
    n, joint = np.nonzero(given)
    for array in arrays.values():
        array[frame[n], host[n], joint] = array[frame[n], guest[n], joint]
    # A joint of the host that was swapped onto the guest returns to the host.
    another = arrays["owner"][frame[n], host[n], joint] != host[n]
    arrays["kind"][frame[n], host[n], joint] = np.where(another, JointError.MERGED, JointError.GOOD)
    n, joint = np.nonzero(given | ~keep_rest[:, None])
    arrays["xy"][frame[n], guest[n], joint], arrays["score"][frame[n], guest[n], joint] = np.nan, np.nan


# Splits: one person that becomes two detections

_LOWER = np.array([kind_of(joint) in (*LEG_KINDS, "hip", "mid_hip") for joint in BODY25.joints])
_LEFT = np.array([joint.startswith("l_") for joint in BODY25.joints])


@dataclass(frozen=True)
class Splits(Configuration):
    """One person that becomes two detections: upper and lower part, or left and right."""

    probability: float = 0.0
    """Probability that a person is split in a frame."""

    def __post_init__(self):
        super().__post_init__()
        check_range("detector.splits", self, 0, 1, "probability")

    def apply(self, view: View) -> View:
        if not self.probability:
            return view
        noise = view.noise((*view.score.shape[:2], 2), rng=view.random(ErrorStream.SPLIT))
        event = bursts(self.probability, noise[..., 0])
        off = event[..., None] & np.where(noise[..., 1, None] < 0, _LOWER, _LEFT)
        piece = view.without(~off)
        return view.without(off).added(piece.xy, piece.score, piece.owner, piece.kind, piece.person)


# Ghosts: persons that a detector reports where there are none

_DUTY = 0.2
"""Fraction of the frames in which a ghost is detected."""
_NOISE = 0.02
"""Scale of a ghost's noise, as a fraction of its height."""


@dataclass(frozen=True)
class Ghosts(Configuration):
    """Persons that a detector sees where none are, at fixed places in the image. Their shapes are true poses."""

    count: float = 0.0
    """Mean number of ghosts in a view and frame."""
    joints: float = 0.45
    """Fraction of a ghost's joints that are reported."""
    score: list[float] = field(default_factory=lambda: [5.0, 4.0])
    """(a, b) of the Beta distribution of their confidence."""

    def __post_init__(self):
        super().__post_init__()
        check_range("detector.ghosts", self, 0, inf, "count")
        check_range("detector.ghosts", self, 0, 1, "joints")
        check_beta("detector.ghosts.score", self.score)
        if self.count and not 0 < self.joints < 1:
            raise ValueError(f"detector.ghosts.joints: expected a number above 0 and below 1, found {self.joints}")

    def apply(self, view: View) -> View:
        rng = view.random(ErrorStream.GHOSTS)
        poses = view.xyz[np.isfinite(view.xyz).all((2, 3))]
        places = rng.poisson(self.count / _DUTY) if self.count and len(poses) else 0
        if not places:
            return view
        joints = (len(view.xyz), places, len(BODY25))
        pose = poses[rng.integers(len(poses), size=places)]
        angle = rng.uniform(0, 2 * np.pi, (places, 1))
        shape = np.stack([pose[..., 0] * np.cos(angle) + pose[..., 1] * np.sin(angle), -pose[..., 2]], -1)
        low, high = box(shape)
        height = rng.uniform(0.2, 0.7, (places, 1, 1)) * view.size[1]
        middle = rng.uniform(0, 1, (places, 1, 2)) * (view.size - 1)
        still = (shape - (low + high)[:, None] / 2) / (high - low)[:, None, 1:] * height + middle
        xy = still + _NOISE * height * ar1_noise((*joints, 2), view.fps, view.times.correlation, rng=rng)
        # Mostly the same joints of a ghost are detected in all frames.
        probability = rng.beta(self.joints, 1 - self.joints, (places, len(BODY25)))
        detected = bursts(probability, view.noise(joints, rng=rng))
        detected &= bursts(_DUTY, view.noise(joints[:2], rng=rng))[..., None]
        score = beta_quantile(np.array(self.score), rng.uniform(size=joints))
        ghosts = replace(view, xy=xy, score=np.where(detected, score, np.nan)).reported()
        labels = np.full(joints, -1), np.full(joints, JointError.GHOST), np.full(places, -1)
        return view.added(ghosts.xy, ghosts.score, *labels)


# Drops: frames of a view that are lost


@dataclass(frozen=True)
class Drops(Configuration):
    """Frames of a view that are lost."""

    probability: float = 0.0
    """Probability that a frame is lost, in bursts of the short time of `times.bursts`."""
    repeat: bool = False
    """Whether a lost frame repeats the detections of the previous frame."""

    def __post_init__(self):
        super().__post_init__()
        check_range("detector.drops", self, 0, 1, "probability")

    def apply(self, view: View) -> View:
        if not self.probability:
            return view
        noise = ar1_noise(view.shown.shape, view.fps, view.times.bursts[1], rng=view.random(ErrorStream.DROP))
        shown = np.where(bursts(self.probability, noise), -1, view.shown)
        return replace(view, shown=np.maximum.accumulate(shown) if self.repeat else shown)
