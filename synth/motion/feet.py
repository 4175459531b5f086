"""Foot contacts: detect when each foot stands, hold standing feet in place, and share the weight between them."""

import numpy as np
from scipy.ndimage import binary_closing, binary_opening, gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation

from synth.motion.easing import smoothstep
from synth.motion.rotations import about, aligned
from synth.people.body import ANKLE_HEIGHT, Body, segment_origins
from synth.people.segments import SEGMENTS

FEET = (SEGMENTS.index("l_foot"), SEGMENTS.index("r_foot"))
"""Indices of the left and the right foot in `SEGMENTS`."""
_STILL = ((0.03, 0.35), (0.06, 0.20))
"""Greatest height, m, and greatest speed, m/s, of the heel or tip of a foot that stands; either pair suffices."""
_BORNE = (0.04, 0.8)
"""The same limits for the slower foot while no foot stands according to `_STILL`."""
_BRIEF = 0.08
"""Contacts, and interruptions of contacts, that last no longer than this are ignored, s."""
_STRETCH = 0.999
"""Greatest length of a leg as a fraction of the total length of its bones."""
_CLEAR = 0.04
"""Least height of a swinging foot while no foot stands, or while it is flat and the other foot stands, m."""
SOLE = np.array(((-0.038, 0, -ANKLE_HEIGHT), (0.106, 0, -ANKLE_HEIGHT)))
"""(2, 3) heel, and the tip over which a foot rolls forward, in the foot's frame, fractions of stature; as in `legs`."""


def sole_points(body: Body, root: np.ndarray, rotations: np.ndarray, points: np.ndarray = SOLE) -> np.ndarray:
    """Return points on the soles, (F, 2, K, 3) m, of the left and the right foot.

    Args:
        body: The body.
        root: (F, 3) mid hip, m.
        rotations: (F, 16, 3, 3) world orientation of each of `SEGMENTS`.
        points: (K, 3) points in the foot's frame, fractions of stature.
    """
    ankles = segment_origins(body, root, rotations)[:, FEET, None]
    return ankles + np.einsum("fsij,kj->fski", rotations[:, FEET], points * body.stature)


def foot_contacts(
    body: Body, root: np.ndarray, rotations: np.ndarray, fps: float, *, turn: float, recorded: bool = False
) -> np.ndarray:
    """Detect when each foot stands on the floor.

    Args:
        body: The body.
        root: (F, 3) mid hip, m.
        rotations: (F, 16, 3, 3) world orientation of each of `SEGMENTS`.
        fps: Frames per second.
        turn: Rate at which the motion has been bent, rad/s; the slip of feet that this causes is allowed.
        recorded: Whether the motion was recorded. Recorded people may shift their weight between frames.

    Returns:
        (F, 2) True where the left and the right foot stand.
    """
    if len(root) == 1:
        return sole_points(body, root, rotations)[..., 2].min(2) < _STILL[0][0]
    sole = sole_points(body, root, rotations)
    from_root = sole[..., :2] - root[:, None, None, :2]
    bent = turn * np.stack([-from_root[..., 1], from_root[..., 0]], -1)
    speed = np.linalg.norm(np.diff(sole[..., :2], axis=0) * fps - (bent[1:] + bent[:-1]) / 2, axis=-1)
    height = np.maximum(sole[1:, ..., 2], sole[:-1, ..., 2])
    # Contacts in each interval between two frames.
    holds = np.any([(height < low) & (speed < slow) for low, slow in _STILL], axis=0).any(2)
    brief = np.ones((1 + round(_BRIEF * fps), 1), bool)
    # A clip is assumed to continue as it begins and ends.
    padded = np.pad(holds, ((len(brief), len(brief)), (0, 0)), mode="edge")
    holds = binary_opening(binary_closing(padded, brief), brief)[len(brief) : -len(brief)]
    # If no foot stands but one is near the floor, the slower foot counts as standing.
    low, slow = _BORNE
    least = np.where(height < low, speed, np.inf).min(2)
    slowest = np.isfinite(least) & (least == least.min(1, keepdims=True))
    holds |= ~holds.any(1, keepdims=True) & (least < slow) & slowest
    if recorded:
        # A single interval without contact between two contacts is not a flight: the slower foot counts as standing.
        held = np.pad(holds.any(1, keepdims=True), ((1, 1), (0, 0)))
        holds |= held[:-2] & ~held[1:-1] & held[2:] & slowest
    return np.pad(holds, ((1, 0), (0, 0))) | np.pad(holds, ((0, 1), (0, 0)))


def weight_on_feet(body: Body, root: np.ndarray, rotations: np.ndarray, standing: np.ndarray, fps: float) -> np.ndarray:
    """Share the weight between the feet; it passes from one to the other within about 0.1 s.

    Args:
        body: The body.
        root: (F, 3) mid hip, m.
        rotations: (F, 16, 3, 3) world orientation of each of `SEGMENTS`.
        standing: (F, 2) True where the left and the right foot stand.
        fps: Frames per second.

    Returns:
        (F, 2) shares of the weight on the left and the right foot, with a sum of at most 1.
    """
    share = standing * np.exp(-sole_points(body, root, rotations)[..., 2].min(2).clip(0) / 0.01)
    share = gaussian_filter1d(share, 0.03 * fps, axis=0, mode="nearest")
    return share / np.maximum(share.sum(1, keepdims=True), 1)


