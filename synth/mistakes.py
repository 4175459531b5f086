"""The mistakes that 2D pose detectors make, in one view."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.special import gammaincinv, ndtr, ndtri

from dmae.clip import Visibility
from dmae.skeleton import BODY25
from synth.chance import beta_quantile, in_bursts, unrest, wander


@dataclass(frozen=True)
class PartConfig:
    """How a detector does on one kind of joint.

    Attributes:
        noise: Scale of Student's t of a pixel coordinate's error where the joint is visible, as a fraction of the
            person's height in the image.
        tail: Degrees of freedom of that distribution: 2 has a long tail, 30 is nearly Gaussian.
        score: (a, b) of the Beta distribution of the confidence of visible joints; (1, 0) is always 1.
        miss: Share of joints missed where visible, hidden by the person itself, by another, by an object. Shares
            other than 0 and 1 are averaged with those of the limb's joints.
    """

    noise: float = 0.0
    tail: float = 30.0
    score: list[float] = field(default_factory=lambda: [1.0, 0.0])
    miss: list[float] = field(default_factory=lambda: [0.0, 1.0, 1.0, 1.0])

    def __post_init__(self):
        for name, length in (("score", 2), ("miss", 4)):
            found = getattr(self, name)
            if len(found) != length:
                raise ValueError(f"detector part: expected {length} numbers of {name}, got {list(found)}")
        if self.noise < 0 or not self.tail > 0 or not all(0 <= share <= 1 for share in self.miss):
            raise ValueError(
                f"detector part: expected noise >= 0, tail > 0 and shares of misses from 0 to 1, got {self}"
            )


@dataclass(frozen=True)
class PartsConfig:
    """How a detector does on each kind of joint, left and right alike."""

    nose: PartConfig = field(default_factory=PartConfig)
    neck: PartConfig = field(default_factory=PartConfig)
    shoulder: PartConfig = field(default_factory=PartConfig)
    elbow: PartConfig = field(default_factory=PartConfig)
    wrist: PartConfig = field(default_factory=PartConfig)
    mid_hip: PartConfig = field(default_factory=PartConfig)
    hip: PartConfig = field(default_factory=PartConfig)
    knee: PartConfig = field(default_factory=PartConfig)
    ankle: PartConfig = field(default_factory=PartConfig)
    eye: PartConfig = field(default_factory=PartConfig)
    ear: PartConfig = field(default_factory=PartConfig)
    big_toe: PartConfig = field(default_factory=PartConfig)
    small_toe: PartConfig = field(default_factory=PartConfig)
    heel: PartConfig = field(default_factory=PartConfig)


@dataclass(frozen=True)
class DetectorConfig:
    """A 2D pose detector of BODY25. As it stands here: all that is visible, nothing that is not, without error.

    Attributes:
        name: For people to read.
        parts: By kind of joint.
        bias: Share of the error's energy that is a constant of person, view and joint; long tails dilute it.
        correlation: Time in which the rest of the error forgets itself (to 1/e), s.
        guess_noise: Error at hidden joints that are detected all the same, relative to that at visible ones.
        guess_score: (a, b) of the Beta distribution of the confidence at hidden joints.
        score_knows: Correlation, 0 to 1, between the ranks of a confidence and of the error it goes with.
        least_score: Joints of less confidence are not reported.
        bursts: Times over which mistakes hang together, s: a long and a short one, mixed half and half.
        together: Correlation of misses within an arm, a leg, a foot, the face and the trunk.
        person_miss: Share of frames in which a person in full view is missed whole.
        person_miss_hidden: The same of a person that is wholly hidden or outside the image; in between it grows
            with the cube of the share of joints that are.
        leg_inversion, arm_inversion: Share of frames in which left and right knee, ankle and foot, or elbow and wrist
            are taken for each other.
        swap: Share of joints hidden by another person and detected all the same that land on that person's joint.
        ghosts: Mean number of false persons in a view and frame, at fixed places in the image.
        ghost_joints: Share of a false person's joints that are reported.
        ghost_score: (a, b) of the Beta distribution of their confidence.
    """

    name: str = "clean"
    parts: PartsConfig = field(default_factory=PartsConfig)
    bias: float = 0.0
    correlation: float = 0.1
    guess_noise: float = 1.0
    guess_score: list[float] = field(default_factory=lambda: [1.0, 0.0])
    score_knows: float = 0.0
    least_score: float = 0.0
    bursts: list[float] = field(default_factory=lambda: [3.0, 0.4])
    together: float = 0.0
    person_miss: float = 0.0
    person_miss_hidden: float = 0.0
    leg_inversion: float = 0.0
    arm_inversion: float = 0.0
    swap: float = 0.0
    ghosts: float = 0.0
    ghost_joints: float = 0.45
    ghost_score: list[float] = field(default_factory=lambda: [5.0, 4.0])

    def __post_init__(self):
        for name in _SHARES:
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"detector.{name}: expected a share from 0 to 1, got {getattr(self, name)}")
        for name in ("correlation", "guess_noise", "ghosts"):
            if getattr(self, name) < 0:
                raise ValueError(f"detector.{name}: expected 0 or more, got {getattr(self, name)}")
        if len(self.bursts) != 2 or not min(self.bursts) > 0:
            raise ValueError(f"detector.bursts: expected two times above 0 s, got {list(self.bursts)}")


_SHARES = (
    "bias", "score_knows", "least_score", "together", "person_miss", "person_miss_hidden", "leg_inversion",
    "arm_inversion", "swap", "ghost_joints",
)  # fmt: skip
_LEGS = BODY25.index(*(f"{side}_{part}" for side in "lr" for part in ("knee", "ankle", "big_toe", "small_toe", "heel")))
_ARMS = BODY25.index("l_elbow", "l_wrist", "r_elbow", "r_wrist")
_WILDEST = 12.0
"""How many times wider than its scale the Gaussian under Student's t may get."""
_GHOST_DUTY = 0.2
"""Share of the frames in which a ghost shows."""
_GHOST_NOISE = 0.02
"""Scale of a ghost's trembling, as a fraction of its height."""


