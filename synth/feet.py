"""Keep feet from sliding when a path is bent or shifted: planted feet stay where they are, legs follow."""

import numpy as np
from scipy.spatial.transform import Rotation

from synth.body import ANKLE_HEIGHT, Body, segment_origins
from synth.motion import SEGMENTS
from synth.motion.rotations import aligned

_FEET = (SEGMENTS.index("l_foot"), SEGMENTS.index("r_foot"))
_LOW = 0.03
_SLOW = 0.35
"""A foot is planted where heel or toe is this near the floor, m, and no faster than this, m/s."""
# Heel and ball of the foot, fractions of stature.
_SOLE = np.array(((-0.037, 0, -ANKLE_HEIGHT), (0.085, 0, -ANKLE_HEIGHT)))


def planted(body: Body, root: np.ndarray, rotations: np.ndarray, fps: float, *, turn: float) -> np.ndarray:
    """When each foot stands.

    Args:
        body: Whose.
        root: (F, 3) hips, m.
        rotations: (F, 16, 3, 3) orientation of each of `SEGMENTS`.
        fps: Frames per second.
        turn: By which the motion has been bent, rad/s; the slip that this brings is not held against a foot.

    Returns:
        (F, 2) whether the left and the right foot are planted.
    """
    origins = segment_origins(body, root, rotations)
    standing = np.zeros((len(root), 2), bool)
    for side, foot in enumerate(_FEET):
        sole = origins[:, foot, None] + (rotations[:, foot, None] @ (_SOLE * body.stature)[..., None])[..., 0]
        velocity = np.gradient(sole, 1 / fps, axis=0)[..., :2] if len(root) > 1 else np.zeros((1, 2, 2))
        around = sole[..., :2] - root[:, None, :2]
        velocity -= turn * np.stack([-around[..., 1], around[..., 0]], -1)
        still = (np.linalg.norm(velocity, axis=-1) < _SLOW) & (sole[..., 2] < _LOW)
        standing[:, side] = still.any(1)
    return standing


def plant(body: Body, root: np.ndarray, rotations: np.ndarray, standing: np.ndarray) -> np.ndarray:
    """Orientations with which planted feet stay in place.

    While a foot stands, it keeps its heading, and the part of its sole that bears on the floor its place; what
    that takes away is made up for while the foot swings. Thigh and shin reach for the ankle by the law of cosines,
    the knee on the side where it was.

    Args:
        body: Whose.
        root: (F, 3) hips, m.
        rotations: (F, 16, 3, 3) orientation of each of `SEGMENTS`.
        standing: (F, 2) whether the left and the right foot are planted.

    Returns:
        (F, 16, 3, 3) with thighs, shins and feet changed.
    """
    rotations = rotations.copy()
    origins = segment_origins(body, root, rotations)
    for side, foot in enumerate(_FEET):
        thigh, shin = foot - 2, foot - 1
        heading = np.unwrap(np.arctan2(rotations[:, foot, 1, 0], rotations[:, foot, 0, 0]))
        turned = _undrift(heading[:, None], np.diff(heading)[:, None], standing[:, side])
        rotations[:, foot] = Rotation.from_rotvec(turned * (0.0, 0.0, 1.0)).as_matrix() @ rotations[:, foot]
        sole = origins[:, foot, None] + (rotations[:, foot, None] @ (_SOLE * body.stature)[..., None])[..., 0]
        # Heel and ball bear as much as they are near the floor.
        bearing = np.exp(-(sole[:-1, :, 2:] + sole[1:, :, 2:]) / 0.01)
        slip = (np.diff(sole[..., :2], axis=0) * bearing).sum(1) / bearing.sum(1)
        ankle = origins[:, foot].copy()
        ankle[:, :2] += _undrift(ankle[:, :2], slip, standing[:, side])
        rotations[:, thigh], rotations[:, shin] = _reach(
            origins[:, thigh],
            origins[:, shin],
            ankle,
            rotations[:, thigh],
            rotations[:, shin],
            float(np.linalg.norm(body.offsets[foot])),
        )
    return rotations


def _undrift(like: np.ndarray, slip: np.ndarray, standing: np.ndarray) -> np.ndarray:
    """(F, n) offsets that undo the slip (F - 1, n) of each stand, centred on zero over it, eased in between."""
    known = np.zeros(len(like), bool)
    offsets = np.zeros_like(like)
    frames = np.flatnonzero(standing)
    for run in np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1):
        if len(run) > 1:
            drift = np.concatenate([np.zeros((1, like.shape[1])), np.cumsum(slip[run[:-1]], axis=0)])
            offsets[run] = (drift.max(0) + drift.min(0)) / 2 - drift
            known[run] = True
    if known.any():
        at = np.flatnonzero(known)
        gap = np.searchsorted(at, np.arange(len(like)))
        before, after = at[np.maximum(gap - 1, 0)], at[np.minimum(gap, len(at) - 1)]
        share = np.clip((np.arange(len(like)) - before) / np.maximum(after - before, 1), 0, 1)[:, None]
        share = share * share * (3 - 2 * share)
        offsets = np.where(known[:, None], offsets, (1 - share) * offsets[before] + share * offsets[after])
    return offsets


def _reach(
    hip: np.ndarray, knee: np.ndarray, ankle: np.ndarray, thigh: np.ndarray, shin: np.ndarray, shin_length: float
) -> tuple[np.ndarray, np.ndarray]:
    """Thigh and shin orientations (F, 3, 3) that lead from the hip to an ankle (F, 3), the knee on its old side."""
    bone, reach = knee - hip, ankle - hip
    thigh_length = np.linalg.norm(bone, axis=1, keepdims=True)
    distance = np.linalg.norm(reach, axis=1, keepdims=True)
    along = reach / distance
    distance = np.clip(distance, abs(thigh_length - shin_length) + 0.01, 0.999 * (thigh_length + shin_length))
    # A stretched leg's knee has no side of its own: the front then counts.
    side = bone - (bone * along).sum(1, keepdims=True) * along + 0.05 * thigh[:, :, 0]
    side -= (side * along).sum(1, keepdims=True) * along
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    cosine = np.clip((thigh_length**2 + distance**2 - shin_length**2) / (2 * thigh_length * distance), -1, 1)
    bent = thigh_length * (cosine * along + np.sqrt(1 - cosine**2) * side)
    down = (0.0, 0.0, -1.0)
    return aligned(bent, thigh[:, :, 0], down), aligned(distance * along - bent, shin[:, :, 0], down)
