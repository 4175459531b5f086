"""Errors of single joints: noise, confidences, misses, and left taken for right."""

from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from dmae.data.labels import JointError, Visibility
from dmae.data.skeleton import BODY25
from dmae.data.typed import Configuration
from dmae.numerics.noise import ar1_noise, beta_quantile, bursts, multiscale_noise
from synth.checks import check_range
from synth.detector.parts import LEG_KINDS, check_beta, joint_groups, kind_of
from synth.detector.view import ErrorStream, View, height

_MIRROR = list(BODY25.mirror)
_NECK, _MID_HIP = BODY25.index("neck", "mid_hip")
_SCALES = 3.0
"""Half of an error decorrelates slower than the given time by this factor, the other half faster by this factor."""
_MAX_WIDTH = 12.0
"""Greatest ratio of the width of the Gaussian under Student's t to its scale."""


@dataclass(frozen=True)
class Noise(Configuration):
    """Errors of the positions of detected joints. `parts.<kind>.noise`, `.tail` and `.offset` say how large they
    are."""

    view_offset: float = 0.0
    """Fraction of a person's height in the image: standard deviation of an offset of a joint in a view that is the same
    for all people."""
    bias: float = 0.0
    """Fraction of the error's energy that is constant for a person, view and joint; long tails dilute it."""
    minimum: float = 0.0
    """px; added in quadrature to the scale of errors, for people of any size."""
    blur: float = 0.0
    """Fraction of a joint's motion in the image from frame to frame, added in quadrature to the scale of errors."""
    truncation: float = 0.0
    """Growth of errors with the fraction of a person's joints that is outside the image: by a factor of
    1 + `truncation` * fraction."""
    hidden: float = 1.0
    """Factor of the error at hidden joints that are detected, relative to visible ones."""

    def __post_init__(self):
        super().__post_init__()
        check_range("detector.noise", self, 0, inf, "view_offset", "minimum", "blur", "truncation", "hidden")
        check_range("detector.noise", self, 0, 1, "bias")

    def apply(self, view: View) -> View:
        """Add offsets and noise to each joint.

        The noise has Student's t distribution: a Gaussian process with a constant part, scaled by a variance that is a
        random process as well (from quantiles of the chi-square distribution).
        """
        from scipy.special import gammaincinv, ndtr  # options are read without scipy

        joints, tail = view.visibility.shape, view.parts["tail"]
        hidden_tail = view.of_hidden("tail")
        tail = np.where(view.hidden & (hidden_tail > 0), hidden_tail, tail)
        rng = view.random(ErrorStream.NOISE)
        times = [view.times.correlation * _SCALES, view.times.correlation / _SCALES]
        gaussian = np.sqrt(1 - self.bias) * multiscale_noise((*joints, 2), view.fps, times, rng=rng)
        spread = ar1_noise(joints, view.fps, view.times.bursts[0], rng=rng)
        if self.bias:
            gaussian += np.sqrt(self.bias) * view.random(ErrorStream.BIAS).standard_normal((*joints[1:], 2))
        precision = gammaincinv(tail / 2, ndtr(spread)) * 2 / tail
        t = gaussian * np.minimum(1 / np.sqrt(np.maximum(precision, 1e-9)), _MAX_WIDTH)[..., None]
        rank = 1 - (1 + (t**2).sum(-1) / tail) ** (-tail / 2)
        offset = np.take_along_axis(self._offset(view), view.owner[..., None].astype(int), 1)
        return replace(view, xy=view.xy + offset + t * self._scale(view)[..., None], error_rank=rank)

    def _scale(self, view: View) -> np.ndarray:
        """Return (F, P, 25) scales of the noise, px, by kind of joint, size, motion, truncation and visibility."""
        xy = view.true_xy
        size = height(xy)[..., None]
        scale = view.parts["noise"] * size
        own = view.of_hidden("noise")
        scale = np.where(view.hidden & (own > 0), own * size, scale)
        factor = np.where(view.hidden & (own == 0), self.hidden, 1)
        if self.minimum:
            scale = np.hypot(scale, self.minimum)
        if self.blur and len(xy) > 1:
            scale = np.hypot(scale, self.blur * np.nan_to_num(np.linalg.norm(np.gradient(xy, axis=0), axis=-1)))
        if self.truncation:
            scale = scale * (1 + self.truncation * (~view.inside(xy)).mean(-1, keepdims=True))
        return scale * factor

    def _offset(self, view: View) -> np.ndarray:
        """Return (F, P, 25, 2) offsets from the annotated position of joints to the detector's position, px."""
        xy, offset = view.true_xy, view.parts["offset"]
        found = np.zeros(xy.shape)
        if offset.any():
            trunk = np.nan_to_num(xy[:, :, _MID_HIP] - xy[:, :, _NECK])[:, :, None]
            found = offset[:, :1] * np.nan_to_num(xy - xy[:, :, _MIRROR]) + offset[:, 1:] * trunk
        if self.view_offset:
            constant = self.view_offset * view.random(ErrorStream.OFFSET).standard_normal((len(BODY25), 2))
            found = found + constant * height(xy)[..., None, None]
        return found


