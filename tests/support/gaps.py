"""Poses that lack joints, and motions to fill them in."""

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.clip import Poses3D
from dmae.data.skeleton import BODY25
from tests.support.clips import t_pose

FPS = 25.0


def without(poses: Poses3D, frames, persons, joints) -> Poses3D:
    """The poses with some joints of some persons absent in some frames."""
    xyz = poses.xyz.copy()
    which = (frames, persons, joints)
    index = (np.atleast_1d(np.arange(length)[chosen]) for length, chosen in zip(xyz.shape, which, strict=False))
    xyz[np.ix_(*index)] = np.nan
    return Poses3D(poses.skeleton, xyz)


def turning(frames: int = 60, skeleton=BODY25) -> Poses3D:
    """A rigid T-pose that turns once about the vertical while its root speeds up along a curve."""
    time = np.arange(frames) / FPS
    R = Rotation.from_rotvec(np.outer(2 * np.pi * np.arange(frames) / frames, (0, 0, 1))).as_matrix()
    path = np.stack([time**2, np.sin(time), 0 * time], -1)
    return Poses3D(skeleton, (np.einsum("fij,kj->fki", R, t_pose(skeleton)) + path[:, None])[:, None])
