"""Confidences, which are only weakly correlated with errors. Joints with a low confidence are not reported."""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import ndtr, ndtri

from dmae.numerics.statistics import ar1_noise, beta_quantile
from synth.detector.ranges import check_beta, check_probabilities
from synth.detector.view import ErrorStream, View


@dataclass(frozen=True)
class Scores:
    """Confidences, Beta distributed. `parts.<kind>.score` is their distribution at visible joints."""

    hidden: list[float] = field(default_factory=lambda: [1.0, 0.0])
    """(a, b) of the Beta distribution of the confidence at hidden joints."""
    error_correlation: float = 0.0
    """Correlation, 0 to 1, between the ranks of a confidence and of a small error."""
    minimum: float = 0.0
    """Joints with less confidence are not reported."""

    def __post_init__(self):
        check_probabilities("scores", self, ("error_correlation", "minimum"))
        check_beta("detector.scores.hidden", self.hidden)

    def apply(self, view: View) -> View:
        """Draw confidences, which are lower for errors of higher rank, and drop joints that are not reported."""
        noise = ar1_noise(view.error_rank.shape, view.fps, view.times.correlation, rng=view.random(ErrorStream.SCORE))
        smallness = -ndtri(np.clip(view.error_rank, 1e-9, 1 - 1e-9))
        correlation = np.minimum(self.error_correlation * view.parts["score_correlation"], 1)
        level = correlation * smallness + np.sqrt(1 - correlation**2) * noise
        own = view.of_hidden("score")
        hidden = np.where(own.any(-1, keepdims=True), own, self.hidden)
        shape = np.where(view.hidden[..., None], hidden, view.parts["score"])
        return replace(view, score=beta_quantile(shape, ndtr(level))).reported()
