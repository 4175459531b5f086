"""Stills: a person in a single frame, whom no other frame helps to complete.

Poses about the mid hip, facing +x, are taken as Gaussian, with the mean and the covariance of the poses that a model
learned from. A joint that is seen is observed in all three directions, one that a single camera detected in the two
across its ray, any other in none; where the person stands is unknown. The most likely pose is then linear in the
observations.
"""

import numpy as np

from dmae.completion.windows import Normalisation, mid_hip
from dmae.data.clip import Poses3D
from dmae.data.skeleton import Skeleton
from dmae.numerics.body import body_heading, rotate_z

_ERROR = 0.02
"""m along each axis; error of joints that are seen, and of rays."""
_ANYWHERE = 10.0
"""m along each axis; how far a person may be from where the middle of its joints suggests."""


def pose_covariance(xyz: np.ndarray, skeleton: Skeleton, rest: np.ndarray) -> np.ndarray:
    """Return the covariance (3J, 3J) m^2 of bodies (..., J, 3) about the rest pose (J, 3); of whole bodies only.

    Raises:
        KeyError: the skeleton has no hips.
    """
    flat, first = xyz.reshape(-1, *xyz.shape[-2:]).astype(np.float64), skeleton.parts[0]
    upright = Normalisation(mid_hip(flat, first), body_heading(flat, first)).apply(flat) - rest
    whole = upright[~np.isnan(upright).any((1, 2))].reshape(-1, rest.size)
    return whole.T @ whole / max(len(whole), 1)


def likely_pose(poses: Poses3D, rest: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the most likely joints of each person in each frame by itself, (F, P, J, 3) m, world.

    Bodies whose heading is unknown, without both hips and both shoulders, face +x. NaN where a person has no joint.

    Args:
        rest: (J, 3) m, see `dmae.completion.windows.rest_pose`.
        covariance: (3J, 3J) m^2, see `pose_covariance`.
    """
    joints = len(rest)
    found = np.full(poses.xyz.shape, np.nan)
    prior = covariance + _ANYWHERE**2 * np.kron(np.ones((joints, joints)), np.eye(3))
    for person in zip(*np.nonzero(poses.measured.any(-1)), strict=True):
        seen = poses.measured[person][:, None]
        xyz, (start, along) = (x.astype(np.float64) for x in (poses.xyz[person], poses.rays[person].swapaxes(0, 1)))
        heading = np.nan_to_num(body_heading(xyz, poses.skeleton))
        origin = xyz[seen[:, 0]].mean(0)
        points = rotate_z(np.where(seen, xyz, np.nan_to_num(start)) - origin, -heading) - rest
        along = rotate_z(along, -heading)
        across = np.nan_to_num(np.eye(3) - along[:, :, None] * along[:, None], nan=0.0)
        weight = np.where(seen[..., None], np.eye(3), across) / _ERROR**2
        gain = np.einsum("kjc,jcd->kjd", prior.reshape(-1, joints, 3), weight).reshape(prior.shape)
        offset = np.linalg.solve(np.eye(len(prior)) + gain, gain @ points.reshape(-1))
        found[person] = rotate_z(rest + offset.reshape(-1, 3), heading) + origin
    return found
