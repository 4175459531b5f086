"""The world of a rig: its scale from stature, its vertical and floor from people who stand."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.calibration.gravity_and_scale import relative_size, upright_direction
from dmae.data.cameras import CameraRig
from dmae.data.skeleton import Skeleton

_ADULT_STATURE = 1.72
"""m, of the limbs that `relative_size` compares with."""
_UPRIGHT = 0.7
"""Smallest agreement of people in where up is."""
_FLOOR_PERCENTILE, _ANKLE_HEIGHT = 10, 0.09
"""Of the heights of ankles, those of feet on the floor; m."""


def place_world(
    rig: CameraRig, people: np.ndarray, skeleton: Skeleton, stature: float | None, level: bool
) -> CameraRig:
    """Return the rig in a world of another scale, or that stands upright on its floor.

    Args:
        people: (n, J, 3) measured people.
        stature: m, mean stature of the people; None to keep the scale.
        level: Whether to turn the world so that people stand along z, and to move the floor to z = 0.

    Raises:
        ValueError: too few people are measured, or they do not stand.
    """
    world, scale = np.eye(4), 1.0
    if stature is not None:
        size = relative_size(people, skeleton)
        if size is None:
            raise ValueError(f"stature={stature:g}: too few people are measured for a scale; leave stature out")
        scale = stature / (_ADULT_STATURE * size)
    if level:
        up = upright_direction(people, skeleton)
        if up is None or up[1] < _UPRIGHT:
            raise ValueError("level=true: too few people stand upright to determine the vertical; leave level out")
        world[:3, :3] = _turn_to_z(up[0])
        ankles = [i for i, joint in enumerate(skeleton.joints) if joint.endswith("ankle")]
        heights = (people[:, ankles] @ world[2, :3]) * scale
        world[2, 3] = _ANKLE_HEIGHT - np.nanpercentile(heights, _FLOOR_PERCENTILE)
    # new = scale * R old + t; what a camera sees stays if its distances scale as well.
    pose = rig.cam_from_world.copy()
    R = pose[:, :3, :3] @ world[:3, :3].T
    centres = scale * rig.centers @ world[:3, :3].T + world[:3, 3]
    pose[:, :3, :3], pose[:, :3, 3] = R, -(R @ centres[..., None])[..., 0]
    return replace(rig, cam_from_world=pose)


def _turn_to_z(up: np.ndarray) -> np.ndarray:
    """Return the smallest rotation (3, 3) that turns a direction (3,) to z."""
    axis, z = np.cross(up, (0, 0, 1)), up[2] / np.linalg.norm(up)
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return np.eye(3) if z > 0 else np.diag((1.0, -1.0, -1.0))
    return Rotation.from_rotvec(axis / sine * np.arctan2(sine, z)).as_matrix()
