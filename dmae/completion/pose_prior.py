"""How poses vary: for a person in a single frame, and for legs that no frame shows.

Poses about the mid hip, facing +x, are taken as Gaussian, with the mean and the covariance of the poses that a model
learned from. A joint that is seen is observed in all three directions, one that a single camera detected in the two
across its ray, any other in none; where the person stands is unknown. The most likely pose is then linear in the
observations. The floor is one more of them.
"""

import numpy as np

from dmae.completion.windows import in_window, mid_hip
from dmae.data.clip import Poses3D
from dmae.data.skeleton import Skeleton
from dmae.numerics.body import body_heading, rotate_z

_ERROR = 0.02
"""m along each axis; error of joints that are seen, and of rays."""
_ANYWHERE = 10.0
"""m along each axis; how far a person may be from where the middle of its joints suggests."""
_ANKLE, _ANKLE_ERROR = 0.07, 0.03
"""m; height of the ankle of a foot that stands, and its error."""
_ABOVE, _BELOW = 0.3, 1.0
"""m; feet higher above the floor than this rest on something else, such as a bed. Feet deeper below it than this show
that the floor is elsewhere."""
_SEEN_ON_FLOOR = 20  # Smallest number of measured feet that say where the floor is
ANKLES = Skeleton("ankles", ("l_ankle", "r_ankle"), (-1, -1))
"""The joints that show where the floor is."""


def pose_covariance(xyz: np.ndarray, skeleton: Skeleton, rest: np.ndarray) -> np.ndarray:
    """Return the covariance (3J, 3J) m^2 of bodies (..., J, 3) about the rest pose (J, 3); of whole bodies only.

    Raises KeyError if the skeleton has no hips.
    """
    flat, first = xyz.reshape(-1, *xyz.shape[-2:]).astype(np.float64), skeleton.parts[0]
    upright = in_window(flat, mid_hip(flat, first), body_heading(flat, first)) - rest
    whole = upright[~np.isnan(upright).any((1, 2))].reshape(-1, rest.size)
    return whole.T @ whole / max(len(whole), 1)


def likely_pose(poses: Poses3D, rest: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Return the most likely joints of each person in each frame by itself, (F, P, J, 3) m, world.

    Bodies whose heading is unknown, without both hips and both shoulders, face +x. NaN where a person has no joint.

    Args:
        rest: (J, 3) m, see `dmae.completion.windows.rest_pose`.
        covariance: (3J, 3J) m^2, see `pose_covariance`.
    """
    found = np.full(poses.xyz.shape, np.nan)
    prior = _anywhere(covariance)
    for person in zip(*np.nonzero(poses.measured.any(-1)), strict=True):
        seen = poses.measured[person][:, None]
        xyz, (start, along) = (x.astype(np.float64) for x in (poses.xyz[person], poses.rays[person].swapaxes(0, 1)))
        heading = np.nan_to_num(body_heading(xyz, poses.skeleton))
        origin = xyz[seen[:, 0]].mean(0)
        points = rotate_z(np.where(seen, xyz, np.nan_to_num(start)) - origin, -heading) - rest
        along = rotate_z(along, -heading)
        across = np.nan_to_num(np.eye(3) - along[:, :, None] * along[:, None], nan=0.0)
        weight = np.where(seen[..., None], np.eye(3), across) / _ERROR**2
        gain = np.einsum("kjc,jcd->kjd", prior.reshape(-1, len(rest), 3), weight).reshape(prior.shape)
        offset = np.linalg.solve(np.eye(len(prior)) + gain, gain @ points.reshape(-1))
        found[person] = rotate_z(rest + offset.reshape(-1, 3), heading) + origin
    return found


def lower_ankles(poses: Poses3D) -> np.ndarray:
    """Return the heights (n,), m, of the lower ankle of people in frames where both were measured."""
    ankles = list(poses.skeleton.index(*ANKLES.joints))
    height = np.where(poses.measured, poses.xyz[..., 2], np.nan)[:, :, ankles]
    return height[~np.isnan(height).any(-1)].min(-1)


def floor_height(lower: np.ndarray) -> float:
    """Return the height, m, of the floor below `lower_ankles`; 0 where there are few."""
    return float(np.median(lower)) - _ANKLE if len(lower) >= _SEEN_ON_FLOOR else 0.0


def stand_on_floor(
    xyz: np.ndarray, unknown: np.ndarray, floor: float, skeleton: Skeleton, covariance: np.ndarray
) -> np.ndarray:
    """Return joints (F, J, 3) m, world, of a person whose unknown joints were moved so that the feet are on the floor.

    The network completes legs that are never seen as straight legs. A person who sits at a table then has feet far
    below the floor. This function puts the lower foot on the floor and lifts any foot that is below it. The other
    unknown joints follow as poses vary, given the known joints: the update of a Kalman filter by an ankle's height.

    Args:
        xyz: NaN where the person is absent.
        unknown: (J,) True for joints without a measurement and without a ray in every frame.
        floor: m, height of the floor.
        covariance: (3J, 3J) m^2, see `pose_covariance`.
    """
    if not {"l_ankle", "r_ankle"} <= set(skeleton.joints):
        return xyz
    ankles = np.array(skeleton.index("l_ankle", "r_ankle"))
    below = floor + _ANKLE - xyz[:, ankles, 2].astype(np.float64)
    lower = np.arange(2) == np.nan_to_num(below, nan=-np.inf).argmax(1)[:, None]
    bound = (lower | (below > 0)) & unknown[ankles] & (below > -_ABOVE) & (below < _BELOW)
    if unknown.all() or not bound.any():
        return xyz
    known, prior, moved = np.repeat(~unknown, 3), _anywhere(covariance), xyz.copy()
    seen = prior[np.ix_(known, known)] + _ERROR**2 * np.eye(known.sum())
    left = prior - prior[:, known] @ np.linalg.solve(seen, prior[known])
    heading = np.nan_to_num(body_heading(xyz.astype(np.float64), skeleton))
    for feet in ([True, False], [False, True], [True, True]):
        frames = (bound == feet).all(1)
        height = 3 * ankles[feet] + 2
        innovation = left[np.ix_(height, height)] + _ANKLE_ERROR**2 * np.eye(len(height))
        gain = np.linalg.solve(innovation, left[height]).T
        step = (below[frames][:, feet] @ gain.T).reshape(-1, *xyz.shape[1:])
        moved[frames] += np.where(unknown[:, None], rotate_z(step, heading[frames, None]), 0)
    return moved


def _anywhere(covariance: np.ndarray) -> np.ndarray:
    """Return the covariance (3J, 3J) m^2 of joints of a person who may stand anywhere."""
    joints = len(covariance) // 3
    return covariance + _ANYWHERE**2 * np.kron(np.ones((joints, joints)), np.eye(3))
