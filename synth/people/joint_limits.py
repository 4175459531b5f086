"""Limits of joint rotations, and the correction of motion that exceeds them."""

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation

from dmae.numerics.body import continuous
from synth.people.body import PARENTS, SEGMENTS, side_and_name

# Degrees about x, y and z of the parent's axes, on the left side. Active ranges of adults, after the American Academy
# of Orthopaedic Surgeons, "Joint Motion: Method of Measuring and Recording" (1965), and Boone and Azen, J. Bone Joint
# Surg. 61-A (1979); ranges are wider for joints that squats load, and for the hips and feet of dancers and fighters.
# They are also wider because a spine of two joints stands for one of many, and because recorded skeletons split
# rotations differently. The twist of an upper arm has no bounds: the same overhead pose differs by half a turn between
# an arm raised to the front and one raised to the side (Codman's paradox).
_RANGES = {
    "pelvis": ((-360, 360), (-360, 360), (-360, 360)),
    "spine": ((-40, 40), (-40, 75), (-45, 45)),
    "chest": ((-40, 40), (-40, 60), (-50, 50)),
    "head": ((-55, 55), (-80, 75), (-85, 85)),
    "upper_arm": ((-115, 110), (-180, 180), (-140, 95)),
    "forearm": ((-20, 20), (-100, 125), (-160, 8)),
    "hand": ((-85, 95), (-60, 60), (-60, 60)),
    "thigh": ((-45, 120), (-150, 60), (-80, 80)),
    "shin": ((-20, 20), (-8, 160), (-35, 35)),
    "foot": ((-45, 45), (-75, 90), (-60, 60)),
}
_PARTS = [side_and_name(name) for name in SEGMENTS]
_TWIST = np.array([1 if name in ("upper_arm", "forearm", "hand") else 2 for _, name in _PARTS])
ORDER = np.stack([0 * _TWIST, 1 + _TWIST, 1 + (_TWIST + 1) % 3, 1 + (_TWIST + 2) % 3])
"""(4, 16) components of each segment's quaternion: real, about its length, and the two that follow in cyclic order."""

_FASTEST = 25.0
"""Greatest speed of a joint from frame to frame, rad/s. In takes of CMU's runs, jumps, punches, salsa and kicks without
faults, trunks and legs stay below 21, except in one frame of a flying kick."""
_EASE = 0.12
"""Time before and after a jump of a joint over which its rotation is smoothed, s."""


def _sines() -> np.ndarray:
    ranges = np.array([_RANGES[name] for _, name in _PARTS], float)
    # A mirror reverses rotations about x and z.
    right = [side == "r" for side, _ in _PARTS]
    ranges[right] = np.where(np.array((True, False, True))[:, None], -ranges[right][..., ::-1], ranges[right])
    ordered = np.take_along_axis(ranges, (ORDER[1:] - 1).T[..., None], axis=1)
    return np.sin(np.radians(ordered) / 2).transpose(2, 1, 0)


LEAST, GREATEST = _sines()
LEAST[:, 0], GREATEST[:, 0] = -2, 2
"""(3, 16) least and greatest values of what `swing_twist` returns, for each segment in its parent."""
WIDEST = np.radians([min(np.abs(_RANGES[name]).max() + 15, 179) for _, name in _PARTS])
"""(16,) greatest rotation of each joint from the T-pose under any push, about any axis, rad; unused for the pelvis."""


def swing_twist(w: np.ndarray, twist: np.ndarray, one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, ...]:
    """Split a rotation into a twist about the segment's own length, and then a swing of the segment.

    Args:
        w, twist, one, other: Components of the rotation's quaternion in the order of `ORDER`.

    Returns:
        cosine, sine: Cosine and sine of half the twist, with the sign of the quaternion.
        turns: (3, ...) sine of half the twist, and sines of half the swing about the other two axes.
    """
    length = np.hypot(w, twist) + 1e-12
    cosine, sine = w / length, twist / length
    swing = cosine * one - sine * other, cosine * other + sine * one
    return cosine, sine, np.stack([np.copysign(sine, sine * w), *swing])