def _kind(joint: str) -> str:
    return joint.removeprefix("l_").removeprefix("r_")


def _limbs() -> np.ndarray:
    """(25,) which limb each joint is missed with: arms, legs and feet of either side, face, trunk."""
    limbs = {"elbow": "arm", "wrist": "arm", "knee": "leg", "ankle": "leg", "heel": "foot"}
    limbs |= {"big_toe": "foot", "small_toe": "foot", "nose": "face", "eye": "face", "ear": "face"}
    groups = []
    for joint in BODY25.joints:
        limb = limbs.get(_kind(joint), "trunk")
        groups.append(limb if limb in ("face", "trunk") else joint[0] + limb)
    return np.unique(groups, return_inverse=True)[1]


_LIMBS = _limbs()


class Seen(NamedTuple):
    """Detections in one view, of persons or of ghosts: (F, D, 25, 2) px and (F, D, 25), NaN where missed."""

    xy: np.ndarray
    score: np.ndarray


def see_persons(
    xy: np.ndarray,
    visibility: np.ndarray,
    hidden_by: np.ndarray,
    size: np.ndarray,
    fps: float,
    config: DetectorConfig,
    *,
    rng: np.random.Generator,
) -> Seen:
    """Detections of the persons of a clip as one view has them.

    Args:
        xy: (F, P, 25, 2) where the joints truly are, px.
        visibility: (F, P, 25) `Visibility`.
        hidden_by: (F, P, 25) index of the person or object in front.
        size: Image width and height, px.
    """
    # Every quantity is drawn for all joints, needed or not, so that no draw depends on another's outcome.
    parts = _parts(config)
    missed = _misses(visibility, fps, config, parts, rng=rng)
    guessed = (visibility != Visibility.VISIBLE) & (visibility <= Visibility.HIDDEN_BY_OBJECT)
    error, rank = _errors(visibility.shape, fps, config, parts, rng=rng)
    top, bottom = _extent(xy)
    height = (bottom - top).max(-1)[..., None, None]
    error *= height * np.where(guessed, config.guess_noise, 1)[..., None]
    score = _scores(rank, guessed, fps, config, parts, rng=rng)
    found = _swapped(xy, visibility, hidden_by, fps, config, rng=rng) + error
    score = np.where(missed, np.nan, score)
    for share, limb in ((config.leg_inversion, _LEGS), (config.arm_inversion, _ARMS)):
        inverted = in_bursts(share, unrest(visibility.shape[:2], fps, config.bursts, rng=rng))
        frame, person = np.nonzero(inverted)
        mirror = np.array(BODY25.mirror)[limb]
        for array in (found, score):
            array[frame[:, None], person[:, None], limb] = array[frame[:, None], person[:, None], mirror]
    return _reported(found, score, size, config)


def _parts(config: DetectorConfig) -> dict[str, np.ndarray]:
    """The fields of `PartConfig`, each (25, ...)."""
    parts = [getattr(config.parts, _kind(joint)) for joint in BODY25.joints]
    return {name: np.array([getattr(part, name) for part in parts]) for name in ("noise", "tail", "score", "miss")}


def _misses(visibility, fps, config, parts, *, rng) -> np.ndarray:
    """(F, P, 25) True for joints that are missed, alone, with their limb or with the whole person."""
    frames, persons, joints = visibility.shape
    limbs = unrest((frames, persons, _LIMBS.max() + 1), fps, config.bursts, rng=rng)[..., _LIMBS]
    alone = unrest(visibility.shape, fps, config.bursts, rng=rng)
    level = np.sqrt(config.together) * limbs + np.sqrt(1 - config.together) * alone
    outside = visibility > Visibility.HIDDEN_BY_OBJECT
    share = parts["miss"][np.arange(joints), np.where(outside, Visibility.VISIBLE, visibility)]
    # What hides half a limb makes the other half hard to tell.
    of_limb = np.stack([share[..., limb == _LIMBS].mean(-1) for limb in range(_LIMBS.max() + 1)], -1)[..., _LIMBS]
    certain = (share == 0) | (share == 1)
    missed = outside | in_bursts(np.where(certain, share, (share + of_limb) / 2), level)

    hidden = (visibility != Visibility.VISIBLE).mean(-1)
    growth = config.person_miss_hidden - config.person_miss
    whole = np.clip(config.person_miss + growth * hidden**3, 0, 1)
    return missed | in_bursts(whole, unrest((frames, persons), fps, config.bursts, rng=rng))[..., None]


