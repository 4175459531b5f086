"""Legs that follow any path: steps forward, sideways and in turns, with starts, stops and sitting.

`synth.motion.procedural.gait` uses the published kinematics of a steady walk. This module uses a rule instead: the feet
step in turn, each to the place where the body will be while that foot bears the weight. A foot that is already there
does not step.
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d

from synth.motion.easing import minimum_jerk, smoothstep
from synth.motion.inverse_kinematics import two_bone_ik
from synth.motion.rotations import about, aligned
from synth.people.body import ANKLE_HEIGHT, SIDES, Body
from synth.people.segments import SEGMENTS

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
    """The lower body of a person who follows a path of F frames.

    Attributes:
        root: (F, 3) mid hip, m.
        pelvis: (F, 3, 3) orientation.
        legs: (F, 2, 3, 3, 3) orientations of thigh, shin and foot, left and right.
        stride: (F,) distance of the left foot ahead of the right, m.
    """

    root: np.ndarray
    pelvis: np.ndarray
    legs: np.ndarray
    stride: np.ndarray


def step_along(
    body: Body,
    path: np.ndarray,
    fps: float,
    *,
    rng: np.random.Generator,
    hips: np.ndarray | None = None,
    ahead: float = 0.0,
) -> Footsteps:
    """Follow a path with steps; feet that bear weight stay in place.

    Args:
        body: The body.
        path: (F, 3) x and y of the mid hip, m, and heading, rad.
        fps: Frames per second.
        rng: Draws which foot steps first and how wide the feet stand.
        hips: (F,) greatest height of the mid hip, m, for sitting, crouching or bent knees.
        ahead: Distance of the feet ahead of the hips, m, as in sitting.
    """
    seconds = np.arange(len(path)) / fps
    width, out = rng.uniform(0.055, 0.08) * body.stature, np.radians(rng.uniform(4, 14))
    phase = rng.uniform(0, 2)
    under = path.copy()
    under[:, :2] += ahead * np.stack([np.cos(path[:, 2]), np.sin(path[:, 2])], 1)
    feet = [
        _footsteps(under, seconds, sign * width, sign * out, phase + (sign < 0), body.stature)
        for sign in SIDES.values()
    ]
    ankles, turns = np.stack([foot[0] for foot in feet], 1), np.stack([foot[1] for foot in feet], 1)
    heading = gaussian_filter1d(path[:, 2], 0.08 * fps, mode="nearest")
    forward = np.stack([np.cos(heading), np.sin(heading)], 1)
    # The hips shift towards the foot that bears the weight.
    bearing = np.stack([foot[2] for foot in feet], 1)
    support = (ankles[..., :2] * bearing[..., None]).sum(1) / bearing.sum(1, keepdims=True)
    left = np.stack([-forward[:, 1], forward[:, 0]], 1)
    aside = np.clip(((support - under[:, :2]) * left).sum(1), -width, width)
    aside = gaussian_filter1d(aside, 0.12 * fps, mode="nearest")
    root = np.zeros((len(path), 3))
    root[:, :2] = path[:, :2] + 0.3 * aside[:, None] * left
    pelvis = about("z", heading)
    offsets = np.stack([body.offsets[SEGMENTS.index(f"{side}_thigh")] for side in SIDES])
    lengths = tuple(float(np.linalg.norm(body.offsets[SEGMENTS.index(f"l_{part}")])) for part in ("shin", "foot"))
    sockets = pelvis[:, None] @ offsets[..., None]
    level = np.linalg.norm(root[:, None, :2] + sockets[..., :2, 0] - ankles[..., :2], axis=-1)

    def reach(share: float) -> np.ndarray:
        up = np.sqrt(np.maximum((share * sum(lengths)) ** 2 - level**2, 0.04))
        return ankles[..., 2] + up - sockets[..., 2, 0]

    if ahead > 0:
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
        knee, ankle = np.swapaxes(two_bone_ik(hip, ankles[:, leg], lengths, foot[..., 0] + pelvis[..., 0]), 0, 1)
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
    holds = _at(path, seconds, middles)
    heading = holds[:, 2]
    holds[:, :2] += aside * np.stack([-np.sin(heading), np.cos(heading)], 1)
    holds[:, 2] += out
    for k in range(1, len(holds)):
        moved = np.linalg.norm(holds[k, :2] - holds[k - 1, :2])
        if moved < _SHORTEST and abs(holds[k, 2] - holds[k - 1, 2]) < _LEAST_TURN:
            holds[k] = holds[k - 1]
    k = np.clip(np.searchsorted(lifts, seconds, side="right") - 1, 0, count - 1)
    share = np.clip((seconds - lifts[k]) / (_SWING * _PERIOD), 0, 1)
    start, end = holds[k], holds[k + 1]
    length = np.linalg.norm(end[:, :2] - start[:, :2], axis=1)
    stepping = (length > 0) | (start[:, 2] != end[:, 2])
    place = start + minimum_jerk(share)[:, None] * (end - start)
    forward = ((end - start)[:, :2] * np.stack([np.cos(place[:, 2]), np.sin(place[:, 2])], 1)).sum(1)
    # The heel rises before the foot does. The foot meets the floor with the heel first and then rolls flat.
    following = np.minimum(k + 1, count - 1)
    next_forward = _ahead(holds, following)
    rising = np.clip((seconds - lands[k]) / stance, 0, 1)
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
    ankle[:, :2] = place[:, :2] + rolled[:, None] * np.stack([np.cos(place[:, 2]), np.sin(place[:, 2])], 1)
    lift = _LIFT * np.clip(0.35 + length / 0.5, 0, 1) * stepping
    ankle[:, 2] = up + lift * 16 * share**2 * (1 - share) ** 2
    weight = np.where(stepping, 1 - np.sin(np.pi * share) ** 2, 1.0) + 0.02
    return ankle, about("z", place[:, 2]) @ about("y", -pitch), weight


def _ahead(holds: np.ndarray, k: np.ndarray) -> np.ndarray:
    """Return the forward length of the k-th (F,) step, (F,) m."""
    step, heading = holds[k + 1] - holds[k], holds[k, 2]
    return step[:, 0] * np.cos(heading) + step[:, 1] * np.sin(heading)


def _at(path: np.ndarray, seconds: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return positions (K, 3) on a path at times (K,), extrapolated linearly before its start and after its end."""
    found = np.stack([np.interp(times, seconds, column) for column in path.T], axis=1)
    if len(path) > 1:
        found += np.minimum(times - seconds[0], 0)[:, None] * (path[1] - path[0]) / (seconds[1] - seconds[0])
        found += np.maximum(times - seconds[-1], 0)[:, None] * (path[-1] - path[-2]) / (seconds[1] - seconds[0])
    return found
