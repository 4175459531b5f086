"""Detector errors by kind of joint of BODY25, and checks of their parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from math import inf

import numpy as np

from dmae.data.skeleton import BODY25
from dmae.data.typed import Configuration
from synth.checks import check_range


def check_beta(name: str, shape: Sequence[float]) -> None:
    """Raise ValueError if `shape` is not (a, b) of a Beta distribution. With b = 0 the value is always 1."""
    if len(shape) != 2 or not shape[0] > 0 or not shape[1] >= 0:
        raise ValueError(f"{name}: expected a > 0 and b >= 0 of a Beta distribution, found {list(shape)}")


# One configuration for each kind of joint


@dataclass(frozen=True)
class PartConfig(Configuration):
    """Errors of the detector on one kind of joint."""

    noise: float = 0.0
    """Fraction of the person's height in the image: scale of Student's t of a pixel coordinate's error, where the joint
    is visible."""
    tail: float = 30.0
    """Degrees of freedom of that distribution: 2 has a long tail, 30 is nearly Gaussian."""
    score: list[float] = field(default_factory=lambda: [1.0, 0.0])
    """(a, b) of the Beta distribution of the confidence of visible joints; (1, 0) is always 1."""
    score_correlation: float = 1.0
    """Factor of `scores.error_correlation` for this kind of joint."""
    miss: list[float] = field(default_factory=lambda: [0.0, 1.0, 1.0, 1.0])
    """Probabilities that the joint is missed: visible, hidden by the person itself, by another person, by an object.
    Probabilities other than 0 and 1 are averaged with the other joints of the limb, except in the face."""
    offset: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """Fractions: offset of the detected joint from its annotation, in the image. The first is outwards, relative to the
    distance to the same joint of the other side; the second is down the trunk, relative to the distance from neck to
    mid hip."""

    hidden_noise: float = 0.0
    """As `noise`, where the joint is hidden; 0 for `noise` times `noise.hidden` of the detector."""
    hidden_tail: float = 0.0
    """As `tail`, where the joint is hidden; 0 for `tail`."""
    hidden_score: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """As `score`, where the joint is hidden; [0, 0] for `scores.hidden` of the detector."""
    covered_noise: float = 0.0
    """As `hidden_noise`, where another person or an object hides the joint; 0 for `hidden_noise`."""
    covered_tail: float = 0.0
    """As `hidden_tail`, where another person or an object hides the joint; 0 for `hidden_tail`."""
    covered_score: list[float] = field(default_factory=lambda: [0.0, 0.0])
    """As `hidden_score`, where another person or an object hides the joint; [0, 0] for `hidden_score`."""

    def __post_init__(self):
        super().__post_init__()
        pairs = ("score", "offset", "hidden_score", "covered_score")
        for name, length in (*((name, 2) for name in pairs), ("miss", 4)):
            found = getattr(self, name)
            if len(found) != length:
                raise ValueError(f"detector part: expected {length} numbers of {name}, found {list(found)}")
        amounts = ("noise", "hidden_noise", "hidden_tail", "covered_noise", "covered_tail", "score_correlation")
        check_range("detector part", self, 0, inf, *amounts)
        check_range("detector part", self, 0, inf, "tail", above=True)
        if not all(0 <= miss <= 1 for miss in self.miss):
            raise ValueError(f"detector part.miss: expected probabilities from 0 to 1, found {list(self.miss)}")
        for name in ("score", "hidden_score", "covered_score"):
            if name == "score" or any(getattr(self, name)):
                check_beta(f"detector part: {name}", getattr(self, name))


@dataclass(frozen=True)
class PartsConfig(Configuration):
    """Errors of a detector on each kind of joint, left and right together."""

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


LEG_KINDS = ("knee", "ankle", "big_toe", "small_toe", "heel")


def kind_of(joint: str) -> str:
    """Return the name of a joint without its side."""
    return joint.removeprefix("l_").removeprefix("r_")


KINDS = np.array([kind_of(joint) for joint in BODY25.joints])
"""(25,) kind of each joint."""


def joint_groups(groups: dict[str, str], otherwise: str, *, sided: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Group joints by kind: (25,) True for the joints of each group.

    `groups` has the name of the group of each kind; all other kinds are in `otherwise`. Groups in `sided` are split
    into a left and a right one, `l_<name>` and `r_<name>`.
    """
    names = []
    for joint in BODY25.joints:
        group = groups.get(kind_of(joint), otherwise)
        names.append(joint[:2] + group if group in sided else group)
    return {name: np.array(names) == name for name in sorted(set(names))}


def by_joint(parts: PartsConfig) -> dict[str, np.ndarray]:
    """Return the fields of `PartConfig` as arrays, each (25, ...)."""
    found = [getattr(parts, kind_of(joint)) for joint in BODY25.joints]
    return {f.name: np.array([getattr(part, f.name) for part in found], float) for f in fields(PartConfig)}
