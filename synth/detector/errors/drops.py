"""Drops: frames of a view that are lost."""

from dataclasses import dataclass, replace

import numpy as np

from dmae.numerics.statistics import ar1_noise, bursts
from synth.detector.ranges import check_probabilities
from synth.detector.view import ErrorStream, View


@dataclass(frozen=True)
class Drops:
    """Frames of a view that are lost."""

    probability: float = 0.0
    """Probability that a frame is lost, in bursts of the short time of `times.bursts`."""
    repeat: bool = False
    """Whether a lost frame repeats the detections of the previous frame."""

    def __post_init__(self):
        check_probabilities("drops", self, ("probability",))

    def apply(self, view: View) -> View:
        if not self.probability:
            return view
        noise = ar1_noise(view.shown.shape, view.fps, view.times.bursts[1], rng=view.random(ErrorStream.DROP))
        shown = np.where(bursts(self.probability, noise), -1, view.shown)
        return replace(view, shown=np.maximum.accumulate(shown) if self.repeat else shown)
