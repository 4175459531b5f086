"""Placement of a rig or a clip in another world: with another scale, or upright on the floor."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dmae.calibration.world.floor import Floor, turn_to_z
from dmae.calibration.world.gravity_and_scale import relative_size, upright_direction
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.files.mapped import by_frames

FLOOR_KEY = "floor_m"
"""Key of a clip's provenance: z of the floor in a recording, m, if it is not 0."""
_ADULT_STATURE = 1.72
"""m, stature of the adult with which `relative_size` compares people."""
_UPRIGHT = 0.7
"""Smallest agreement of people on the vertical direction."""
_FLOOR_PERCENTILE, _ANKLE_HEIGHT = 10, 0.09
"""Percentile of the heights of ankles that belongs to feet on the floor; height of an ankle above the floor, m."""


def place_world(
    rig: CameraRig, people: np.ndarray, skeleton: Skeleton, stature: float | None, level: bool
) -> CameraRig:
    """Return the rig in a world with another scale, or in an upright world with its floor at z = 0.

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
        world[:3, :3] = turn_to_z(up[0])
        ankles = [i for i, joint in enumerate(skeleton.joints) if joint.endswith("ankle")]
        heights = (people[:, ankles] @ world[2, :3]) * scale
        world[2, 3] = _ANKLE_HEIGHT - np.nanpercentile(heights, _FLOOR_PERCENTILE)
    return _placed(rig, world, scale)


def upright_world(floor: Floor) -> np.ndarray | None:
    """Return new_from_old (4, 4) of an upright world with its floor at z = 0, as far as these are determined.

    The rotation is about the point on the floor, or about the origin. None if nothing is determined.
    """
    if floor.up is None and floor.height_m is None:
        return None
    world = np.eye(4)
    place = np.array(floor.place or (0, 0, 0))
    if floor.up is not None:
        world[:3, :3] = turn_to_z(np.array(floor.up))
    world[:3, 3] = place - world[:3, :3] @ place
    world[2, 3] -= place[2]
    return world


def place_clip(clip: Clip, world: np.ndarray) -> Clip:
    """Return a clip in another world, new_from_old (4, 4): cameras, truth and poses change, pixels do not."""
    provenance = {key: value for key, value in clip.provenance.items() if key != FLOOR_KEY}
    return replace(
        clip,
        rig=place_rig(clip.rig, world),
        true_rig=None if clip.true_rig is None else place_rig(clip.true_rig, world),
        truth=None if clip.truth is None else _placed_poses(clip.truth, world),
        poses=None if clip.poses is None else _placed_poses(clip.poses, world),
        provenance=provenance,
    )


def place_rig(rig: CameraRig, world: np.ndarray) -> CameraRig:
    """Return a rig in another world, new_from_old (4, 4)."""
    return _placed(rig, world, 1.0)


def _placed_poses(poses: Poses3D, world: np.ndarray) -> Poses3D:
    R, t = world[:3, :3], world[:3, 3]

    def placed(move: Callable[[np.ndarray], np.ndarray], values: np.ndarray) -> np.ndarray:
        return by_frames(lambda values: move(values).astype(np.float32), values)

    return replace(
        poses,
        xyz=placed(lambda xyz: xyz @ R.T + t, poses.xyz),
        cov=placed(lambda cov: R @ cov @ R.T, poses.cov),
        rays=placed(lambda rays: np.stack([rays[..., 0, :] @ R.T + t, rays[..., 1, :] @ R.T], -2), poses.rays),
    )


def _placed(rig: CameraRig, world: np.ndarray, scale: float) -> CameraRig:
    # new = scale * R old + t; the pixels do not change if the translation of the camera is scaled as well.
    pose = rig.cam_from_world.copy()
    R = pose[:, :3, :3] @ world[:3, :3].T
    centres = scale * rig.centers @ world[:3, :3].T + world[:3, 3]
    pose[:, :3, :3], pose[:, :3, 3] = R, -(R @ centres[..., None])[..., 0]
    return replace(rig, cam_from_world=pose)
