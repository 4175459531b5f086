"""Feet on the floor: contacts, standing feet held in place, motions fitted to a body, and steps along a path."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import (
    binary_closing,
    binary_opening,
    gaussian_filter1d,
    maximum_filter1d,
    minimum_filter1d,
    percentile_filter,
)

from dmae.numerics.paths import runs
from synth.motion.geometry import about, aligned, forwards, leftwards, minimum_jerk, smoothstep, two_bone_ik
from synth.motion.motion import Motion
from synth.people.body import ANKLE_HEIGHT, SEGMENTS, SIDES, Body, segment_origins
from synth.people.solids import capsules

FEET = (SEGMENTS.index("l_foot"), SEGMENTS.index("r_foot"))
"""Indices of the left and the right foot in `SEGMENTS`."""
_STILL = ((0.03, 0.35), (0.06, 0.20))
"""Greatest height, m, and greatest speed, m/s, of the heel or tip of a foot that stands; either pair suffices."""
_BORNE = (0.04, 0.8)
"""The same limits for the slower foot while no foot stands according to `_STILL`."""
_BRIEF = 0.08
"""Contacts, and interruptions of contacts, that last no longer than this are ignored, s."""
_STRETCH = 0.999
"""Greatest length of a leg, as a fraction of the length of its bones."""
_CLEAR = 0.04
"""Least height of a swinging foot while no foot stands, or while it is flat and the other foot stands, m."""
SOLE = np.array(((-0.038, 0, -ANKLE_HEIGHT), (0.106, 0, -ANKLE_HEIGHT)))
"""(2, 3) heel, and the tip over which a foot rolls forward, in the foot's frame, fractions of stature."""


def sole_points(body: Body, root: np.ndarray, rotations: np.ndarray, points: np.ndarray = SOLE) -> np.ndarray:
    """Return points on the soles, (F, 2, K, 3) m, of the left and the right foot. `points` (K, 3) are in the foot's
    frame, in fractions of stature; `root` (F, 3), m, and `rotations` (F, 16, 3, 3) as in `Motion`."""
    ankles = segment_origins(body, root, rotations)[:, FEET, None]
    return ankles + np.einsum("fsij,kj->fski", rotations[:, FEET], points * body.stature)


def foot_contacts(
    body: Body, root: np.ndarray, rotations: np.ndarray, fps: float, *, turn: float, recorded: bool = False
) -> np.ndarray:
    """Return (F, 2) True where the left and the right foot stand on the floor.

    `turn` is the rate at which the motion has been bent, rad/s; the slip of feet that this causes is allowed. Recorded
    people may shift their weight between frames.
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
    """Return (F, 2) shares of the weight on the left and the right foot, with a sum of at most 1. The weight passes
    from one to the other within about 0.1 s; `standing` (F, 2) as from `foot_contacts`."""
    share = standing * np.exp(-sole_points(body, root, rotations)[..., 2].min(2).clip(0) / 0.01)
    share = gaussian_filter1d(share, 0.03 * fps, axis=0, mode="nearest")
    return share / np.maximum(share.sum(1, keepdims=True), 1)


def lock_feet(
    body: Body, root: np.ndarray, rotations: np.ndarray, standing: np.ndarray, fps: float, *, recorded: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Remove foot skate: hold standing feet (`foot_contacts`) in place and keep all feet above the floor.

    While a foot stands, its heading and the part of its sole that bears weight stay fixed; the swing phase makes up for
    the difference. The tip or the heel may be below the floor in recordings, because toes bend. The foot is then turned
    about its ankle and, if that is not enough, raised. The leg turns with its foot, and reaches the ankle by turns of
    the hip and by bending the knee, which stays a hinge. The hips sink where the legs are too short. Recorded motions
    may leap.

    Returns the root (F, 3), m, with corrected heights, and the rotations (F, 16, 3, 3) with corrected legs.
    """
    root, rotations = root.copy(), rotations.copy()
    origins = segment_origins(body, root, rotations)
    ankles = origins[:, FEET]
    for side, foot in enumerate(FEET):
        heading = np.unwrap(np.arctan2(rotations[:, foot, 1, 0], rotations[:, foot, 0, 0]))
        turned = _undrift(heading[:, None], np.diff(heading)[:, None], standing[:, side])
        rotations[:, foot - 2 : foot + 1] = about("z", turned) @ rotations[:, foot - 2 : foot + 1]
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
            ankles[:, side] - origins[:, thigh], rotations[:, thigh], rotations[:, shin], bones
        )
    return root, rotations


