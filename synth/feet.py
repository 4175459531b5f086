"""Keep feet from sliding: they stand where they are or are on their way above the floor, and legs follow."""

import numpy as np
from scipy.ndimage import binary_closing, binary_opening, gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation

from synth.body import ANKLE_HEIGHT, Body, segment_origins
from synth.motion import SEGMENTS
from synth.motion.rotations import about, aligned

FEET = (SEGMENTS.index("l_foot"), SEGMENTS.index("r_foot"))
_STILL = ((0.03, 0.35), (0.06, 0.20))
"""A foot is planted where heel or tip is this near the floor, m, and no faster than this, m/s; one or the other."""
_BORNE = (0.04, 0.8)
"""The same for who would stand on no foot."""
_BRIEF = 0.08
"""Stands, and interruptions of stands, that are no longer than this are none, s."""
_STRETCH = 0.999
"""Length of the straightest leg, as a share of its bones."""
_CLEAR = 0.04
"""How high a foot is that is on its way while none stands, or flat beside one that does, m."""
SOLE = np.array(((-0.038, 0, -ANKLE_HEIGHT), (0.106, 0, -ANKLE_HEIGHT)))
"""Where a foot rolls forward and back: heel and tip, in its own frame, fractions of stature; as in `motion.legs`."""


def soles(body: Body, root: np.ndarray, rotations: np.ndarray, points: np.ndarray = SOLE) -> np.ndarray:
    """(F, 2, K, 3) where points (K, 3) on the mid line of the left and the right foot are in a pose, m.

    Args:
        body: Whose.
        root: (F, 3) hips, m.
        rotations: (F, 16, 3, 3) orientation of each of `SEGMENTS`.
        points: In the foot's frame, fractions of stature.
    """
    ankles = segment_origins(body, root, rotations)[:, FEET, None]
    return ankles + np.einsum("fsij,kj->fski", rotations[:, FEET], points * body.stature)


def planted(
    body: Body, root: np.ndarray, rotations: np.ndarray, fps: float, *, turn: float, recorded: bool = False
) -> np.ndarray:
    """When each foot stands.

    Args:
        body: Whose.
        root: (F, 3) hips, m.
        rotations: (F, 16, 3, 3) orientation of each of `SEGMENTS`.
        fps: Frames per second.
        turn: By which the motion has been bent, rad/s; the slip that this brings is not held against a foot.
        recorded: Whether somebody was recorded, whose weight may go to the other foot faster than frames follow.

    Returns:
        (F, 2) whether the left and the right foot are planted.
    """
    if len(root) == 1:
        return soles(body, root, rotations)[..., 2].min(2) < _STILL[0][0]
    sole = soles(body, root, rotations)
    around = sole[..., :2] - root[:, None, None, :2]
    carried = turn * np.stack([-around[..., 1], around[..., 0]], -1)
    speed = np.linalg.norm(np.diff(sole[..., :2], axis=0) * fps - (carried[1:] + carried[:-1]) / 2, axis=-1)
    height = np.maximum(sole[1:, ..., 2], sole[:-1, ..., 2])
    # From each frame to the next.
    holds = np.any([(height < low) & (speed < slow) for low, slow in _STILL], axis=0).any(2)
    brief = np.ones((1 + round(_BRIEF * fps), 1), bool)
    # Beyond its ends, a clip goes on as it begins and ends.
    padded = np.pad(holds, ((len(brief), len(brief)), (0, 0)), mode="edge")
    holds = binary_opening(binary_closing(padded, brief), brief)[len(brief) : -len(brief)]
    # Somebody near the floor is borne by the foot there that moves least.
    low, slow = _BORNE
    least = np.where(height < low, speed, np.inf).min(2)
    calmest = np.isfinite(least) & (least == least.min(1, keepdims=True))
    holds |= ~holds.any(1, keepdims=True) & (least < slow) & calmest
    if recorded:
        # Between two stands that follow each other at once there is no flight, but a foot that holds.
        held = np.pad(holds.any(1, keepdims=True), ((1, 1), (0, 0)))
        holds |= held[:-2] & ~held[1:-1] & held[2:] & calmest
    return np.pad(holds, ((1, 0), (0, 0))) | np.pad(holds, ((0, 1), (0, 0)))


