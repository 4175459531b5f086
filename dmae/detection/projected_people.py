"""Captured people projected into images: which cameras missed them, and which detections are parts of them.

Shapes: F frames, V views, D detections in a view, P persons, J joints.
"""

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.data.cameras import CameraRig
from dmae.data.clip import Detections2D, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.numerics.body import distance_to_bones
from dmae.numerics.statistics import median_over_frames

_SAME = 0.3
"""Largest median distance between the joints of a detection and of a projected person that are one, relative to the
radius of the body in the image."""
_FORBIDDEN = 1e3
"""Cost of a pair that is farther apart."""
_TORSO = ("l_shoulder", "r_shoulder", "l_hip", "r_hip")
"""Joints that must be known of a person that is searched."""
_LEAST_INSIDE = 0.5
"""Smallest share of a person's joints that must project into an image."""
_SMALLER, _ON_BODY, _MOST_JOINTS = 0.5, 0.2, 0.9
"""A detection is a part of a person if it is no person (`_SAME`), its size is at most this share of the person's, and
this share of its joints is within this distance from the person's bones, relative to the radius of the body."""


def missed_people(poses: Poses3D, rig: CameraRig, detections: Detections2D) -> dict[tuple[int, int], np.ndarray]:
    """Return the people that views missed, by frame and view: where their joints are expected, (n, J, 2) px.

    A person that is captured in a frame is missed by a view if at least half of its joints project into the image and
    no detection near the projection is left for it. Each detection counts for one person, also where people overlap.

    Args:
        poses: The people, captured from the detections.
    """
    torso = poses.skeleton.index(*_TORSO)
    known = np.isfinite(poses.xyz[:, :, torso]).all((-1, -2))
    missed = {}
    for frame in np.flatnonzero(known.any(1)).tolist():
        projected, inside = _project(poses, rig, frame, known[frame])
        inside &= np.isfinite(projected[:, :, torso]).all((-1, -2))
        distance = _distances(detections.xy[frame], projected) / body_radius(projected, poses.skeleton)[:, None]
        gone = inside & ~_assigned(distance)
        for view in np.flatnonzero(gone.any(1)).tolist():
            missed[frame, view] = projected[view, gone[view]]
    return missed


def parts_of_people(poses: Poses3D, rig: CameraRig, detections: Detections2D) -> np.ndarray:
    """Return (F, V, D) True for detections that are parts of people, for example a small body found in long hair.

    Such a detection is much smaller than a captured person in the same image, lies on the bones of that person, and is
    near no captured person. A real person of that size would be hidden by the larger one, or captured by other cameras.

    Args:
        poses: The people, captured from the detections.
    """
    parts = np.zeros(detections.xy.shape[:3], bool)
    sizes = _size(detections.xy)
    known = np.isfinite(poses.xyz).all(-1).any(-1)
    for frame in np.flatnonzero(known.any(1)).tolist():
        projected, _ = _project(poses, rig, frame, known[frame])
        radius = body_radius(projected, poses.skeleton)[:, None]
        distance = _distances(detections.xy[frame], projected) / radius
        explained = (distance < _SAME).any(-1)
        smaller = sizes[frame][..., None] < _SMALLER * _size(projected)[:, None]
        for view, detection, person in np.argwhere(smaller & ~explained[..., None]).tolist():
            places = detections.xy[frame, view, detection]
            places = places[np.isfinite(places).all(-1)]
            apart = distance_to_bones(places, projected[view, person], poses.skeleton.bones)
            on_body = apart < _ON_BODY * radius[view, 0, person]
            parts[frame, view, detection] |= on_body.mean() >= _MOST_JOINTS
    return parts


def body_radius(xy: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the largest distance of joints (..., J, 2) from the middle of the hips, px; NaN where unknown."""
    hips = xy[..., skeleton.index("l_hip", "r_hip"), :].mean(-2, keepdims=True)
    return np.fmax.reduce(np.linalg.norm(xy - hips, axis=-1), -1)


def _project(poses: Poses3D, rig: CameraRig, frame: int, persons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return some persons of a frame, (V, n, J, 2) px, and whether most of each is inside the images, (V, n)."""
    projected, _ = rig.project(poses.xyz[frame : frame + 1, persons])
    return projected[0], rig.inside(projected)[0].mean(-1) >= _LEAST_INSIDE


def _distances(xy: np.ndarray, projected: np.ndarray) -> np.ndarray:
    """Return the median distance of the joints of detections (V, D, J, 2) and persons (V, P, J, 2), (V, D, P) px.

    NaN where they have no joint in common.
    """
    distance = np.linalg.norm(xy[:, :, None] - projected[:, None], axis=-1)
    return median_over_frames(np.moveaxis(distance, -1, 0))


def _assigned(distance: np.ndarray) -> np.ndarray:
    """Return (V, P) True for persons to which a detection of the view is assigned, by distances (V, D, P)."""
    assigned = np.zeros((len(distance), distance.shape[2]), bool)
    cost = np.where(distance < _SAME, distance, _FORBIDDEN)
    for view, each in enumerate(cost):
        rows, columns = linear_sum_assignment(each)
        assigned[view, columns[each[rows, columns] < _FORBIDDEN]] = True
    return assigned


def _size(xy: np.ndarray) -> np.ndarray:
    """Return the diagonals of the upright boxes around joints (..., J, 2), px; NaN where no joint is known."""
    return np.linalg.norm(np.fmax.reduce(xy, -2) - np.fmin.reduce(xy, -2), axis=-1)
