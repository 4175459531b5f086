"""Rotation matrices, easing curves, and the inverse kinematics of arms and legs."""

import numpy as np
from scipy.spatial.transform import Rotation

from synth.people.body import SEGMENTS, SIDES, Body

UPRIGHT = {
    "x": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "y": np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    "z": np.eye(3),
}
"""For each axis that may point up in a source world, the (3, 3) rotation from that world to a world with z up."""


def about(axis: str, angle: np.ndarray | float) -> np.ndarray:
    """Return rotations (..., 3, 3) by angles (...), rad, about axis x, y or z."""
    angle = np.asarray(angle, np.float64)
    return Rotation.from_euler(axis, angle.reshape(-1, 1)).as_matrix().reshape(*angle.shape, 3, 3)


def aligned(along: np.ndarray, forward: np.ndarray, axis: tuple[float, float, float]) -> np.ndarray:
    """Return rotations (F, 3, 3) that turn `axis`, a unit vector orthogonal to x, to directions `along` (F, 3), and x
    as close as possible to `forward` (F, 3). Both may have any length, and are not parallel."""
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    forward = forward - (forward * along).sum(1, keepdims=True) * along
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    canonical = np.stack([axis, (1, 0, 0), np.cross(axis, (1, 0, 0))])
    return np.stack([along, forward, np.cross(along, forward)], axis=2) @ canonical


def slerp(first: np.ndarray, last: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return rotations (n, S, 3, 3) on the shortest way from `first` to `last`, (n, S, 3, 3) or (S, 3, 3), at shares
    (n,) of it."""
    turn = Rotation.from_matrix((first.swapaxes(-1, -2) @ last).reshape(-1, 3, 3)).as_rotvec()
    turn = turn.reshape(-1, first.shape[-3], 3) * share[:, None, None]
    return first @ Rotation.from_rotvec(turn.reshape(-1, 3)).as_matrix().reshape(*turn.shape, 3)


def forwards(heading: np.ndarray | float) -> np.ndarray:
    """Return the direction (..., 2) on the floor of headings (...), rad."""
    return np.stack([np.cos(heading), np.sin(heading)], -1)


def leftwards(heading: np.ndarray | float) -> np.ndarray:
    """Return the direction (..., 2) on the floor to the left of headings (...), rad."""
    return np.stack([-np.sin(heading), np.cos(heading)], -1)


# Easing curves from 0 to 1


def smoothstep(x: np.ndarray | float) -> np.ndarray:
    """Return the cubic 3 x^2 - 2 x^3, clamped to 0 below x = 0 and to 1 above x = 1; zero slope at both ends."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def minimum_jerk(x: np.ndarray | float) -> np.ndarray:
    """Return the quintic 10 x^3 - 15 x^4 + 6 x^5, clamped to 0 below x = 0 and to 1 above x = 1.

    Hands that move from rest to rest follow this curve: Flash and Hogan, Journal of Neuroscience 5 (1985).
    """
    x = np.clip(x, 0, 1)
    return x**3 * (10 - 15 * x + 6 * x**2)


# Two bones with a hinge between them

PALM = np.array((0.0, 0.050, -0.013))
"""(3,) point on the skin of the left palm, with normal -z, in the hand's frame; fractions of stature."""
_WRIST = 1.0
"""Greatest bend of the wrist to lay the palm on the touched surface, rad."""
_BENT, _STRAIGHT = 0.35, 0.995
"""Least and greatest distance between the ends of a limb, as fractions of the total length of its two bones."""


def two_bone_ik(start: np.ndarray, end: np.ndarray, lengths: tuple[float, float], side: np.ndarray) -> np.ndarray:
    """Return the middle joint and the tip of a limb, (F, 2, 3) m, by the law of cosines.

    Args:
        start: (F, 3) root of the limb, m.
        end: (F, 3) target of the tip, m. If the target is out of reach, the limb points towards it.
        lengths: Lengths of both bones, m.
        side: (F, 3) direction in which the middle joint bends; not parallel to the limb.
    """
    upper, lower = lengths
    reach = end - start
    distance = np.linalg.norm(reach, axis=1, keepdims=True)
    along = reach / np.maximum(distance, 1e-9)
    distance = np.clip(distance, _BENT * (upper + lower), _STRAIGHT * (upper + lower))
    side = side - (side * along).sum(1, keepdims=True) * along
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-9)
    cosine = np.clip((upper**2 + distance**2 - lower**2) / (2 * upper * distance), -1, 1)
    middle = start + upper * (cosine * along + np.sqrt(1 - cosine**2) * side)
    return np.stack([middle, start + distance * along], axis=1)


def reach_with_arm(
    body: Body,
    side: str,
    chest: np.ndarray,
    shoulder: np.ndarray,
    palm: np.ndarray,
    normal: np.ndarray,
    elbow: tuple[float, float, float],
    *,
    straight: bool = False,
) -> np.ndarray:
    """Return orientations (F, 3, 3, 3) of upper arm, forearm and hand with the palm at a point. The wrist bends so that
    the palm lies flat there, unless it is `straight`, as in a punch.

    Args:
        chest: (F, 3, 3) orientation of the chest.
        shoulder: (F, 3) shoulder of that side, m.
        palm: (F, 3) target of the skin of the palm, m.
        normal: (F, 3) direction in which the palm faces, as far as the direction of the forearm allows.
        elbow: Direction in which the elbow bends, in the chest's frame, y outward; not towards the palm.
    """
    sign = SIDES[side]
    above, below = (
        float(np.linalg.norm(body.offsets[SEGMENTS.index(f"{side}_{part}")])) for part in ("forearm", "hand")
    )
    offset = PALM * (1, sign * body.arms, 1) * body.stature
    outward = chest @ (np.array(elbow) * (1, sign, 1))
    along = palm - shoulder
    for _ in range(6):
        forearm = _with_palm(along, normal, sign)
        hand = forearm if straight else _flexed(forearm, normal)
        joint, tip = np.swapaxes(two_bone_ik(shoulder, palm - hand @ offset, (above, below), outward), 0, 1)
        along = tip - joint
    forearm = _with_palm(along, normal, sign)
    hand = forearm if straight else _flexed(forearm, normal)
    upper = aligned(joint - shoulder, along, (0, sign, 0))
    return np.stack([upper, forearm, hand], axis=1)


def _flexed(forearm: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return hands (F, 3, 3), bent at the wrist from forearms (F, 3, 3) so that the palm, -z, faces `normal`."""
    ahead, back = (-(normal * forearm[:, :, axis]).sum(1) for axis in (1, 2))
    return forearm @ about("x", np.clip(np.arctan2(-ahead, np.maximum(back, 1e-6)), -_WRIST, _WRIST))


def _with_palm(along: np.ndarray, normal: np.ndarray, sign: float) -> np.ndarray:
    """Return hands (F, 3, 3) along `along` (F, 3), with palms that face `normal` (F, 3) as closely as possible."""
    along = along / np.linalg.norm(along, axis=1, keepdims=True)
    up = (normal * along).sum(1, keepdims=True) * along - normal
    # If the hand points in the direction that the palm should face, the palm is turned down.
    up = np.where(np.linalg.norm(up, axis=1, keepdims=True) < 1e-3, np.array((0.0, 0.0, 1.0)) + 1e-3, up)
    return aligned(along, np.cross(sign * along, up), (0, sign, 0))
