"""Ghosts: persons that a detector reports where there are none."""

from dataclasses import dataclass, field, replace

import numpy as np

from dmae.data.labels import JointError
from dmae.data.skeleton import BODY25
from dmae.numerics.statistics import ar1_noise, beta_quantile, bursts, multiscale_noise
from synth.detector.ranges import check_amounts, check_beta, check_probabilities
from synth.detector.view import ErrorStream, View, box

_DUTY = 0.2
"""Fraction of the frames in which a ghost is detected."""
_NOISE = 0.02
"""Scale of a ghost's noise, as a fraction of its height."""


@dataclass(frozen=True)
class Ghosts:
    """Persons that a detector sees where none are, at fixed places in the image. Their shapes are true poses."""

    count: float = 0.0
    """Mean number of ghosts in a view and frame."""
    joints: float = 0.45
    """Fraction of a ghost's joints that are reported."""
    score: list[float] = field(default_factory=lambda: [5.0, 4.0])
    """(a, b) of the Beta distribution of their confidence."""

    def __post_init__(self):
        check_amounts("ghosts", self, ("count",))
        check_probabilities("ghosts", self, ("joints",))
        check_beta("detector.ghosts.score", self.score)
        if self.count and not 0 < self.joints < 1:
            raise ValueError(f"detector.ghosts.joints: expected a number above 0 and below 1, got {self.joints}")

    def apply(self, view: View) -> View:
        rng = view.random(ErrorStream.GHOSTS)
        poses = view.xyz[np.isfinite(view.xyz).all((2, 3))]
        places = rng.poisson(self.count / _DUTY) if self.count and len(poses) else 0
        if not places:
            return view
        frames, joints = len(view.xyz), (len(view.xyz), places, len(BODY25))
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
        detected = bursts(probability, multiscale_noise(joints, view.fps, view.times.bursts, rng=rng))
        detected &= bursts(_DUTY, multiscale_noise((frames, places), view.fps, view.times.bursts, rng=rng))[..., None]
        score = beta_quantile(np.array(self.score), rng.uniform(size=joints))
        ghosts = replace(view, xy=xy, score=np.where(detected, score, np.nan)).reported()
        labels = np.full(joints, -1), np.full(joints, JointError.GHOST), np.full(places, -1)
        return view.added(ghosts.xy, ghosts.score, *labels)
