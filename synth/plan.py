"""From a motion to the path that a body means to take: its size, its floor, its place, and others in its way."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d, minimum_filter1d, percentile_filter
from scipy.spatial.transform import Rotation

from synth.body import ANKLE_HEIGHT, Body, segment_origins
from synth.feet import FEET, soles
from synth.motion import Motion
from synth.person import capsules

_FLIGHT = 1.0
"""Time in which even a jumper is on the floor once, s."""
_TREAD = np.array(((-0.038, 0, -ANKLE_HEIGHT), (0.070, 0, -ANKLE_HEIGHT)))
"""Heel and ball of a foot in its own frame, fractions of stature."""


def fit(motion: Motion, body: Body) -> Motion:
    """The motion as a body of its own size makes it, on the floor.

    Steps lengthen with the legs. The floor under the body is where the lower foot mostly has been within half a
    second, or anything else that was lower, smoothed: it is felt by those who stand and not by those who jump. Feet
    count from heel to ball; toes, which bend, may be lower.
    """
    root = motion.root * (body.hip_height / motion.hip_height)
    segments, ends, radii = capsules(body)
    others = ~np.isin(segments, FEET)
    segments, ends, radii = segments[others], ends[others], radii[others]
    origins = segment_origins(body, root, motion.rotations)[:, segments, 2]
    heights = np.einsum("fcj,cej->fce", motion.rotations[:, segments, 2], ends)
    lowest = ((origins[..., None] + heights).min(2) - radii).min(1)
    feet = soles(body, root, motion.rotations, _TREAD)[..., 2].min((1, 2))
    window = max(1, round(_FLIGHT * motion.fps))
    floor = np.minimum(
        percentile_filter(feet, 25, window, mode="nearest"), minimum_filter1d(lowest, window, mode="nearest")
    )
    floor = gaussian_filter1d(floor, 0.15 * motion.fps, mode="nearest")
    root[:, 2] -= floor
    return replace(motion, root=root, hip_height=body.hip_height)


def lead(motion: Motion, start: tuple[float, float], yaw: float, turn: float) -> Motion:
    """The motion begun elsewhere, in another direction, and bent along a curve.

    Args:
        motion: On the floor.
        start: Where the hips are in the first frame, m, world.
        yaw: Turns the whole motion about the vertical, rad.
        turn: Turns it further as time goes by, rad/s: a straight walk becomes a walk around a circle.
    """
    root = motion.root.copy()
    root[:, :2] = led_path(motion, start, yaw, turn)
    return replace(motion, root=root, rotations=_turns(motion, yaw, turn)[:, None] @ motion.rotations)


def led_path(motion: Motion, start: tuple[float, float], yaw: float, turn: float) -> np.ndarray:
    """(F, 2) where the hips go, m, when `lead` leads the motion so."""
    turns = _turns(motion, yaw, turn)
    steps = np.einsum("fij,fj->fi", turns[:-1, :2, :2], np.diff(motion.root[:, :2], axis=0))
    return np.concatenate([[start], start + np.cumsum(steps, axis=0)])


def _turns(motion: Motion, yaw: float, turn: float) -> np.ndarray:
    angle = yaw + turn * np.arange(len(motion)) / motion.fps
    return Rotation.from_rotvec(angle[:, None] * (0.0, 0.0, 1.0)).as_matrix()


def give_way(paths: np.ndarray, fps: float, *, clearance: float, obstacles: np.ndarray) -> np.ndarray:
    """Sidesteps that keep people apart from each other and from what stands about.

    Wherever two paths come closer than the clearance, both yield half of what is missing, sideways to the way
    they pass each other, beginning a second before. Sidesteps may lead to others; a few rounds settle most.

    Args:
        paths: (F, P, 2) hips, m.
        fps: Frames per second.
        clearance: Between two people's hips, m.
        obstacles: (K, 3) x, y and radius of what stands about, m; half the clearance is kept from it.

    Returns:
        (F, P, 2) shift of each path, m.
    """
    frames, persons = paths.shape[:2]
    still = np.broadcast_to(obstacles[:, :2], (frames, len(obstacles), 2))
    distances = np.full((persons, persons + len(obstacles)), clearance)
    distances[:, persons:] = clearance / 2 + obstacles[:, 2]
    shift = np.zeros_like(paths)
    for _ in range(24):
        yielded = False
        for one in range(persons):
            for other in range(one + 1, persons + len(obstacles)):
                places = np.concatenate([paths + shift, still], axis=1)
                apart = places[:, one] - places[:, other]
                step = _sidestep(apart, fps, distances[one, other])
                if step is None:
                    continue
                yielded = True
                if other < persons:
                    shift[:, one] += step / 2
                    shift[:, other] -= step / 2
                else:
                    shift[:, one] += step
        if not yielded:
            break
    return shift


def _sidestep(apart: np.ndarray, fps: float, clearance: float) -> np.ndarray | None:
    """(F, 2) smooth displacement by which `apart` (F, 2) stays as long as the clearance at its shortest; m."""
    distance = np.linalg.norm(apart, axis=1)
    nearest = int(distance.argmin())
    missing = clearance - distance[nearest]
    if missing < 0.005:
        return None
    away = apart[nearest]
    if distance[nearest] < 0.02:
        # Head-on: everybody keeps to the right. Who stands in another's place moves anywhere.
        passing = np.gradient(apart, axis=0)[nearest] if len(apart) > 1 else np.zeros(2)
        away = np.array((passing[1], -passing[0])) if passing.any() else np.array((1.0, 0.0))
    close = np.flatnonzero(distance < clearance)
    run = np.split(close, np.flatnonzero(np.diff(close) > 1) + 1)
    first, last = next((r[0], r[-1]) for r in run if r[0] <= nearest <= r[-1])
    time = np.arange(len(apart))
    beyond = np.maximum(np.maximum(first - time, time - last), 0) / fps
    ramp = 0.5 + 0.5 * np.cos(np.pi * np.minimum(beyond, 1.0))
    return (missing + 0.005) * ramp[:, None] * (away / np.linalg.norm(away))
