"""Filling what no camera measured without learning: the methods a learned completion has to beat."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.ndimage import correlate1d

from dmae.clip import Poses3D, Source
from dmae.gaps import neighbours
from dmae.metrics import mean_known
from dmae.skeleton import Skeleton

LONGEST_ABSENCE = 1.0
"""s; a person of whom nothing was measured for longer is taken to have left, and is not invented."""

LONGEST_HOLD = 0.5
"""s; how long a joint stays as first or last measured before its first and after its last measurement."""


HEADING = 0.2
"""s over which the direction that a body faces is smoothed: hips are a narrow base to tell it from."""


def present(poses: Poses3D, fps: float) -> np.ndarray:
    """(F, P) True where a person is there: measured, or missing for at most `LONGEST_ABSENCE` between sightings."""
    seen = (poses.source != Source.ABSENT).any(-1)
    before, after = neighbours(seen)
    inside = (before >= 0) & (after < len(seen))
    return seen | (inside & (after - before - 1 <= LONGEST_ABSENCE * fps))


def _fill(poses: Poses3D, fps: float, estimate: np.ndarray) -> Poses3D:
    """Take an estimate (F, P, J, 3) where a joint is absent, its person present, and a measurement near enough."""
    observed = poses.source != Source.ABSENT
    before, after = neighbours(observed)
    inside = (before >= 0) & (after < len(observed))
    index = np.arange(len(observed))[:, None, None]
    since = np.where(before >= 0, index - before, len(observed))
    until = np.where(after < len(observed), after - index, len(observed))
    held = (before >= 0) ^ (after < len(observed))
    near = inside | (held & (np.minimum(since, until) <= LONGEST_HOLD * fps))
    filled = ~observed & near & present(poses, fps)[..., None] & ~np.isnan(estimate).any(-1)
    return Poses3D(
        poses.skeleton,
        np.where(filled[..., None], estimate, poses.xyz),
        np.where(filled, Source.COMPLETED, poses.source),
        poses.cov,
        poses.views,
    )


def _hold(values: np.ndarray) -> np.ndarray:
    """(F, ..., 3) with each gap as it last was; before the first sample, as it first is."""
    before, after = neighbours(~np.isnan(values).any(-1))
    return _gather(values, np.where(before >= 0, before, after))


def _linear(values: np.ndarray) -> np.ndarray:
    """(F, ..., 3) with gaps interpolated in a straight line, held before the first and after the last sample."""
    frames = len(values)
    before, after = neighbours(~np.isnan(values).any(-1))
    start = np.where(before >= 0, before, after)
    end = np.where(after < frames, after, before)
    index = np.arange(frames).reshape(-1, *(1,) * (before.ndim - 1))
    share = np.where(end > start, (index - start) / np.maximum(end - start, 1), 0)[..., None]
    first = _gather(values, start)
    return first + share * (_gather(values, end) - first)


def _gather(values: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Values (F, ..., 3) of other frames (F, ...); NaN where the frame is none."""
    inside = (frame >= 0) & (frame < len(values))
    taken = np.take_along_axis(values, np.where(inside, frame, 0)[..., None], 0)
    return np.where(inside[..., None], taken, np.nan)


def _pchip(values: np.ndarray) -> np.ndarray:
    """(F, ..., 3) with gaps interpolated by a monotone cubic, held before the first and after the last sample."""
    flat = values.reshape(len(values), -1, 3)
    filled = _hold(flat)
    for column in range(flat.shape[1]):
        known = np.flatnonzero(~np.isnan(flat[:, column]).any(-1))
        if 2 < len(known) < len(flat):
            inside = slice(known[0], known[-1] + 1)
            filled[inside, column] = PchipInterpolator(known, flat[known, column])(np.arange(known[0], known[-1] + 1))
        elif len(known) == 2:
            filled[:, column] = _linear(flat[:, column])
    return filled.reshape(values.shape)


def fill_hold(poses: Poses3D, fps: float) -> Poses3D:
    """Fill with the last measurement (the next one, before the first)."""
    return _fill(poses, fps, _hold(poses.xyz.astype(np.float64)))


def fill_linear(poses: Poses3D, fps: float) -> Poses3D:
    """Fill by straight lines in the world between the measurements on both sides.

    However long a joint is hidden, its gap is filled while its person is `present`; before its first
    and after its last measurement it is held for `LONGEST_HOLD`. What is filled is `COMPLETED`, used no
    views and has no covariance. This holds for every method of this module.

    Args:
        fps: Frames per second of the poses.
    """
    return _fill(poses, fps, _linear(poses.xyz.astype(np.float64)))


def fill_pchip(poses: Poses3D, fps: float) -> Poses3D:
    """Fill by monotone cubics (Fritsch & Butland 1984) in the world."""
    return _fill(poses, fps, _pchip(poses.xyz.astype(np.float64)))


