"""Faults of recordings: frames in which joints jump, with frozen frames beside them, are bridged or cut out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter
from scipy.spatial.transform import Rotation

from synth.motion.motion import Motion
from synth.people.body import Body, segment_origins
from synth.people.segments import SEGMENTS

_JUMP, _ACCELERATION = 0.15, 400.0
"""A joint jumps if its step from one frame to the next differs from the steps around by more than so many m, or by more
than this acceleration, m/s^2, explains; the feet of kicks reach some 300."""
_LONGEST = 0.25
"""Longest fault that is bridged, s, as for gaps of recordings."""
_FASTEST = 8.0
"""Greatest mean speed of a joint over a bridge, m/s; beyond it frames belong to different places."""
_FROZEN = 1e-6
"""Greatest change of a frozen frame, m or as a part of a rotation matrix; the noise of cameras is larger."""
_SHORTEST = 1.0
"""Least length of what is left of a take after cutting, s."""
_JOINTS = [
    SEGMENTS.index(name) for name in ("pelvis", "head", *(f"{s}_{n}" for s in "lr" for n in ("hand", "shin", "foot")))
]


def repair(motion: Motion, path: Path) -> Motion:
    """Return a motion without frames in which joints jump.

    A fault is a jump, or jumps less than 0.25 s apart, with the frozen frames beside them. Up to 0.25 s long it is
    bridged by slerp and straight lines, if people can move that fast; others are cut out, and the longest stretch
    between them is left. The name says what was done; `first` counts on. A single step at no more than 8 m/s stays.

    Args:
        motion: A whole take.
        path: The file, for messages.

    Raises:
        ValueError: less than a second is left of a longer take.
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
            f"most {(end - first) / motion.fps:.2g} s are sound; expected at least {_SHORTEST:g} s, repair the take"
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
    """Return roots (n, 3) and rotations (n, 16, 3, 3) of the frames between two others."""
    share = np.arange(1, after - before) / (after - before)
    first, last = motion.rotations[before], motion.rotations[after]
    turn = Rotation.from_matrix(first.swapaxes(-1, -2) @ last).as_rotvec()
    turned = Rotation.from_rotvec((share[:, None, None] * turn).reshape(-1, 3)).as_matrix()
    way = share[:, None] * (motion.root[after] - motion.root[before])
    return motion.root[before] + way, first @ turned.reshape(len(share), -1, 3, 3)