# Confidences, which are only weakly correlated with errors. Joints with a low confidence are not reported.


@dataclass(frozen=True)
class Scores(Configuration):
    """Confidences, Beta distributed. `parts.<kind>.score` is their distribution at visible joints."""

    hidden: list[float] = field(default_factory=lambda: [1.0, 0.0])
    """(a, b) of the Beta distribution of the confidence at hidden joints."""
    error_correlation: float = 0.0
    """Correlation, 0 to 1, between the ranks of a confidence and of a small error."""
    minimum: float = 0.0
    """Joints with less confidence are not reported."""

    def __post_init__(self):
        super().__post_init__()
        check_range("detector.scores", self, 0, 1, "error_correlation", "minimum")
        check_beta("detector.scores.hidden", self.hidden)

    def apply(self, view: View) -> View:
        """Draw confidences, which are lower for errors of higher rank, and drop joints that are not reported."""
        from scipy.special import ndtr, ndtri

        noise = ar1_noise(view.error_rank.shape, view.fps, view.times.correlation, rng=view.random(ErrorStream.SCORE))
        smallness = -ndtri(np.clip(view.error_rank, 1e-9, 1 - 1e-9))
        correlation = np.minimum(self.error_correlation * view.parts["score_correlation"], 1)
        level = correlation * smallness + np.sqrt(1 - correlation**2) * noise
        own = view.of_hidden("score")
        hidden = np.where(own.any(-1, keepdims=True), own, self.hidden)
        shape = np.where(view.hidden[..., None], hidden, view.parts["score"])
        return replace(view, score=beta_quantile(shape, ndtr(level))).reported()


# Misses: joints, limbs and whole persons that are not detected

_LIMBS = np.array(
    list(
        joint_groups(
            {"elbow": "arm", "wrist": "arm", "knee": "leg", "ankle": "leg", "heel": "leg", "big_toe": "foot",
             "small_toe": "foot", "nose": "face", "eye": "face", "ear": "face"},
            "trunk",
            sided=("arm", "leg", "foot"),
        ).values()
    )
)  # fmt: skip
"""(limbs, 25) True for the joints of each limb."""
_LIMB = _LIMBS.argmax(0)
_IN_FACE = np.array([kind_of(joint) in ("nose", "eye", "ear") for joint in BODY25.joints])
_OF_LIMBS = np.array([kind_of(joint) in ("elbow", "wrist", *LEG_KINDS) for joint in BODY25.joints])
_OUTER_AND_INNER = tuple(
    (outer, inner)
    for side in ("l_", "r_")
    for outer, inner in (
        ([side + "wrist"], [side + "elbow"]),
        ([side + "ankle"], [side + "knee"]),
        ([side + "big_toe", side + "small_toe", side + "heel"], [side + "ankle"]),
        ([side + "eye"], ["nose"]),
        # OpenPose also joins ears to shoulders, so ears are found from behind.
        ([side + "ear"], [side + "eye", side + "shoulder"]),
    )
)
"""Joints that are missed with their inner neighbours, in this order."""