def lock_feet(
    body: Body,
    root: np.ndarray,
    rotations: np.ndarray,
    standing: np.ndarray,
    fps: float,
    *,
    recorded: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Remove foot skate: hold standing feet in place and keep all feet above the floor.

    While a foot stands, its heading and the part of its sole that bears weight stay fixed; the swing phase makes up for
    the difference. The tip or the heel may be below the floor in recordings, because toes bend. The foot is then turned
    about its ankle and, if that is not enough, raised. Thigh and shin are solved by the law of cosines to reach the
    ankle, with the knee on its original side. The hips sink where the legs are too short.

    Args:
        body: The body.
        root: (F, 3) mid hip, m.
        rotations: (F, 16, 3, 3) world orientation of each of `SEGMENTS`.
        standing: (F, 2) True where the left and the right foot stand.
        fps: Frames per second.
        recorded: Whether the motion was recorded and may contain leaps.

    Returns:
        root: (F, 3) mid hip with corrected heights, m.
        rotations: (F, 16, 3, 3) with corrected thighs, shins and feet.
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
        # Heel and tip bear weight according to how near the floor they are.
        near = np.exp(-(sole[:-1, :, 2:] + sole[1:, :, 2:]) / 0.01)
        slip = (np.diff(sole[..., :2], axis=0) * near).sum(1) / near.sum(1)
        ankles[:, side, :2] += _undrift(ankles[:, side, :2], slip, standing[:, side])
        height, flat = sole[..., 2].min(1), sole[..., 2].max(1) < _CLEAR
        swings = ~standing[:, side]
        least = np.where(swings, np.where(flat | ~standing.any(1), _CLEAR, height.clip(0, _CLEAR)), 0)
        rise = np.maximum(_eased(-height[:, None], standing[:, side])[:, 0], least - height)
        # In a leap, feet leave and meet the floor abruptly.
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
    """Return offsets (F, n) that undo the slip (F - 1, n) of each contact, centred on zero, and eased in between."""
    offsets = np.zeros_like(like)
    frames = np.flatnonzero(standing)
    for run in np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1):
        drift = np.concatenate([np.zeros((1, like.shape[1])), np.cumsum(slip[run[:-1]], axis=0)])
        offsets[run] = (drift.max(0) + drift.min(0)) / 2 - drift
    return _eased(offsets, standing)


def _eased(offsets: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Interpolate offsets (F, n) smoothly between frames where they are known; zero if none is known."""
    at = np.flatnonzero(known)
    if not len(at):
        return np.zeros_like(offsets)
    gap = np.searchsorted(at, np.arange(len(offsets)))
    before, after = at[np.maximum(gap - 1, 0)], at[np.minimum(gap, len(at) - 1)]
    share = smoothstep((np.arange(len(offsets)) - before) / np.maximum(after - before, 1))[:, None]
    return np.where(known[:, None], offsets, (1 - share) * offsets[before] + share * offsets[after])


def _on_floor(feet: np.ndarray, ankles: np.ndarray) -> np.ndarray:
    """Turn feet (F, 3, 3) up or down so that neither tip nor heel is below the floor, as far as that is possible.

    Args:
        feet: Orientations.
        ankles: (F,) height of the ankles above the floor, as a fraction of stature.
    """
    down = np.arcsin(np.clip(-feet[:, 2, 0], -1, 1))
    least, most = (
        # Pitch at which heel and tip touch the floor, from their distance and direction from the ankle.
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
    """Return thigh and shin orientations (F, 3, 3) that join hip and ankle (F, 3), the knee on its original side."""
    bone, reach = knee - hip, ankle - hip
    thigh_length = np.linalg.norm(bone, axis=1, keepdims=True)
    distance = np.linalg.norm(reach, axis=1, keepdims=True)
    along = reach / distance
    distance = np.clip(distance, abs(thigh_length - shin_length) + 0.01, _STRETCH * (thigh_length + shin_length))
    # The knee of a straight leg has no defined side; it bends forward.
    side = bone - (bone * along).sum(1, keepdims=True) * along + 0.05 * thigh[:, :, 0]
    side -= (side * along).sum(1, keepdims=True) * along
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    cosine = np.clip((thigh_length**2 + distance**2 - shin_length**2) / (2 * thigh_length * distance), -1, 1)
    bent = thigh_length * (cosine * along + np.sqrt(1 - cosine**2) * side)
    down = (0.0, 0.0, -1.0)
    return aligned(bent, thigh[:, :, 0], down), aligned(distance * along - bent, shin[:, :, 0], down)
