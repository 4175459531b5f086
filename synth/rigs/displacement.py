"""Random displacement of cameras, and checks of its standard deviations."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from synth.rigs.camera_geometry import pose


def displace(rig: CameraRig, position: float, rotation: float, *, rng: np.random.Generator) -> CameraRig:
    """Return the rig with each camera moved and turned at random, normally distributed.

    Args:
        rig: V cameras.
        position, rotation: Standard deviations along each axis, m, and about each axis, rad.
        rng: Draws both.
    """
    shift, turn = rng.normal(size=(2, len(rig), 3))
    turned = Rotation.from_rotvec(rotation * turn).as_matrix() @ rig.cam_from_world[:, :3, :3]
    return replace(rig, cam_from_world=pose(turned, rig.centers + position * shift))


def check_deviations(group: str, config) -> None:
    """Raise ValueError if a field is not a valid standard deviation; the message names the field."""
    for name, value in vars(config).items():
        if not 0 <= value < np.inf:
            raise ValueError(f"{group}.{name}: expected a standard deviation, 0 or more, got {value}")