@dataclass(frozen=True)
class Misses(Configuration):
    """Joints, limbs and persons that are not detected. `parts.<kind>.miss` says how often a joint is missed."""

    limb_correlation: float = 0.0
    """Correlation of misses within an arm, a leg with its heel, the toes of a foot, the face and the trunk."""
    neighbour_correlation: float = 0.0
    """Probability that the outer neighbour of a missed joint is also missed, as with bottom-up detectors that join
    parts to people: wrists with elbows, ankles with knees, feet with ankles, eyes with the nose, ears with both eye and
    shoulder."""
    person: float = 0.0
    """Probability that a person in full view is not detected at all."""
    hidden_person: float = 0.0
    """Probability that a person who is completely hidden or outside the image is not detected at all. For partly hidden
    people the probability grows with the cube of the fraction of such joints."""
    lost_from: float = 1.0
    """Fraction of joints hidden or outside the image from which `hidden_person` applies."""
    steepness: float = 3.0
    """Power of that fraction with which the probability grows; 3 is its cube."""
    trunk_weight: float = 1.0
    """Weight of each joint of head and trunk in that fraction; joints of arms and legs have weight 1. A person with
    hidden legs is found more often than a person with a hidden trunk."""

    def __post_init__(self):
        super().__post_init__()
        names = ("limb_correlation", "neighbour_correlation", "person", "hidden_person")
        check_range("detector.misses", self, 0, 1, *names)
        check_range("detector.misses", self, 0, 1, "lost_from", above=True)
        check_range("detector.misses", self, 0, inf, "steepness", "trunk_weight")

    def apply(self, view: View) -> View:
        missed = self._joints_and_limbs(view)
        persons = view.visibility.shape[:2]
        if self.neighbour_correlation:
            limbs = (*persons, len(_OUTER_AND_INNER))
            torn = view.events(self.neighbour_correlation, limbs, ErrorStream.NEIGHBOUR_MISS)
            for i, (outer, inner) in enumerate(_OUTER_AND_INNER):
                lost = missed[..., BODY25.index(*inner)].all(-1) & torn[..., i]
                missed[..., BODY25.index(*outer)] |= lost[..., None]
        if self.person or self.hidden_person:
            probability = self.person_probability(view.visibility != Visibility.VISIBLE)
            missed |= view.events(probability, persons, ErrorStream.PERSON_MISS)[..., None]
        return view.without(missed)

    def probability(self, view: View) -> np.ndarray:
        """Return the marginal probability (F, P, 25) that each joint is missed.

        For joints that are missed with their inner neighbours it is an estimate. It interpolates, by the correlation
        within a limb, between independent misses and misses that overlap as much as possible.
        """
        outside, missed = self._joint_probability(view)
        missed = np.where(outside, 1.0, missed)
        for outer, inner in _OUTER_AND_INNER:
            inner_missed = missed[..., BODY25.index(*inner)].min(-1, keepdims=True)
            own = missed[..., BODY25.index(*outer)]
            within, apart = np.maximum(inner_missed - own, 0), inner_missed * (1 - own)
            alone = self.limb_correlation * within + (1 - self.limb_correlation) * apart
            missed[..., BODY25.index(*outer)] = own + self.neighbour_correlation * alone
        person = self.person_probability(view.visibility != Visibility.VISIBLE)
        return 1 - (1 - missed) * (1 - person[..., None])

    def person_probability(self, hidden: np.ndarray) -> np.ndarray:
        """Return the probability (...) that a person is not detected, by the joints (..., 25) that are not seen."""
        weight = np.where(_OF_LIMBS, 1.0, self.trunk_weight)
        share = (hidden * weight).sum(-1) / weight.sum()
        return (
            self.person + (self.hidden_person - self.person) * np.minimum(share / self.lost_from, 1) ** self.steepness
        )

    def _joints_and_limbs(self, view: View) -> np.ndarray:
        rng = view.random(ErrorStream.MISS)
        of_limbs = view.noise((*view.visibility.shape[:2], len(_LIMBS)), rng=rng)[..., _LIMB]
        of_joints = view.noise(view.visibility.shape, rng=rng)
        noise = np.sqrt(self.limb_correlation) * of_limbs + np.sqrt(1 - self.limb_correlation) * of_joints
        outside, probability = self._joint_probability(view)
        return outside | bursts(probability, noise)

    def _joint_probability(self, view: View) -> tuple[np.ndarray, np.ndarray]:
        """Return where joints are outside the image, and the probabilities that they are missed, (F, P, 25) each."""
        joints = view.visibility.shape[-1]
        outside = view.visibility > Visibility.HIDDEN_BY_OBJECT
        code = np.where(outside, Visibility.VISIBLE, view.visibility)
        probability = view.parts["miss"][np.arange(joints), code]
        # If half a limb is hidden, the other half is harder to detect. Half a face is detected as well as a whole one.
        # Joints that the detector never reports say nothing about their limb.
        limbs = _LIMBS & (view.parts["miss"].min(-1) < 1)
        of_limb = np.stack([probability[..., limb].sum(-1) / max(limb.sum(), 1) for limb in limbs], -1)[..., _LIMB]
        alone = (probability == 0) | (probability == 1) | _IN_FACE
        return outside, np.where(alone, probability, (probability + of_limb) / 2)