def fill_bodyframe(poses: Poses3D, fps: float) -> Poses3D:
    """Fill by monotone cubics of what moves least: offsets between joints, in a frame that turns with the body.

    The frame is turned about the vertical as hips and shoulders are, smoothed. A hidden joint of the torso is
    placed by its interpolated offsets from those torso joints that are measured, a hidden joint of a limb
    by that from its parent. Where the whole torso is hidden its root is interpolated in the world.
    """
    skeleton = poses.skeleton
    xyz = poses.xyz.astype(np.float64)
    world_from_body = _heading(xyz, skeleton, HEADING * fps)
    filled = xyz.copy()

    def offset(joint: int, anchor: int) -> np.ndarray:
        """(F, P, 3) from anchor to joint, interpolated over the frames that have both."""
        in_body = np.einsum("fpji,fpj->fpi", world_from_body, xyz[:, :, joint] - xyz[:, :, anchor])
        return np.einsum("fpij,fpj->fpi", world_from_body, _pchip(in_body))

    def fill(joint: int, estimate: np.ndarray):
        filled[:, :, joint] = np.where(np.isnan(filled[:, :, joint]), estimate, filled[:, :, joint])

    order = _from_root(skeleton)
    torso = [joint for joint in order if _part(skeleton, joint) in _TORSO]
    for joint in torso:
        anchored = [xyz[:, :, anchor] + offset(joint, anchor) for anchor in torso if anchor != joint]
        if anchored:
            fill(joint, mean_known(np.stack(anchored)))
    for joint in order:
        # A root outside the torso, as COCO's nose, hangs on the torso all the same.
        parent = torso[0] if skeleton.parents[joint] < 0 and torso else skeleton.parents[joint]
        if parent not in (-1, joint):
            fill(joint, filled[:, :, parent] + offset(joint, parent))
        # The root, or a joint never measured together with its parent.
        fill(joint, _pchip(filled[:, :, joint]))
    return _fill(poses, fps, filled)


_TORSO = {"mid_hip", "neck", "l_hip", "r_hip", "l_shoulder", "r_shoulder", "bottom_head"}


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
    twist = np.nan_to_num(_linear(twist[..., None])[..., 0])
    turn = np.where(np.isnan(shoulders), hips - twist / 2, shoulders + twist / 2)
    # Interpolated as vectors: between two angles there are two ways round.
    facing = _linear(np.stack([np.cos(turn), np.sin(turn)], -1))
    turn = np.unwrap(np.nan_to_num(np.arctan2(facing[..., 1], facing[..., 0])), axis=0)
    turn = _local_parabola(turn[..., None], reach)[..., 0]
    cos, sin, zero, one = np.cos(turn), np.sin(turn), np.zeros_like(turn), np.ones_like(turn)
    return np.stack([cos, -sin, zero, sin, cos, zero, zero, zero, one], -1).reshape(*turn.shape, 3, 3)


def _facing(xyz: np.ndarray, skeleton: Skeleton, part: str) -> np.ndarray:
    """(F, P) rad about the vertical of the line from a part's right-hand partner to it, NaN where unknown."""
    for left, right in enumerate(skeleton.mirror):
        if _part(skeleton, left) == part:
            across = xyz[:, :, left] - xyz[:, :, right]
            return np.arctan2(-across[..., 0], across[..., 1])
    return np.full(xyz.shape[:2], np.nan)


def smooth(poses: Poses3D, fps: float, seconds: float) -> Poses3D:
    """Light smoothing without delay: at each frame the parabola that fits best around it, Gaussian weights.

    Motion at constant acceleration passes unchanged; absent joints stay absent and have no weight.
    Measured joints become `DENOISED`; covariances stay as they were, now upper bounds.

    Args:
        fps: Frames per second of the poses.
        seconds: Standard deviation of the weights; 0 leaves the poses as they are.
    """
    if seconds == 0:
        return poses
    return replace(
        poses,
        xyz=_local_parabola(poses.xyz.astype(np.float64), seconds * fps),
        source=np.where(poses.source == Source.MEASURED, Source.DENOISED, poses.source),
    )


def _local_parabola(values: np.ndarray, reach: float) -> np.ndarray:
    """(F, ..., C) smoothed over time by weighted least squares; `reach` is the weights' deviation in frames."""
    observed = ~np.isnan(values).any(-1)
    lag = np.arange(-int(np.ceil(3 * reach)), int(np.ceil(3 * reach)) + 1) / reach
    known = np.where(observed[..., None], values, 0)

    def moment(array: np.ndarray, power: int) -> np.ndarray:
        return correlate1d(array, np.exp(-0.5 * lag**2) * lag**power, axis=0, mode="constant")

    moments = [moment(observed.astype(float), power) for power in range(5)]
    left = np.stack([np.stack(moments[row : row + 3], -1) for row in range(3)], -2)
    right = np.stack([moment(known, power) for power in range(3)], -2)
    # One or two samples do not make a parabola; the ridge then takes the flattest.
    left = left + np.diag([0, 1e-6, 1e-6]) + np.where(observed, 0, 1)[..., None, None] * np.eye(3)
    return np.where(observed[..., None], np.linalg.solve(left, right)[..., 0, :], np.nan)


METHODS: dict[str, Callable[[Poses3D, float], Poses3D]] = {
    "measured": lambda poses, fps: poses,
    "hold": fill_hold,
    "linear": fill_linear,
    "pchip": fill_pchip,
    "bodyframe": fill_bodyframe,
}
"""What is done about joints that no camera measured, by name; each takes poses and frames per second."""
