"""Repair recordings: bridge or cut out frames in which joints jump, and halve rates that contradict gravity."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from synth.motion.feet import sole_points
from synth.motion.motion import Motion
from synth.people.body import Body, segment_origins
from synth.people.segments import SEGMENTS

_JUMP, _ACCELERATION = 0.15, 400.0
"""A joint jumps if its step from one frame to the next differs from the median of the steps around it by more than
this distance, m, and by more than this acceleration explains, m/s^2; feet reach about 300 in kicks."""
_LONGEST = 0.25
"""Longest fault that is bridged, s, as for gaps of recordings."""
_FASTEST = 8.0
"""Greatest mean speed of a joint over a bridge, m/s; people do not move faster."""
_FROZEN = 1e-6
"""Greatest change between frozen frames, m or per element of a rotation matrix; camera noise is larger."""
_SHORTEST = 1.0
"""Least length of the part of a take that is left after cutting, s."""
_JOINTS = [
    SEGMENTS.index(name) for name in ("pelvis", "head", *(f"{s}_{n}" for s in "lr" for n in ("hand", "shin", "foot")))
]
_GRAVITY = 9.81
"""m/s^2."""
_STATED = (119.0, 121.0)
"""Range around 120 frames/s, the rate that conversions often state, even if the true rate is another."""
_FLIGHT = 0.2
"""Least length of a flight at the stated rate, s."""
_CLEAR = 0.06
"""Height of the soles above which feet are off the floor, m."""
_HALF = (2.8, 5.7)
"""Range of accelerations of a fall, in units of gravity, that shows that the true rate is half the stated rate: the
stated rate makes them four times as large. At true rates they were 0.8 to 1.2 in flights, and below 0.2 for people on
platforms and bars."""
_ODD = 0.1
"""Greatest standard deviation of a flight from a parabola, as a share of the height that it spans."""


def repair(motion: Motion, path: Path) -> Motion:
    """Return a motion without frames in which joints jump.

    A fault is one jump, or several jumps less than 0.25 s apart, together with the adjacent frozen frames. A fault of
    up to 0.25 s is bridged by slerp and straight lines, if people can move that fast. Other faults are cut out, and
    the longest stretch between them is returned. The name lists the changes; `first` is the new first frame. A single
    step at no more than 8 m/s is not changed.

    Args:
        motion: A whole take.
        path: The file, for messages.

    Raises:
        ValueError: a take of more than one second has less than one second left.
    """
    if len(motion) < 3:
        return motion
    body = Body(1.70)
    joints = segment_origins(body, motion.root * body.hip_height / motion.hip_height, motion.rotations)[:, _JOINTS]
    faults = _faults(motion, joints)
    if not faults:
        return motion
    root, rotations = motion.root.copy(), motion.rotations.copy()
    cuts, bridged = [], 0
    for before, after in faults:
        inside = slice(before + 1, after)
        speed = np.linalg.norm(joints[after] - joints[before], axis=1).max() * motion.fps / (after - before)
        if after - before - 1 > _LONGEST * motion.fps or speed > _FASTEST:
            cuts.append((before, after))
        elif after - before > 1:
            root[inside], rotations[inside] = _bridge(motion, before, after)
            bridged += after - before - 1
    starts, ends = [0, *(after for _, after in cuts)], [*(before + 1 for before, _ in cuts), len(motion)]
    first, end = max(zip(starts, ends, strict=True), key=lambda run: run[1] - run[0])
    if end - first < min(_SHORTEST * motion.fps, len(motion)):
        raise ValueError(
            f"{path}: joints jump {len(cuts)} times, first from frame {cuts[0][0] + 1} to {cuts[0][1] + 1}, so that at "
            f"most {(end - first) / motion.fps:.2g} s are valid; expected at least {_SHORTEST:g} s, repair the take"
        )
    if not (bridged or cuts):
        return motion
    notes = [f"{bridged} frames bridged"] if bridged else []
    if end - first < len(motion):
        notes.append(f"frames {first + 1}-{end} of {len(motion)}")
    name = f"{motion.name}, {', '.join(notes)}"
    return replace(motion, name=name, root=root[first:end], rotations=rotations[first:end], first=motion.first + first)


def _faults(motion: Motion, joints: np.ndarray) -> list[tuple[int, int]]:
    """Return the last frame before and the first frame after each fault; `joints` is (F, K, 3) m."""
    steps = np.diff(joints, axis=0)
    odd = np.linalg.norm(steps - median_filter(steps, (5, 1, 1), mode="nearest"), axis=2).max(1)
    jumps = np.flatnonzero(odd > max(_JUMP, _ACCELERATION / motion.fps**2))
    frozen = (np.abs(np.diff(motion.root, axis=0)).max(1) < _FROZEN) & (
        np.abs(np.diff(motion.rotations, axis=0)).max((1, 2, 3)) < _FROZEN
    )
    faults: list[tuple[int, int]] = []
    for jump in jumps:
        before, after = int(jump), int(jump) + 1
        while before > 0 and frozen[before - 1]:
            before -= 1
        while after < len(frozen) and frozen[after]:
            after += 1
        if faults and before - faults[-1][1] < _LONGEST * motion.fps:
            before, end = faults.pop()
            after = max(after, end)
        faults.append((before, after))
    return faults


def _bridge(motion: Motion, before: int, after: int) -> tuple[np.ndarray, np.ndarray]:
    """Return roots (n, 3) and rotations (n, 16, 3, 3) of the n frames between `before` and `after`."""
    share = np.arange(1, after - before) / (after - before)
    first, last = motion.rotations[before], motion.rotations[after]
    turn = Rotation.from_matrix(first.swapaxes(-1, -2) @ last).as_rotvec()
    turned = Rotation.from_rotvec((share[:, None, None] * turn).reshape(-1, 3)).as_matrix()
    way = share[:, None] * (motion.root[after] - motion.root[before])
    return motion.root[before] + way, first @ turned.reshape(len(share), -1, 3, 3)


def correct_rate(motion: Motion) -> Motion:
    """Return a motion at half its rate if the stated rate is 120 and people in the air would fall too fast at it."""
    if not _STATED[0] < motion.fps < _STATED[1]:
        return motion
    falls = _falls(motion)
    if not falls or not _HALF[0] < np.median(falls) < _HALF[1]:
        return motion
    note = f"at {motion.fps / 2:.4g}, as it falls with {np.median(falls):.2g} g at {motion.fps:.4g}"
    return replace(motion, fps=motion.fps / 2, name=f"{motion.name}, {note}")


def _falls(motion: Motion) -> list[float]:
    """Return the downward acceleration of the body (segment origins weighted by mass) in each flight, in g."""
    body = Body(1.70)
    root = motion.root * body.hip_height / motion.hip_height
    origins = segment_origins(body, root, motion.rotations)
    height = (origins[..., 2] @ body.masses) / body.masses.sum()
    above = sole_points(body, root, motion.rotations)[..., 2].min((1, 2)) > _CLEAR
    edges = np.flatnonzero(np.diff(above, prepend=False, append=False))
    found = []
    for first, end in zip(edges[::2], edges[1::2], strict=True):
        if end - first < _FLIGHT * motion.fps:
            continue
        time = np.arange(end - first) / motion.fps
        parabola = np.polynomial.Polynomial.fit(time, height[first:end], 2).convert().coef
        left = height[first:end] - np.polynomial.polynomial.polyval(time, parabola)
        if left.std() < _ODD * np.ptp(height[first:end]):
            found.append(-2 * parabola[2] / _GRAVITY)
    return found