def _undrift(like: np.ndarray, slip: np.ndarray, standing: np.ndarray) -> np.ndarray:
    """Return offsets (F, n) that undo the slip (F - 1, n) of each contact, centred on zero, and eased in between."""
    offsets = np.zeros_like(like)
    for first, end in runs(standing):
        drift = np.concatenate([np.zeros((1, like.shape[1])), np.cumsum(slip[first : end - 1], axis=0)])
        offsets[first:end] = (drift.max(0) + drift.min(0)) / 2 - drift
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
    """Turn feet (F, 3, 3) until tip and heel, if possible, are above the floor; ankles are `ankles` (F,) statures above
    it."""
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
    reach: np.ndarray, thigh: np.ndarray, shin: np.ndarray, lengths: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return thigh and shin orientations (F, 3, 3) of a leg whose ankle is at `reach` (F, 3) from the hip, m.

    The leg turns the shortest way to point there; then the knee, a hinge about y of the thigh, bends. `lengths` (2,) of
    thigh and shin, m.
    """
    upper, lower = lengths
    before = -upper * thigh[:, :, 2] - lower * shin[:, :, 2]
    before /= np.linalg.norm(before, axis=1, keepdims=True)
    distance = np.linalg.norm(reach, axis=1, keepdims=True)
    along = reach / distance
    both = before + along
    turn = np.eye(3) + 2 * along[:, :, None] * before[:, None]
    turn -= both[:, :, None] * both[:, None] * 2 / (both**2).sum(1)[:, None, None]
    forward = np.cross(along, (turn @ thigh)[:, :, 1])
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    # Law of cosines, at the hip.
    distance = np.clip(distance, abs(upper - lower) + 0.01, _STRETCH * (upper + lower))
    cosine = np.clip((upper**2 + distance**2 - lower**2) / (2 * upper * distance), -1, 1)
    knee = upper * (cosine * along + np.sqrt(1 - cosine**2) * forward)
    down = (0.0, 0.0, -1.0)
    return aligned(knee, forward, down), aligned(distance * along - knee, (turn @ shin)[:, :, 0], down)


# Fit a motion to a body

_FLIGHT = 1.0
"""Window that is longer than the flight of a jump, so that it always contains floor contact, s."""
_TREAD = np.array((SOLE[0], (0.070, 0, SOLE[0, 2])))
"""(2, 3) heel and ball of a foot in its own frame, fractions of stature."""


def fit_to_body(motion: Motion, body: Body) -> Motion:
    """Scale a motion to a body and put the body on the floor.

    The step length scales with the leg length. The floor height follows the lower foot, or any other body part that is
    lower. It is smoothed over one second, so that the feet leave the floor in a jump but not in a stance. Feet count
    from heel to ball; toes bend and may be lower.
    """
    root = motion.root * (body.hip_height / motion.hip_height)
    segments, ends, radii = capsules(body)
    others = ~np.isin(segments, FEET)
    segments, ends, radii = segments[others], ends[others], radii[others]
    origins = segment_origins(body, root, motion.rotations)[:, segments, 2]
    heights = np.einsum("fcj,cej->fce", motion.rotations[:, segments, 2], ends)
    lowest = ((origins[..., None] + heights).min(2) - radii).min(1)
    feet = sole_points(body, root, motion.rotations, _TREAD)[..., 2].min((1, 2))
    window = max(1, round(_FLIGHT * motion.fps))
    floor = np.minimum(
        percentile_filter(feet, 25, window, mode="nearest"), minimum_filter1d(lowest, window, mode="nearest")
    )
    floor = gaussian_filter1d(floor, 0.15 * motion.fps, mode="nearest")
    root[:, 2] -= floor
    return replace(motion, root=root, hip_height=body.hip_height)


# Steps along any path: forward, sideways and in turns, with starts, stops and sitting. `synth.motion.procedural.gait`
# uses the published kinematics of a steady walk; these steps follow a rule: the feet step in turn, each to the place
# where the body will be while that foot bears the weight. A foot that is already there does not step.

_PERIOD = 0.56
"""Time from one step to the next, s."""
_SWING = 0.78
"""Share of the period for which the foot is in the air."""
_SHORTEST, _LEAST_TURN = 0.035, np.radians(8)
"""Smallest step, m, and smallest turn, rad, that a foot makes."""
_LIFT = 0.055
"""Height of a swinging foot, m."""
_ROLL_OFF, _STRIKE = np.radians(40), np.radians(18)
"""Pitch of a foot that leaves the floor, and of one that meets it, rad per metre of step."""
_HEEL, _BALL = -0.037, 0.085
"""Points over which soles roll, ahead of the ankle, fractions of stature."""
_EASE, _RESTING, _HANGING = 0.985, 0.80, 0.68
"""Greatest length of a standing leg, greatest length of a leg that rests on the floor in front of a seat, and length of
a leg that hangs from a seat, as fractions of the total length of its bones."""


@dataclass(frozen=True)
class Footsteps:
    """The lower body of a person who follows a path of F frames."""

    root: np.ndarray  # (F, 3) mid hip, m
    pelvis: np.ndarray  # (F, 3, 3) orientation
    legs: np.ndarray  # (F, 2, 3, 3, 3) orientations of thigh, shin and foot, left and right
    stride: np.ndarray  # (F,) distance of the left foot ahead of the right, m


def step_along(
    body: Body,
    path: np.ndarray,
    fps: float,
    *,
    rng: np.random.Generator,
    hips: np.ndarray | None = None,
    ahead: float = 0.0,
) -> Footsteps:
    """Follow a path (F, 3) of mid hip, m, and heading, rad, with steps; feet that bear weight stay in place.

    `hips` (F,) is the greatest height of the mid hip, m, for sitting, crouching or bent knees. `ahead` is the distance
    of the feet ahead of the hips, m, as in sitting. `rng` draws which foot steps first and how wide the feet stand.
    """
    seconds = np.arange(len(path)) / fps
    width, out = rng.uniform(0.055, 0.08) * body.stature, np.radians(rng.uniform(4, 14))
    phase = rng.uniform(0, 2)
    under = path.copy()
    under[:, :2] += ahead * forwards(path[:, 2])
    feet = [
        _footsteps(under, seconds, sign * width, sign * out, phase + (sign < 0), body.stature)
        for sign in SIDES.values()
    ]
    ankles, turns, bearing = (np.stack(both, 1) for both in zip(*feet, strict=True))
    heading = gaussian_filter1d(path[:, 2], 0.08 * fps, mode="nearest")
    forward, left = forwards(heading), leftwards(heading)
    # The hips shift towards the foot that bears the weight.
    support = (ankles[..., :2] * bearing[..., None]).sum(1) / bearing.sum(1, keepdims=True)
    aside = np.clip(((support - under[:, :2]) * left).sum(1), -width, width)
    aside = gaussian_filter1d(aside, 0.12 * fps, mode="nearest")
    root = np.zeros((len(path), 3))
    root[:, :2] = path[:, :2] + 0.3 * aside[:, None] * left
    pelvis = about("z", heading)
    offsets = np.stack([body.offsets[SEGMENTS.index(f"{side}_thigh")] for side in SIDES])
    thigh, shin = (float(np.linalg.norm(body.offsets[SEGMENTS.index(f"l_{part}")])) for part in ("shin", "foot"))
    sockets = pelvis[:, None] @ offsets[..., None]
    level = np.linalg.norm(root[:, None, :2] + sockets[..., :2, 0] - ankles[..., :2], axis=-1)

    def reach(share: float) -> np.ndarray:
        up = np.sqrt(np.maximum((share * (thigh + shin)) ** 2 - level**2, 0.04))
        return ankles[..., 2] + up - sockets[..., 2, 0]

    if ahead > 0 and hips is not None:
        # Feet that do not reach the floor hang above it.
        hanging = hips[:, None] > reach(_RESTING)
        ankles[..., 2] += np.where(hanging, hips[:, None] - reach(_HANGING), 0)
    lowest = minimum_filter1d(reach(_EASE).min(1), max(1, round(0.12 * fps)), mode="nearest")
    root[:, 2] = gaussian_filter1d(lowest, 0.06 * fps, mode="nearest")
    if hips is not None:
        root[:, 2] = np.minimum(root[:, 2], hips)
    legs = np.empty((len(path), 2, 3, 3, 3))
    for leg in range(2):
        hip = root + sockets[:, leg, :, 0]
        foot = turns[:, leg]
        knee, ankle = np.swapaxes(two_bone_ik(hip, ankles[:, leg], (thigh, shin), foot[..., 0] + pelvis[..., 0]), 0, 1)
        for place, along in ((0, knee - hip), (1, ankle - knee)):
            legs[:, leg, place] = aligned(along, foot[..., 0] + pelvis[..., 0] + (0, 0, 0.3), (0, 0, -1))
        legs[:, leg, 2] = foot
    stride = ((ankles[:, 0] - ankles[:, 1])[:, :2] * forward).sum(1)
    return Footsteps(root, pelvis, legs, stride)


def _footsteps(
    path: np.ndarray, seconds: np.ndarray, aside: float, out: float, phase: float, stature: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ankle (F, 3) m, orientation (F, 3, 3) and weight (F,) of one foot, which steps every other period."""
    stance = (2 - _SWING) * _PERIOD
    count = int(np.ceil(seconds[-1] / (2 * _PERIOD))) + 3
    lifts = (2 * np.arange(count) - 2 + phase % 2) * _PERIOD
    lands = lifts + _SWING * _PERIOD
    # Positions of the foot before its first step and after each step.
    middles = np.concatenate([lands[:1] - 2 * _PERIOD, lands]) + stance / 2
    holds = np.stack([np.interp(middles, seconds, column) for column in path.T], axis=1)
    if len(path) > 1:
        # The path continues straight before its start and after its end.
        holds += np.minimum(middles - seconds[0], 0)[:, None] * (path[1] - path[0]) / (seconds[1] - seconds[0])
        holds += np.maximum(middles - seconds[-1], 0)[:, None] * (path[-1] - path[-2]) / (seconds[1] - seconds[0])
    heading = holds[:, 2]
    holds[:, :2] += aside * leftwards(heading)
    holds[:, 2] += out
    for k in range(1, len(holds)):
        moved = np.linalg.norm(holds[k, :2] - holds[k - 1, :2])
        if moved < _SHORTEST and abs(holds[k, 2] - holds[k - 1, 2]) < _LEAST_TURN:
            holds[k] = holds[k - 1]
    step = np.clip(np.searchsorted(lifts, seconds, side="right") - 1, 0, count - 1)
    share = np.clip((seconds - lifts[step]) / (_SWING * _PERIOD), 0, 1)
    start, end = holds[step], holds[step + 1]
    length = np.linalg.norm(end[:, :2] - start[:, :2], axis=1)
    stepping = (length > 0) | (start[:, 2] != end[:, 2])
    place = start + minimum_jerk(share)[:, None] * (end - start)
    forward = ((end - start)[:, :2] * forwards(place[:, 2])).sum(1)
    # The heel rises before the foot does. The foot meets the floor with the heel first and then rolls flat.
    following = np.minimum(step + 1, count - 1)
    next_forward = ((holds[following + 1] - holds[following])[:, :2] * forwards(holds[following, 2])).sum(1)
    rising = np.clip((seconds - lands[step]) / stance, 0, 1)
    off = -_ROLL_OFF * np.clip(forward, 0, 0.8)
    strike = _STRIKE * np.clip(forward, 0, 0.8)
    in_air = off * (1 - smoothstep(share / 0.55)) + strike * smoothstep((share - 0.55) / 0.45)
    in_air *= np.where(share > 0, 1, 0)
    on_floor = strike * (1 - smoothstep(rising / 0.2)) - _ROLL_OFF * np.clip(next_forward, 0, 0.8) * smoothstep(
        (rising - 0.55) / 0.45
    )
    pitch = np.where(share < 1, in_air, on_floor)
    ankle_height = ANKLE_HEIGHT * stature
    pivot = np.where(pitch > 0, _HEEL, _BALL) * stature
    cosine, sine = np.cos(pitch), np.sin(pitch)
    rolled, up = pivot - cosine * pivot - sine * ankle_height, cosine * ankle_height - sine * pivot
    ankle = np.empty((len(seconds), 3))
    ankle[:, :2] = place[:, :2] + rolled[:, None] * forwards(place[:, 2])
    lift = _LIFT * np.clip(0.35 + length / 0.5, 0, 1) * stepping
    ankle[:, 2] = up + lift * 16 * share**2 * (1 - share) ** 2
    weight = np.where(stepping, 1 - np.sin(np.pi * share) ** 2, 1.0) + 0.02
    return ankle, about("z", place[:, 2]) @ about("y", -pitch), weight