def bearing(body: Body, root: np.ndarray, rotations: np.ndarray, standing: np.ndarray, fps: float) -> np.ndarray:
    """How much of the weight is on which foot; it goes over within some 0.1 s.

    Args:
        body: Whose.
        root: (F, 3) hips, m.
        rotations: (F, 16, 3, 3) orientation of each of `SEGMENTS`.
        standing: (F, 2) whether the left and the right foot are planted.
        fps: Frames per second.

    Returns:
        (F, 2) shares on the left and the right foot; they sum up to at most 1.
    """
    share = standing * np.exp(-soles(body, root, rotations)[..., 2].min(2).clip(0) / 0.01)
    share = gaussian_filter1d(share, 0.03 * fps, axis=0, mode="nearest")
    return share / np.maximum(share.sum(1, keepdims=True), 1)


def plant(
    body: Body,
    root: np.ndarray,
    rotations: np.ndarray,
    standing: np.ndarray,
    fps: float,
    *,
    recorded: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Hips and orientations with which planted feet stay in place.

    While a foot stands, it keeps its heading, and the part of its sole that bears on the floor its place on it; what
    that takes away is made up for while the foot swings. No foot is below the floor: where a tip or a heel would be,
    as are those of recordings, whose toes bend, the foot is turned about its ankle, and raised if that is not
    enough. Thigh and shin reach for the ankle by the law of cosines, the knee on the side where it was; hips sink
    where legs are too short for that.

    Args:
        body: Whose.
        root: (F, 3) hips, m.
        rotations: (F, 16, 3, 3) orientation of each of `SEGMENTS`.
        standing: (F, 2) whether the left and the right foot are planted.
        fps: Frames per second.
        recorded: Whether somebody was recorded, who may leap.

    Returns:
        root: (F, 3) with other heights.
        rotations: (F, 16, 3, 3) with thighs, shins and feet changed.
    """
    root, rotations = root.copy(), rotations.copy()
    origins = segment_origins(body, root, rotations)
    ankles = origins[:, FEET]
    for side, foot in enumerate(FEET):
        heading = np.unwrap(np.arctan2(rotations[:, foot, 1, 0], rotations[:, foot, 0, 0]))
        turned = _undrift(heading[:, None], np.diff(heading)[:, None], standing[:, side])
        rotations[:, foot] = Rotation.from_rotvec(turned * (0.0, 0.0, 1.0)).as_matrix() @ rotations[:, foot]
        rotations[:, foot] = _on_floor(rotations[:, foot], origins[:, foot, 2] / body.stature)
        sole = origins[:, foot, None] + (rotations[:, foot, None] @ (SOLE * body.stature)[..., None])[..., 0]
        # Heel and tip bear as much as they are near the floor.
        near = np.exp(-(sole[:-1, :, 2:] + sole[1:, :, 2:]) / 0.01)
        slip = (np.diff(sole[..., :2], axis=0) * near).sum(1) / near.sum(1)
        ankles[:, side, :2] += _undrift(ankles[:, side, :2], slip, standing[:, side])
        height, flat = sole[..., 2].min(1), sole[..., 2].max(1) < _CLEAR
        swings = ~standing[:, side]
        least = np.where(swings, np.where(flat | ~standing.any(1), _CLEAR, height.clip(0, _CLEAR)), 0)
        rise = np.maximum(_eased(-height[:, None], standing[:, side])[:, 0], least - height)
        # Who leaps has left the floor at once, and is on it all of a sudden.
        sharp = np.where(recorded & ~standing.any(1), least - height, -height)
        smooth = np.maximum(gaussian_filter1d(rise, 0.025 * fps, mode="nearest"), sharp)
        ankles[:, side, 2] += np.where(swings, smooth, rise)
    hips = origins[:, [foot - 2 for foot in FEET]]
    bones = np.linalg.norm(body.offsets[[FEET[0] - 1, FEET[0]]], axis=1)
    level = np.linalg.norm((hips - ankles)[..., :2], axis=-1)
    reach = np.sqrt(np.maximum((_STRETCH * bones.sum()) ** 2 - level**2, (_STRETCH * bones.sum() / 2) ** 2))
    missing = np.where(standing, hips[..., 2] - ankles[..., 2] - reach, 0).max(1).clip(0)
    sinking = gaussian_filter1d(maximum_filter1d(missing, 1 + 2 * round(0.1 * fps)), 0.05 * fps, mode="nearest")
    root[:, 2] -= sinking
    origins[..., 2] -= sinking[:, None]
    for side, foot in enumerate(FEET):
        thigh, shin = foot - 2, foot - 1
        rotations[:, thigh], rotations[:, shin] = _reach(
            origins[:, thigh], origins[:, shin], ankles[:, side], rotations[:, thigh], rotations[:, shin], bones[1]
        )
    return root, rotations


def _undrift(like: np.ndarray, slip: np.ndarray, standing: np.ndarray) -> np.ndarray:
    """(F, n) offsets that undo the slip (F - 1, n) of each stand, centred on zero over it, eased in between."""
    offsets = np.zeros_like(like)
    frames = np.flatnonzero(standing)
    for run in np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1):
        drift = np.concatenate([np.zeros((1, like.shape[1])), np.cumsum(slip[run[:-1]], axis=0)])
        offsets[run] = (drift.max(0) + drift.min(0)) / 2 - drift
    return _eased(offsets, standing)


def _eased(offsets: np.ndarray, known: np.ndarray) -> np.ndarray:
    """(F, n) offsets as they are where known, eased from one to the next in between; zero if none is known."""
    at = np.flatnonzero(known)
    if not len(at):
        return np.zeros_like(offsets)
    gap = np.searchsorted(at, np.arange(len(offsets)))
    before, after = at[np.maximum(gap - 1, 0)], at[np.minimum(gap, len(at) - 1)]
    share = np.clip((np.arange(len(offsets)) - before) / np.maximum(after - before, 1), 0, 1)[:, None]
    share = share * share * (3 - 2 * share)
    return np.where(known[:, None], offsets, (1 - share) * offsets[before] + share * offsets[after])


def _on_floor(feet: np.ndarray, ankles: np.ndarray) -> np.ndarray:
    """Feet (F, 3, 3) turned so far up or down that neither tip nor heel is below the floor, as far as that helps.

    Args:
        feet: Their orientations.
        ankles: (F,) height of the ankles, in statures.
    """
    down = np.arcsin(np.clip(-feet[:, 2, 0], -1, 1))
    least, most = (
        # Where heel and tip touch the floor, at a distance from the ankle and seen at an angle from it.
        sign
        * np.where(
            ankles < np.hypot(x, z), np.arcsin(np.clip(ankles / np.hypot(x, z), -1, 1)) + np.arctan2(z, abs(x)), np.pi
        )
        for sign, (x, _, z) in zip((-1, 1), SOLE, strict=True)
    )
    return feet @ about("y", np.clip(down, np.minimum(least, 0), np.maximum(most, 0)) - down)


def _reach(
    hip: np.ndarray, knee: np.ndarray, ankle: np.ndarray, thigh: np.ndarray, shin: np.ndarray, shin_length: float
) -> tuple[np.ndarray, np.ndarray]:
    """Thigh and shin orientations (F, 3, 3) that lead from the hip to an ankle (F, 3), the knee on its old side."""
    bone, reach = knee - hip, ankle - hip
    thigh_length = np.linalg.norm(bone, axis=1, keepdims=True)
    distance = np.linalg.norm(reach, axis=1, keepdims=True)
    along = reach / distance
    distance = np.clip(distance, abs(thigh_length - shin_length) + 0.01, _STRETCH * (thigh_length + shin_length))
    # A stretched leg's knee has no side of its own: the front then counts.
    side = bone - (bone * along).sum(1, keepdims=True) * along + 0.05 * thigh[:, :, 0]
    side -= (side * along).sum(1, keepdims=True) * along
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    cosine = np.clip((thigh_length**2 + distance**2 - shin_length**2) / (2 * thigh_length * distance), -1, 1)
    bent = thigh_length * (cosine * along + np.sqrt(1 - cosine**2) * side)
    down = (0.0, 0.0, -1.0)
    return aligned(bent, thigh[:, :, 0], down), aligned(distance * along - bent, shin[:, :, 0], down)