def limit_joints(rotations: np.ndarray, fps: float | None = None) -> tuple[np.ndarray, float]:
    """Return a motion within the limits of the joints. Segments below a limited joint move with it.

    A joint of a recording may still turn faster than human joints do, if the take jumps, or if another limit applies in
    the next frame (large rotations reach the same pose in several ways). Its rotation is then smoothed, within limits.

    Args:
        rotations: (F, ..., 16, 3, 3) world orientation of each of `SEGMENTS`.
        fps: Frames per second of a recording; None for procedural motion, which does not jump.

    Returns:
        rotations: The same, within limits.
        beyond: Share of all joints and frames that was outside the limits.
    """
    relative = rotations.copy()
    relative[..., 1:, :, :] = np.swapaxes(rotations[..., PARENTS[1:], :, :], -1, -2) @ rotations[..., 1:, :, :]
    quats = Rotation.from_matrix(relative.reshape(-1, 3, 3)).as_quat(scalar_first=True).reshape(*relative.shape[:-2], 4)
    turned, far = _limited(quats)
    relative[far], quats[far] = turned.as_matrix(), turned.as_quat(scalar_first=True)
    jumping = _find_jumps(quats, fps) if fps else np.zeros_like(far)
    if not far.any() and not jumping.any():
        return rotations, 0.0
    if fps and jumping.any():
        quats = _smoothed(quats, jumping, fps)
        turned, farther = _limited(quats)
        quats[farther] = turned.as_quat(scalar_first=True)
        relative[jumping] = Rotation.from_quat(quats[jumping], scalar_first=True).as_matrix()
    repaired = relative.copy()
    for segment, parent in enumerate(PARENTS[1:], start=1):
        repaired[..., segment, :, :] = repaired[..., parent, :, :] @ relative[..., segment, :, :]
    return repaired, float(far[..., 1:].mean())


def _limited(quats: np.ndarray) -> tuple[Rotation, np.ndarray]:
    """Return limited rotations for all `quats` (F, ..., 16, 4) beyond the limits, and their mask (F, ..., 16)."""
    each = np.arange(len(SEGMENTS))
    cosine, sine, turns = swing_twist(*(quats[..., each, order] for order in ORDER))
    least, greatest = (limit.reshape(3, *[1] * (quats.ndim - 2), -1) for limit in (LEAST, GREATEST))
    far = ((turns < least) | (turns > greatest)).any(0)
    # A twist beyond half a turn stays at the limit that it passed.
    angle = np.unwrap(2 * np.arctan2(sine, cosine), axis=0)
    angle -= 2 * np.pi * np.round(np.median(angle, axis=0) / (2 * np.pi))
    angle = angle.clip(*(2 * np.arcsin(limit[0].clip(-1, 1)) for limit in (least, greatest))) / 2
    turns = turns.clip(least, greatest)
    twist, swing = np.zeros_like(quats), np.zeros_like(quats)
    twist[..., each, ORDER[1]], twist[..., 0] = np.sin(angle), np.cos(angle)
    swing[..., each, ORDER[2]], swing[..., each, ORDER[3]] = turns[1:]
    swing[..., 0] = np.sqrt(np.maximum(1 - turns[1] ** 2 - turns[2] ** 2, 0))
    turned = Rotation.from_quat(swing[far], scalar_first=True) * Rotation.from_quat(twist[far], scalar_first=True)
    return turned, far


def _find_jumps(quats: np.ndarray, fps: float) -> np.ndarray:
    """Return the mask (F, ..., 16) of joints, with rotations (F, ..., 16, 4), that jump or are near a jump in time."""
    turn = 2 * np.arccos(np.abs((quats[1:] * quats[:-1]).sum(-1)).clip(0, 1))
    jumps = np.zeros(quats.shape[:-1], bool)
    jumps[1:] = turn * fps > _FASTEST
    jumps[:-1] |= jumps[1:]
    return maximum_filter1d(jumps, 1 + 2 * round(_EASE * fps), axis=0)


def _smoothed(quats: np.ndarray, jumping: np.ndarray, fps: float) -> np.ndarray:
    """Return rotations (F, ..., 16, 4), smoothed where a mask (F, ..., 16) is true, and less towards its edges."""
    quats = continuous(quats)
    blur = {"sigma": _EASE / 2 * fps, "axis": 0, "mode": "nearest"}
    share = np.where(jumping, gaussian_filter1d(jumping.astype(float), **blur), 0.0)[..., None]
    quats = quats + share * (gaussian_filter1d(quats, **blur) - quats)
    return quats / np.linalg.norm(quats, axis=-1, keepdims=True)