# Inversions: left limbs that are detected as right ones, and right as left

_LEGS = [i for i, joint in enumerate(BODY25.joints) if kind_of(joint) in LEG_KINDS]
_SIDED = [i for i, partner in enumerate(BODY25.mirror) if partner != i]
_ARMS = BODY25.index("l_elbow", "l_wrist", "r_elbow", "r_wrist")


@dataclass(frozen=True)
class Inversions(Configuration):
    """Left limbs that are detected as right ones, and right as left."""

    legs: float = 0.0
    """Probability that knees, ankles and feet of a person are inverted in a frame."""
    arms: float = 0.0
    """Probability that elbows and wrists of a person are inverted in a frame."""
    body: float = 0.0
    """Probability that all joints of a person are inverted in a frame, as for a person mistaken for one seen from
    behind."""
    seconds: float = 1.0
    """s; correlation time of `body`: the duration for which sides stay exchanged."""

    def __post_init__(self):
        super().__post_init__()
        check_range("detector.inversions", self, 0, 1, "legs", "arms", "body")
        check_range("detector.inversions", self, 0, inf, "seconds", above=True, unit=" s")

    def apply(self, view: View) -> View:
        persons = view.score.shape[:2]
        for probability, limbs, stream in (
            (self.legs, _LEGS, ErrorStream.LEG_INVERSION),
            (self.arms, _ARMS, ErrorStream.ARM_INVERSION),
        ):
            if probability:
                view = _inverted(view, view.events(probability, persons, stream), limbs)
        if self.body:
            noise = ar1_noise(persons, view.fps, self.seconds, rng=view.random(ErrorStream.BODY_INVERSION))
            view = _inverted(view, bursts(self.body, noise), _SIDED)
        return view


def _inverted(view: View, where: np.ndarray, limbs: list[int]) -> View:
    """Return the view with the left and right joints of `limbs` exchanged where `where` (F, D) is True."""
    frame, person = (index[:, None] for index in np.nonzero(where))
    mirror = np.array(BODY25.mirror)[limbs]
    arrays = {name: getattr(view, name).copy() for name in ("xy", "score", "owner", "kind")}
    for array in arrays.values():
        array[frame, person, limbs] = array[frame, person, mirror]
    arrays["kind"][frame, person, limbs] = JointError.INVERTED
    return replace(view, **arrays)
