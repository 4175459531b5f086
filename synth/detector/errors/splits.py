"""Splits: one person that becomes two detections."""

from dataclasses import dataclass

import numpy as np

from dmae.data.skeleton import BODY25
from dmae.numerics.statistics import bursts, multiscale_noise
from synth.detector.parts import LEG_KINDS, kind_of
from synth.detector.ranges import check_probabilities
from synth.detector.view import ErrorStream, View

_LOWER = np.array([kind_of(joint) in (*LEG_KINDS, "hip", "mid_hip") for joint in BODY25.joints])
_LEFT = np.array([joint.startswith("l_") for joint in BODY25.joints])


@dataclass(frozen=True)
class Splits:
    """One person that becomes two detections: upper and lower part, or left and right."""

    probability: float = 0.0
    """Probability that a person is split in a frame."""

    def __post_init__(self):
        check_probabilities("splits", self, ("probability",))

    def apply(self, view: View) -> View:
        if not self.probability:
            return view
        persons = view.score.shape[:2]
        noise = multiscale_noise((*persons, 2), view.fps, view.times.bursts, rng=view.random(ErrorStream.SPLIT))
        event = bursts(self.probability, noise[..., 0])
        off = event[..., None] & np.where(noise[..., 1, None] < 0, _LOWER, _LEFT)
        piece = view.without(~off)
        return view.without(off).added(piece.xy, piece.score, piece.owner, piece.kind, piece.person)
