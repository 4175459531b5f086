"""Misses: joints, limbs and whole persons that are not detected."""

from dataclasses import dataclass

import numpy as np

from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from dmae.numerics.statistics import bursts, multiscale_noise
from synth.detector.parts import LEG_KINDS, joint_groups, kind_of
from synth.detector.ranges import check_amounts, check_probabilities
from synth.detector.view import ErrorStream, View

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
class Misses:
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
        names = ("limb_correlation", "neighbour_correlation", "person", "hidden_person", "lost_from")
        check_probabilities("misses", self, names)
        check_amounts("misses", self, ("steepness", "trunk_weight"))
        if not self.lost_from > 0:
            raise ValueError(f"detector.misses.lost_from: expected a number above 0, got {self.lost_from}")

    def apply(self, view: View) -> View:
        missed = self._joints_and_limbs(view)
        persons = view.visibility.shape[:2]
        if self.neighbour_correlation:
            rng = view.random(ErrorStream.NEIGHBOUR_MISS)
            noise = multiscale_noise((*persons, len(_OUTER_AND_INNER)), view.fps, view.times.bursts, rng=rng)
            torn = bursts(self.neighbour_correlation, noise)
            for i, (outer, inner) in enumerate(_OUTER_AND_INNER):
                lost = missed[..., BODY25.index(*inner)].all(-1) & torn[..., i]
                missed[..., BODY25.index(*outer)] |= lost[..., None]
        if self.person or self.hidden_person:
            noise = multiscale_noise(persons, view.fps, view.times.bursts, rng=view.random(ErrorStream.PERSON_MISS))
            missed |= bursts(self.person_probability(view.visibility != Visibility.VISIBLE), noise)[..., None]
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
        """Return the probability (...) that a person is not detected at all.

        Args:
            hidden: (..., 25) True for joints that are hidden or outside the image.
        """
        weight = np.where(_OF_LIMBS, 1.0, self.trunk_weight)
        share = (hidden * weight).sum(-1) / weight.sum()
        return (
            self.person + (self.hidden_person - self.person) * np.minimum(share / self.lost_from, 1) ** self.steepness
        )

    def _joints_and_limbs(self, view: View) -> np.ndarray:
        rng = view.random(ErrorStream.MISS)
        of_limbs = multiscale_noise((*view.visibility.shape[:2], len(_LIMBS)), view.fps, view.times.bursts, rng=rng)[
            ..., _LIMB
        ]
        of_joints = multiscale_noise(view.visibility.shape, view.fps, view.times.bursts, rng=rng)
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
