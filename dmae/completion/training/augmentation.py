"""Augmentation: pairs of poses varied in speed, direction, heading, side and size; and noise for true poses."""

from dataclasses import dataclass

import numpy as np

from dmae.completion.training.pose_pairs import PosePair
from dmae.data.clip import Poses3D
from dmae.numerics.body import rotate_z
from dmae.numerics.filling import resample
from dmae.numerics.statistics import ar1_filter

_CORRELATION = 0.75
"""Of errors in neighbouring frames at 25 frames/s, about as those of OpenPose."""


@dataclass(frozen=True)
class AugmentConfig:
    """How recordings are varied each time they are drawn."""

    rotation: float = 3.141592653589793
    """rad; each person is rotated about the vertical by up to this much either way."""
    mirror: float = 0.5
    """Share of the persons with left and right swapped."""
    reverse: float = 0.5
    """Share of the recordings that run backwards."""
    scale: float = 0.1
    """Standard deviation of the logarithm of a person's size."""
    speed: float = 0.2
    """The logarithm of a recording's speed is uniform within this much either way."""
    true_poses: float = 0.3
    """Share of the draws of a captured recording that give its truth instead; else the network gives too little weight
    to joints next to a gap."""
    noise: float = 0.0
    """m; observed joints of true poses have errors with a standard deviation that is, by person, uniform up to this."""


def augment(pair: PosePair, config: AugmentConfig, fps: float, *, rng: np.random.Generator) -> PosePair:
    """Return a pair at another speed, perhaps backwards; its persons rotated, mirrored and scaled.

    Args:
        fps: Frames per second of the poses, and of those returned.
    """
    speed, backwards = np.exp(rng.uniform(-config.speed, config.speed)), rng.random() < config.reverse
    persons = pair.truth.xyz.shape[1]
    mirrored = rng.random(persons) < config.mirror
    size = np.exp(rng.normal(0, config.scale, (persons, 1, 1)))
    angle = rng.uniform(-config.rotation, config.rotation, (persons, 1))

    def varied(poses: Poses3D) -> Poses3D:
        new = resample(poses, fps, fps * speed)

        def move(points: np.ndarray, size: np.ndarray) -> np.ndarray:
            points = points.astype(np.float64)[:: -1 if backwards else 1]
            swapped = points[:, :, list(poses.skeleton.mirror)] * (1, -1, 1)
            return rotate_z(np.where(mirrored[:, None, None], swapped, points) * size, angle)

        rays = np.stack([move(new.rays[..., 0, :], size), move(new.rays[..., 1, :], 1)], -2)
        return Poses3D(poses.skeleton, move(new.xyz, size), rays=rays)

    return PosePair(varied(pair.truth), pair.captured and varied(pair.captured))


def with_noise(truth: Poses3D, deviation: float, *, rng: np.random.Generator) -> Poses3D:
    """Return true poses with correlated errors: stationary AR(1) noise.

    Args:
        deviation: m; a person's standard deviation is uniform up to this.
    """
    deviations = rng.uniform(0, deviation, (truth.xyz.shape[1], 1, 1))
    noise = ar1_filter(rng.normal(size=truth.xyz.shape), _CORRELATION)
    return Poses3D(truth.skeleton, truth.xyz + deviations * noise)
