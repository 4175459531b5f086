"""The legs on which procedural motion is made, and how they reach the floor."""

import numpy as np

from synth.motion.rotations import aligned

HIP_HEIGHT = 0.9
_STATURE = HIP_HEIGHT / 0.530
# Lengths as shares of stature: Drillis and Contini (1966), in Winter, "Biomechanics and Motor Control of Human
# Movement" (4th ed., 2009), figure 4.1.
THIGH, SHIN, ANKLE = 0.245 * _STATURE, 0.246 * _STATURE, 0.039 * _STATURE
HALF_HIPS = 0.052 * _STATURE
# Where the sole ends behind the ankle, and where a foot without toe joints rolls forward, ahead of it: a quarter and
# seven tenths of its length.
HEEL, TIP = -0.25 * 0.152 * _STATURE, 0.70 * 0.152 * _STATURE
STRAIGHTEST = np.radians(4)
"""Least knee flexion, so that knees never lock and never bend backwards."""


def leg_length(knee: np.ndarray | float) -> np.ndarray:
    """Distance of the ankle from the hip, m, at a flexion of the knee, rad."""
    return np.sqrt(THIGH**2 + SHIN**2 + 2 * THIGH * SHIN * np.cos(knee))


REACH = float(leg_length(STRAIGHTEST))


def hips_of(root: np.ndarray, pelvis: np.ndarray) -> np.ndarray:
    """(F, 2, 3) left and right hip joints from root (F, 3) and pelvis orientation (F, 3, 3)."""
    return root[:, None] + np.stack([pelvis[..., 1], -pelvis[..., 1]], axis=1) * HALF_HIPS


def headroom(root: np.ndarray, pelvis: np.ndarray, ankles: np.ndarray) -> np.ndarray:
    """(F, 2) how much the root (F, 3) could rise until the left and the right leg are at their straightest, m."""
    hips = hips_of(root, pelvis)
    level = np.linalg.norm((hips - ankles)[..., :2], axis=-1)
    return ankles[..., 2] + np.sqrt(np.maximum(REACH**2 - level**2, 0)) - hips[..., 2]


def solve_legs(
    root: np.ndarray, pelvis: np.ndarray, ankles: np.ndarray, forward: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Thighs and shins that join the hips to the ankles, knees to the front.

    Args:
        root: (F, 3) mid point of the hips, m.
        pelvis: (F, 3, 3) its orientation.
        ankles: (F, 2, 3) left and right; where out of reach the leg is at its straightest, towards the ankle.
        forward: (F, 2, 3) the side to which each knee bends.

    Returns:
        (F, 2, 3, 3) orientations of left and right thigh, and of left and right shin.
    """
    hips = hips_of(root, pelvis)
    thighs, shins = np.empty((2, *forward.shape, 3))
    for leg in range(2):
        reach = ankles[:, leg] - hips[:, leg]
        distance = np.linalg.norm(reach, axis=1, keepdims=True)
        straight = aligned(reach, forward[:, leg], (0, 0, -1))
        # Law of cosines, at the hip.
        distance = np.minimum(distance, REACH)
        cosine = np.clip((THIGH**2 + distance**2 - SHIN**2) / (2 * THIGH * distance), -1, 1)
        knee = THIGH * (np.sqrt(1 - cosine**2) * straight[..., 0] - cosine * straight[..., 2])
        ankle = -distance * straight[..., 2]
        thighs[:, leg] = aligned(knee, straight[..., 0], (0, 0, -1))
        shins[:, leg] = aligned(ankle - knee, straight[..., 0], (0, 0, -1))
    return thighs, shins
