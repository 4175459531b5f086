"""Interpolation of what moves least: offsets between joints, in a frame that turns with the body."""

import numpy as np

from dmae.metrics import mean_known
from dmae.series import Interpolation, linear, local_parabola
from dmae.skeleton import Skeleton

HEADING = 0.2
"""s over which the direction that a body faces is smoothed: hips are a narrow base to tell it from."""

_TORSO = {"mid_hip", "neck", "l_hip", "r_hip", "l_shoulder", "r_shoulder", "bottom_head"}


def interpolate(xyz: np.ndarray, skeleton: Skeleton, fps: float, through: Interpolation) -> np.ndarray:
    """(F, P, J, 3) with holes filled wherever there is something to go by.

    The frame is turned about the vertical as hips and shoulders are, smoothed. A hidden joint of the torso is
    placed by its interpolated offsets from those torso joints that are measured, a hidden joint of a limb
    by that from its parent; either is moved so that it meets what was measured before and after. Where the whole
    torso is hidden its root is interpolated in the world.

    Args:
        xyz: (F, P, J, 3) m, world; NaN where hidden.
        through: How offsets are interpolated over time.
    """
    world_from_body = _heading(xyz, skeleton, HEADING * fps)
    filled = xyz.copy()

    def offsets(joints: list[int], anchors: list[int]) -> np.ndarray:
        """(F, P, n, 3) from anchors to joints, interpolated over the frames that have both."""
        in_body = np.einsum("fpji,fpnj->fpni", world_from_body, xyz[:, :, joints] - xyz[:, :, anchors])
        return np.einsum("fpij,fpnj->fpni", world_from_body, through(in_body))

    def fill(joint: int, estimate: np.ndarray):
        # What misses the samples on both sides of a hole misses what is in it by about as much.
        missed = linear(xyz[:, :, joint] - estimate)
        estimate = estimate + np.where(np.isnan(missed), 0, missed)
        filled[:, :, joint] = np.where(np.isnan(filled[:, :, joint]), estimate, filled[:, :, joint])

    order = _from_root(skeleton)
    torso = [joint for joint in order if _part(skeleton, joint) in _TORSO]
    for joint in torso:
        anchors = [anchor for anchor in torso if anchor != joint]
        fill(joint, mean_known(xyz[:, :, anchors] + offsets([joint] * len(anchors), anchors), 2))
    # A root outside the torso, as COCO's nose, hangs on the torso all the same.
    parents = [torso[0] if parent < 0 and torso else parent for parent in skeleton.parents]
    hanging = [joint for joint in order if parents[joint] not in (-1, joint)]
    placed = dict(zip(hanging, np.moveaxis(offsets(hanging, [parents[j] for j in hanging]), 2, 0), strict=True))
    for joint in order:
        if joint in placed:
            fill(joint, filled[:, :, parents[joint]] + placed[joint])
        # The root, or a joint never measured together with its parent.
        fill(joint, through(filled[:, :, joint]))
    return filled


def _part(skeleton: Skeleton, joint: int) -> str:
    """A joint's name without the skeleton it has in a fused one."""
    return skeleton.joints[joint].rpartition(".")[2]


def _from_root(skeleton: Skeleton) -> list[int]:
    """All joints, parents first."""
    depth = []
    for joint in range(len(skeleton)):
        depth.append(0)
        while (joint := skeleton.parents[joint]) >= 0:
            depth[-1] += 1
    return [int(joint) for joint in np.argsort(depth, kind="stable")]


def _heading(xyz: np.ndarray, skeleton: Skeleton, reach: float) -> np.ndarray:
    """(F, P, 3, 3) world from body: rotations about the vertical, smoothed over `reach` frames.

    The heading is midway between that of the hips and that of the shoulders; where one of them is hidden,
    the other and the interpolated twist between them stand for it.
    """
    hips, shoulders = (_facing(xyz, skeleton, part) for part in ("l_hip", "l_shoulder"))
    twist = np.angle(np.exp(1j * (hips - shoulders)))
    twist = np.nan_to_num(linear(twist[..., None])[..., 0])
    turn = np.where(np.isnan(shoulders), hips - twist / 2, shoulders + twist / 2)
    # Interpolated as vectors: between two angles there are two ways round.
    facing = linear(np.stack([np.cos(turn), np.sin(turn)], -1))
    turn = np.unwrap(np.nan_to_num(np.arctan2(facing[..., 1], facing[..., 0])), axis=0)
    turn = local_parabola(turn[..., None], reach)[..., 0]
    cos, sin, zero, one = np.cos(turn), np.sin(turn), np.zeros_like(turn), np.ones_like(turn)
    return np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], -1).reshape(*turn.shape, 3, 3)


def _facing(xyz: np.ndarray, skeleton: Skeleton, part: str) -> np.ndarray:
    """(F, P) rad about the vertical of the line from a part's right-hand partner to it, NaN where unknown."""
    for left, right in enumerate(skeleton.mirror):
        if _part(skeleton, left) == part:
            across = xyz[:, :, left] - xyz[:, :, right]
            return np.arctan2(-across[..., 0], across[..., 1])
    return np.full(xyz.shape[:2], np.nan)
