"""Occlusion by bodies: the distance between each camera's line of sight to a joint and the bones in front of it."""

import numpy as np

from dmae.data.skeleton import Skeleton

_POINTS = np.linspace(0, 1, 5)
"""Places along a bone, as shares of its length, at which its distance from a line of sight is taken."""
_TRUNK = ("hip", "shoulder", "neck")
_RADII = (0.05, 0.13)
"""m; half the thickness of a limb or head, and of the trunk."""
_AHEAD = 0.15
"""m; points that are nearer than this to a joint, along the line of sight, do not hide it."""
_APART = 3
"""A bone hides a joint of the same body if it is this many bones away."""


def clearance(centres: np.ndarray, joints: np.ndarray, bodies: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return distances (F, V, P, J), m, from the line of sight to each joint to the surface of the nearest other body.

    It is negative where a body hides the joint, NaN where the joint is unknown, and infinite where no body is known.

    Args:
        centres: (V, 3) camera centres, m, world.
        joints: (F, P, J, 3) joints to be seen, m.
        bodies: (F, B, J, 3) bodies that hide them, m.
        skeleton: Skeleton of the bodies.
    """
    points, radii = _surface(bodies, skeleton)
    flat = points.reshape(len(points), -1, 3)
    return _clearance(centres, joints, flat, np.tile(radii.ravel(), bodies.shape[1]))


def clearance_of_others(centres: np.ndarray, joints: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return `clearance` of the joints of each person (F, P, J, 3) from all other persons."""
    people = np.arange(joints.shape[1])
    parts = [clearance(centres, joints[:, [p]], joints[:, people != p], skeleton) for p in people]
    return np.concatenate(parts, 2) if parts else np.empty((len(joints), len(centres), 0, len(skeleton)))


def clearance_of_self(centres: np.ndarray, joints: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return `clearance` of the joints of each person (F, P, J, 3) from far parts of the same body."""
    far = _bones_between(skeleton) >= _APART  # (J, bones)
    points, radii = _surface(joints, skeleton)  # (F, P, bones, points, 3)
    parts = np.full((len(joints), len(centres), *joints.shape[1:3]), np.inf)
    for person in range(joints.shape[1]):
        for joint in range(len(skeleton)):
            bones = points[:, person, far[joint]].reshape(len(points), -1, 3)
            sight = joints[:, person : person + 1, joint : joint + 1]
            parts[:, :, person, joint] = _clearance(centres, sight, bones, radii[far[joint]].ravel())[:, :, 0, 0]
    return parts


def _surface(bodies: np.ndarray, skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Return points (F, B, bones, points, 3) along the bones of bodies, and radii (bones, points), m."""
    start, end = np.array(skeleton.bones, int).reshape(-1, 2).T
    along = _POINTS[:, None]
    points = bodies[:, :, start, None] * (1 - along) + bodies[:, :, end, None] * along
    trunk = [all(any(part in skeleton.joints[i] for part in _TRUNK) for i in bone) for bone in skeleton.bones]
    return points, np.repeat(np.where(trunk, _RADII[1], _RADII[0])[:, None], len(_POINTS), 1)


def _clearance(centres: np.ndarray, joints: np.ndarray, points: np.ndarray, radii: np.ndarray) -> np.ndarray:
    """Return distances (F, V, P, J) from lines of sight to joints (F, P, J, 3) to points (F, N, 3), less radii (N,).

    Frames are processed one at a time, as there are many pairs of a line and a point.
    """
    frames, people, skeleton = joints.shape[:3]
    found = np.full((frames, len(centres), people * skeleton), np.inf)
    for frame in range(frames):
        known = ~np.isnan(points[frame]).any(-1)
        sight = joints[frame].reshape(1, -1, 3) - centres[:, None]  # (V, P J, 3)
        length = np.linalg.norm(sight, axis=-1)
        found[frame][np.isnan(length)] = np.nan
        if not known.any():
            continue
        to_point = points[frame][known] - centres[:, None]  # (V, N, 3)
        along = (sight / length[..., None]) @ to_point.swapaxes(1, 2)  # (V, P J, N)
        before = np.clip(along, 0, np.maximum(length - _AHEAD, 0)[..., None])
        square = (to_point**2).sum(-1)[:, None] + before * (before - 2 * along)
        found[frame] = (np.sqrt(np.maximum(square, 0)) - radii[known]).min(-1)
    return found.reshape(frames, len(centres), people, skeleton)


def _bones_between(skeleton: Skeleton) -> np.ndarray:
    """Return the number of bones between each joint and each bone, (J, bones); 0 if the joint is an end of the bone."""
    steps = np.full((len(skeleton), len(skeleton)), np.inf)
    np.fill_diagonal(steps, 0)
    for a, b in skeleton.bones:
        steps[a, b] = steps[b, a] = 1
    for middle in range(len(skeleton)):
        steps = np.minimum(steps, steps[:, [middle]] + steps[[middle]])
    start, end = np.array(skeleton.bones, int).reshape(-1, 2).T
    return np.minimum(steps[:, start], steps[:, end])
