"""Placement: a rig, or a clip, in a world of another scale, or one that stands upright on its floor."""

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
"""Key of a clip's provenance: m, the z at which a recording has its floor, where it is not 0."""
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
        world[:3, :3] = turn_to_z(up[0])
        ankles = [i for i, joint in enumerate(skeleton.joints) if joint.endswith("ankle")]
        heights = (people[:, ankles] @ world[2, :3]) * scale
        world[2, 3] = _ANKLE_HEIGHT - np.nanpercentile(heights, _FLOOR_PERCENTILE)
    return _placed(rig, world, scale)


def upright_world(floor: Floor) -> np.ndarray | None:
    """Return new_from_old (4, 4) of a world that stands upright on its floor, as far as they are determined.

    It turns about the place on the floor, or about the origin. None if nothing is determined.
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
    """Return a clip in another world, new_from_old (4, 4): cameras, truth and poses; what cameras see stays."""
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
    # new = scale * R old + t; what a camera sees stays if its distances scale as well.
    pose = rig.cam_from_world.copy()
    R = pose[:, :3, :3] @ world[:3, :3].T
    centres = scale * rig.centers @ world[:3, :3].T + world[:3, 3]
    pose[:, :3, :3], pose[:, :3, 3] = R, -(R @ centres[..., None])[..., 0]
    return replace(rig, cam_from_world=pose)
