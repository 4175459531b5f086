"""Inversions: left limbs that are detected as right ones, and right as left."""

from dataclasses import dataclass, replace

import numpy as np

from dmae.data.labels import JointError
from dmae.data.skeleton import BODY25
from dmae.numerics.statistics import ar1_noise, bursts, multiscale_noise
from synth.detector.parts import LEG_KINDS, kind_of
from synth.detector.ranges import check_probabilities
from synth.detector.view import ErrorStream, View

_LEGS = [i for i, joint in enumerate(BODY25.joints) if kind_of(joint) in LEG_KINDS]
_SIDED = [i for i, partner in enumerate(BODY25.mirror) if partner != i]
_ARMS = BODY25.index("l_elbow", "l_wrist", "r_elbow", "r_wrist")


@dataclass(frozen=True)
class Inversions:
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
        check_probabilities("inversions", self, ("legs", "arms", "body"))
        if not 0 < self.seconds < float("inf"):
            raise ValueError(f"detector.inversions.seconds: expected a time above 0 s, got {self.seconds}")

    def apply(self, view: View) -> View:
        for probability, limbs, stream in (
            (self.legs, _LEGS, ErrorStream.LEG_INVERSION),
            (self.arms, _ARMS, ErrorStream.ARM_INVERSION),
        ):
            if probability:
                noise = multiscale_noise(view.score.shape[:2], view.fps, view.times.bursts, rng=view.random(stream))
                view = _inverted(view, bursts(probability, noise), limbs)
        if self.body:
            noise = ar1_noise(view.score.shape[:2], view.fps, self.seconds, rng=view.random(ErrorStream.BODY_INVERSION))
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
