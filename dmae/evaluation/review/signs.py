"""Signs that a joint is off. Each is a distance in metres, and none needs the truth."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import maximum_filter1d

from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert, scale_of
from dmae.evaluation.report.reprojection import reprojection_errors

_UNKNOWN = 0.2
"""m; the error that is assumed for people if none is stated."""
_FRAMES = 200
"""Frames that are compared at a time, so that memory stays flat."""
_REACH = 0.04
"""s before and after a frame, between which a joint is interpolated."""

STATED, UNSTATED, BONE, JUMP, RESIDUAL = "stated error", "no stated error", "bone length", "jump", "reprojection"


def signs(clip: Clip) -> dict[str, np.ndarray]:
    """Return the signs of each joint by name, (F, P, J) m; 0 where a sign does not apply.

    - stated error: the square root of the trace of its covariance.
    - no stated error: 0.2 m for people if the covariance is not known; less for smaller bodies.
    - bone length: the largest deviation of its bones from their median length over the clip.
    - jump: its distance from the middle of its positions just before and just after, the largest in that time.
    - reprojection: the median distance from its detections, at its depth.
    """
    # Files cannot hold infinite coordinates, but users can.
    poses = clip.poses.without(np.isinf(clip.poses.xyz).any(-1))
    clip = replace(clip, poses=poses)
    stated = np.sqrt(np.trace(poses.cov.astype(np.float64), axis1=-2, axis2=-1))
    return {
        STATED: np.nan_to_num(stated),
        UNSTATED: np.where(np.isnan(stated), _UNKNOWN * scale_of(poses), 0),
        BONE: _bone_deviation(poses),
        JUMP: _jump(poses, clip.fps),
        RESIDUAL: _residual(clip),
    }


def _bone_deviation(poses: Poses3D) -> np.ndarray:
    parents = np.asarray(poses.skeleton.parents)
    children = np.flatnonzero(parents >= 0)
    xyz = poses.xyz.astype(np.float64)
    found = np.zeros(poses.source.shape)
    for child in children:
        length = np.linalg.norm(xyz[..., child, :] - xyz[..., parents[child], :], axis=-1)
        for person in range(length.shape[1]):
            if np.isfinite(length[:, person]).any():
                length[:, person] -= np.nanmedian(length[:, person])
        deviation = np.nan_to_num(np.abs(length))
        for end in (child, parents[child]):
            found[..., end] = np.maximum(found[..., end], deviation)
    return found


def _jump(poses: Poses3D, fps: float) -> np.ndarray:
    step = max(1, round(_REACH * fps))
    xyz = poses.xyz.astype(np.float64)
    found = np.zeros(poses.source.shape)
    if len(xyz) > 2 * step:
        middle = (xyz[2 * step :] + xyz[: -2 * step]) / 2
        found[step:-step] = np.nan_to_num(np.linalg.norm(xyz[step:-step] - middle, axis=-1))
    return maximum_filter1d(found, 4 * step + 1, axis=0, mode="constant")


def _residual(clip: Clip) -> np.ndarray:
    skeleton = clip.detections.skeleton
    poses = convert(clip.poses, skeleton)
    found = np.zeros(clip.poses.source.shape)
    for start in range(0, len(clip), _FRAMES):
        part = slice(start, start + _FRAMES)
        some = poses.select(part)
        _, depth = clip.rig.project(some.xyz)
        metres = reprojection_errors(clip.select(frames=part), some) * depth / clip.rig.K[:, 0, 0, None, None]
        # Joints without any detection have residual 0; `nanmedian` would warn of them.
        metres = np.where(np.isnan(metres).all(1, keepdims=True), 0, metres)
        median = np.nanmedian(metres, axis=1)
        for index, joint in enumerate(clip.poses.skeleton.joints):
            if joint in skeleton.joints:
                found[part, :, index] = median[..., skeleton.joints.index(joint)]
    return found
