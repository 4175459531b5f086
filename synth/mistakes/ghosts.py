"""People whom a detector sees in furniture."""

import numpy as np

from dmae.clip import JointError
from dmae.skeleton import BODY25
from synth.chance import beta_quantile, in_bursts, unrest, wander
from synth.mistakes.config import DetectorConfig
from synth.mistakes.parts import Effect, Luck, Seen, extent

_DUTY = 0.2
"""Share of the frames in which a ghost shows."""
_NOISE = 0.02
"""Scale of a ghost's trembling, as a fraction of its height."""


def ghosts(xyz: np.ndarray, size: np.ndarray, fps: float, config: DetectorConfig, luck: Luck) -> Seen:
    """False persons at fixed places in an image of `size`: some joints of shapes of the true poses (F, P, 25, 3)."""
    rng = luck(Effect.GHOSTS)
    poses = xyz[np.isfinite(xyz).all((2, 3))]
    places = rng.poisson(config.ghosts / _DUTY) if config.ghosts and len(poses) else 0
    frames, joints = len(xyz), (len(xyz), places, len(BODY25))
    if not places:
        return _nobodys(np.zeros((*joints, 2)), np.zeros(joints))
    pose = poses[rng.integers(len(poses), size=places)]
    angle = rng.uniform(0, 2 * np.pi, (places, 1))
    shape = np.stack([pose[..., 0] * np.cos(angle) + pose[..., 1] * np.sin(angle), -pose[..., 2]], -1)
    low, high = extent(shape)
    height = rng.uniform(0.2, 0.7, (places, 1, 1)) * size[1]
    middle = rng.uniform(0, 1, (places, 1, 2)) * (size - 1)
    still = (shape - (low + high)[:, None] / 2) / (high - low)[:, None, 1:] * height + middle
    xy = still + _NOISE * height * wander((*joints, 2), fps, config.correlation, rng=rng)
    # Mostly the same joints of a ghost are seen, time and again.
    liking = rng.beta(config.ghost_joints, 1 - config.ghost_joints, (places, len(BODY25)))
    seen = in_bursts(liking, unrest(joints, fps, config.bursts, rng=rng))
    seen &= in_bursts(_DUTY, unrest((frames, places), fps, config.bursts, rng=rng))[..., None]
    score = beta_quantile(np.array(config.ghost_score), rng.uniform(size=joints))
    return _nobodys(xy, np.where(seen, score, np.nan))


def _nobodys(xy: np.ndarray, score: np.ndarray) -> Seen:
    return Seen(xy, score, np.full(score.shape, -1, np.int16), np.full(score.shape, JointError.GHOST, np.uint8))