def _swapped(xy, visibility, hidden_by, fps, config, *, rng) -> np.ndarray:
    """(F, P, 25, 2) where the joints are, some of those hidden by another person on that person's."""
    swapped = in_bursts(config.swap, unrest(visibility.shape, fps, config.bursts, rng=rng))
    frame, person, joint = np.nonzero(swapped & (visibility == Visibility.HIDDEN_BY_PERSON))
    places = xy.copy()
    places[frame, person, joint] = xy[frame, hidden_by[frame, person, joint], joint]
    return places


def _extent(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and greatest pixel (..., 2) of the joints (..., J, 2) in front of the camera; 0 where there are none."""
    known = np.isfinite(xy)
    any_known = known.any(-2)
    least = np.where(known, xy, np.inf).min(-2)
    greatest = np.where(known, xy, -np.inf).max(-2)
    return np.where(any_known, least, 0), np.where(any_known, greatest, 0)


def _errors(joints, fps, config, parts, *, rng) -> tuple[np.ndarray, np.ndarray]:
    """Errors (F, P, 25, 2) as fractions of a person's height, and the rank (F, P, 25) from 0 to 1 of their size.

    Student's t as a Gaussian of wandering variance (chi-square by its quantiles), the Gaussian with a constant part.
    """
    constant = rng.standard_normal((*joints[1:], 2))
    gaussian = np.sqrt(config.bias) * constant
    gaussian = gaussian + np.sqrt(1 - config.bias) * wander((*joints, 2), fps, config.correlation, rng=rng)
    tail = parts["tail"]
    precision = gammaincinv(tail / 2, ndtr(wander(joints, fps, config.correlation, rng=rng))) * 2 / tail
    t = gaussian * np.minimum(1 / np.sqrt(np.maximum(precision, 1e-9)), _WILDEST)[..., None]
    rank = 1 - (1 + (t**2).sum(-1) / tail) ** (-tail / 2)
    return t * parts["noise"][:, None], rank


def _scores(rank, guessed, fps, config, parts, *, rng) -> np.ndarray:
    """Confidences (F, P, 25), Beta distributed, lower where the error is greater."""
    luck = wander(rank.shape, fps, config.correlation, rng=rng)
    knowledge = -ndtri(np.clip(rank, 1e-9, 1 - 1e-9))
    level = config.score_knows * knowledge + np.sqrt(1 - config.score_knows**2) * luck
    shape = np.where(guessed[..., None], config.guess_score, parts["score"])
    return beta_quantile(shape, ndtr(level))


def see_ghosts(
    xyz: np.ndarray, size: np.ndarray, fps: float, config: DetectorConfig, *, rng: np.random.Generator
) -> Seen:
    """False persons at fixed places in an image of `size`: some joints of shapes of the true poses (F, P, 25, 3)."""
    poses = xyz[np.isfinite(xyz).all((2, 3))]
    places = rng.poisson(config.ghosts / _GHOST_DUTY) if len(poses) else 0
    frames, joints = len(xyz), (len(xyz), places, len(BODY25))
    pose = poses[rng.integers(len(poses), size=places)] if places else np.zeros((0, len(BODY25), 3))
    angle = rng.uniform(0, 2 * np.pi, (places, 1))
    shape = np.stack([pose[..., 0] * np.cos(angle) + pose[..., 1] * np.sin(angle), -pose[..., 2]], -1)
    low, high = _extent(shape)
    height = rng.uniform(0.2, 0.7, (places, 1, 1)) * size[1]
    middle = rng.uniform(0, 1, (places, 1, 2)) * (size - 1)
    still = (shape - (low + high)[:, None] / 2) / (high - low)[:, None, 1:] * height + middle
    xy = still + _GHOST_NOISE * height * wander((*joints, 2), fps, config.correlation, rng=rng)
    # Mostly the same joints of a ghost are seen, time and again.
    liking = rng.beta(config.ghost_joints, 1 - config.ghost_joints, (places, len(BODY25)))
    seen = in_bursts(liking, unrest(joints, fps, config.bursts, rng=rng))
    seen &= in_bursts(_GHOST_DUTY, unrest((frames, places), fps, config.bursts, rng=rng))[..., None]
    score = beta_quantile(np.array(config.ghost_score), rng.uniform(size=joints))
    return _reported(xy, np.where(seen, score, np.nan), size, config)


def _reported(xy: np.ndarray, score: np.ndarray, size: np.ndarray, config: DetectorConfig) -> Seen:
    """NaN both where either is, outside the image, and where the confidence is too low."""
    with np.errstate(invalid="ignore"):
        known = ((xy >= -0.5) & (xy <= size - 0.5)).all(-1) & (score >= config.least_score)
    return Seen(np.where(known[..., None], xy, np.nan), np.where(known, score, np.nan))
