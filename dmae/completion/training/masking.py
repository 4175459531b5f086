"""Masking: which known joints are hidden from the encoder in training: scattered, by frame, or limbs in bursts."""

from dataclasses import dataclass

import numpy as np

from dmae.data.skeleton import Skeleton

_LEG = ("knee", "ankle", "big_toe", "small_toe", "heel")
_PARTS = (
    *((f"{side}_wrist",) for side in "lr"),
    *((f"{side}_elbow", f"{side}_wrist") for side in "lr"),
    *((f"{side}_shoulder", f"{side}_elbow", f"{side}_wrist") for side in "lr"),
    *(tuple(f"{side}_{joint}" for joint in _LEG[1:]) for side in "lr"),
    *(tuple(f"{side}_{joint}" for joint in _LEG) for side in "lr"),
    ("nose", "l_eye", "r_eye", "l_ear", "r_ear", "head_top", "top_head", "bottom_head"),
    ("mid_hip", "l_hip", "r_hip"),
)
"""Joints that are masked together."""


@dataclass(frozen=True)
class MaskingConfig:
    """Which of the known joints are hidden from the encoder in training."""

    scattered: float = 0.05
    """Share of the recordings masked at random by joint and by frame, as in the paper; the others are masked in
    bursts."""
    joints: float = 0.5
    """Share of the joints masked in scattered masking."""
    frames: float = 0.5
    """Share of the frames masked whole in scattered masking."""
    bursts: float = 2.0
    """Bursts per second and person."""
    longest: int = 60
    """Frames at 25/s of the longest burst; lengths are log-uniform from 2."""
    absence: int = 15
    """Frames at 25/s of the longest burst in which the whole person is masked."""

    def __post_init__(self):
        for name in ("scattered", "joints", "frames"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"masking.{name}: expected a share between 0 and 1, found {getattr(self, name)}")
        if self.bursts < 0 or self.longest < 2 or self.absence < 2:
            raise ValueError(f"masking: expected bursts >= 0, longest >= 2 and absence >= 2, found {self}")


def mask(
    frames: int, persons: int, skeleton: Skeleton, fps: float, config: MaskingConfig, *, rng: np.random.Generator
) -> np.ndarray:
    """Return (F, P, J) True where a joint is masked: with probability `scattered` at random, else in bursts."""
    if rng.random() < config.scattered:
        return mask_scattered((frames, persons, len(skeleton)), config.joints, config.frames, rng=rng)
    return mask_bursts(frames, persons, skeleton, fps, config, rng=rng)


def mask_scattered(
    shape: tuple[int, int, int], joints: float, frames: float, *, rng: np.random.Generator
) -> np.ndarray:
    """Return (F, P, J) True for a share of the joints and, in addition, for all joints of a share of the frames."""
    return (rng.random(shape) < joints) | (rng.random((*shape[:2], 1)) < frames)


def mask_bursts(
    frames: int, persons: int, skeleton: Skeleton, fps: float, config: MaskingConfig, *, rng: np.random.Generator
) -> np.ndarray:
    """Return (F, P, J) True where body parts, and in one burst of forty whole persons, are masked for some frames."""
    masked = np.zeros((frames, persons, len(skeleton)), bool)
    parts = body_parts(skeleton)
    for person in range(persons):
        for _ in range(rng.poisson(config.bursts * frames / fps)):
            whole = rng.random() < 1 / 40
            longest = config.absence if whole else config.longest
            length = max(int(np.exp(rng.uniform(np.log(2), np.log(longest + 1))) * fps / 25), 1)
            start = int(rng.integers(1 - length, frames))
            joints = slice(None) if whole else parts[rng.integers(len(parts))]
            masked[max(start, 0) : start + length, person, joints] = True
    return masked


def body_parts(skeleton: Skeleton) -> list[list[int]]:
    """Return the joints that are masked together: those the skeleton has of each part, or each joint on its own."""
    short = [joint.rpartition(".")[2] for joint in skeleton.joints]
    parts = [[i for i, joint in enumerate(short) if joint in part] for part in _PARTS]
    return [part for part in parts if part] or [[i] for i in range(len(skeleton))]
