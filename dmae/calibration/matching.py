"""Before an adjustment: the detections of each person in each view, and the first poses of cameras without extrinsics.

F frames, P people, V views, D detections a view, J joints.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.sparse.csgraph import breadth_first_order, minimum_spanning_tree

from dmae.calibration.bundle_adjustment import Calibration, Freedom, ImageTracks, Observations, adjust, coarse_skeleton
from dmae.calibration.world import relative_size
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.numerics.statistics import mean_known
from dmae.reconstruction.config import CaptureConfig, NoiseModel
from dmae.reconstruction.pipeline import capture
from dmae.reconstruction.triangulation import closest_approach

_NOISE = NoiseModel()
_MIN_SCORE = 0.2
_GATES = (0.6, 0.35, 0.25)
"""Largest mean distance of a detection from its person in each round, relative to the person's size in the image."""
_MIN_JOINTS = 5  # Smallest number of joints for which a detection and a person are compared
_ALIGNED_BODIES = 150  # Number of bodies for the alignment of a camera with people that the others measured


def match_tracks(clip: Clip) -> ImageTracks:
    """Match the detections of all views to the people that capture finds, including detections of a wrong camera.

    In each round, a camera is aligned with the people only to assign its detections again, with a narrower gate.
    """
    skeleton, kept = coarse_skeleton(clip.detections.skeleton)
    xyz = capture(clip, CaptureConfig()).xyz[:, :, kept].astype(np.float64)
    xy, score = clip.detections.xy[:, :, :, kept].astype(np.float64), clip.detections.score[:, :, :, kept]
    score = np.where(score >= _MIN_SCORE, score, np.nan)
    xy = np.where(np.isnan(score)[..., None], np.nan, xy)
    aligned = Calibration.of(clip.rig)
    for gate in _GATES:
        parts = [_assigned(aligned, view, xyz, xy[:, view], score[:, view], gate) for view in range(len(clip.rig))]
        tracks = ImageTracks(
            skeleton,
            clip.fps,
            np.stack([part[0] for part in parts], 2),
            _NOISE.sigma(np.stack([part[1] for part in parts], 2)),
            xyz,
        )
        if gate != _GATES[-1]:
            # Move each camera so that it fits the people, which do not move.
            some = Observations.of(tracks, _ALIGNED_BODIES)
            free = Freedom.of(len(clip.rig), rotation=True, centre=True)
            aligned = adjust(some, aligned, free, move_people=False, iterations=12).calibration
    return tracks


def _assigned(
    calibration: Calibration, view: int, xyz: np.ndarray, xy: np.ndarray, score: np.ndarray, gate: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the detections (F, P, J, 2) of one view (F, D, J, 2) that show the people (F, P, J, 3), and the scores."""
    expected = calibration.rig[[view]].project(xyz)[0][:, 0]
    low, high = np.fmin.reduce(xy, 2), np.fmax.reduce(xy, 2)
    size = np.maximum(np.hypot(*np.moveaxis(high - low, -1, 0)), 1)
    distance = np.linalg.norm(expected[:, :, None] - xy[:, None], axis=-1)
    common = np.isfinite(distance).sum(-1)
    cost = mean_known(np.minimum(distance / size[:, None, :, None], 2 * gate), -1)
    cost = np.where((common >= _MIN_JOINTS) & (cost < gate), cost, 10 * gate)
    found, scores = np.full(expected.shape, np.nan), np.full(expected.shape[:-1], np.nan)
    for frame, each in enumerate(cost):
        people, detections = linear_sum_assignment(each)
        near = each[people, detections] < gate
        found[frame, people[near]] = xy[frame, detections[near]]
        scores[frame, people[near]] = score[frame, detections[near]]
    return found, scores


_SURE_SCORE, _SURE_JOINTS, _MIN_FRAMES = 0.4, 6, 15
_MOST_POINTS = 4000
_THRESHOLD_PX = 4.0  # px from an epipolar line up to which a joint supports a pose
_MIN_INLIERS = 0.5  # Share of the joints that must support the pose of a pair of cameras


def initial_rig(clip: Clip) -> CameraRig:
    """Return the cameras of a clip at positions found from their detections; the positions in its rig are not read.

    The relative pose of two cameras comes from the essential matrix of the joints of a person that both see (Nister,
    PAMI 2004), its scale from the length of the limbs. The pairs that agree best are chained. The first camera is at
    the origin and looks along y, upright. Raises ValueError if too few frames show a single person in two cameras, or
    some cameras cannot be connected.
    """
    skeleton, kept = coarse_skeleton(clip.detections.skeleton)
    rig, found = clip.rig, clip.detections
    xy = np.where((found.score >= _SURE_SCORE)[..., None], found.xy, np.nan)[..., kept, :].astype(np.float64)
    present = np.isfinite(xy[..., 0]).sum(-1) >= _SURE_JOINTS
    alone = present.sum(2) == 1
    frame, view = np.indices(alone.shape)
    one = np.where(alone[..., None, None], xy[frame, view, present.argmax(2)], np.nan)
    ideal = rig.undistort(one)
    points = (ideal - rig.K[:, None, :2, 2]) @ np.linalg.inv(rig.K[:, :2, :2]).swapaxes(-1, -2)
    views, edges, support = len(rig), {}, np.zeros((len(rig),) * 2)
    for a, b in combinations(range(views), 2):
        pose = _relative_pose(points[:, a], points[:, b], float(rig.K[[a, b], 0, 0].mean()), skeleton)
        if pose is not None:
            edges[a, b], support[a, b] = pose
            edges[b, a] = np.linalg.inv(pose[0])
    order, parent = breadth_first_order(minimum_spanning_tree(np.where(support > 0, 1 / (1e-9 + support), 0)), 0, False)
    if len(order) < views:
        lost = ", ".join(name for view, name in enumerate(rig.names) if view not in order)
        raise ValueError(
            f"clip {clip.id!r}: cameras {lost} cannot be connected to camera {rig.names[0]}: too few frames show one "
            f"person alone in both of two cameras ({_MIN_FRAMES} are needed, some seconds are better); record "
            "one person who walks through the whole volume"
        )
    # Camera 0 looks along y of the world with an upright image, so z is up.
    poses = np.tile(np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]]), (views, 1, 1))
    for view in order[1:]:
        poses[view] = edges[int(parent[view]), int(view)] @ poses[parent[view]]
    return replace(rig, cam_from_world=poses)


def _relative_pose(a: np.ndarray, b: np.ndarray, focal: float, skeleton) -> tuple[np.ndarray, float] | None:
    """Return b_from_a (4, 4), m, from normalised joints (F, J, 2) of a person, and the number of supporting joints."""
    both = np.isfinite(a).all(-1) & np.isfinite(b).all(-1)
    if (both.sum(-1) >= _SURE_JOINTS).sum() < _MIN_FRAMES:
        return None
    step = both.sum() // _MOST_POINTS + 1
    first, second = a[both][::step], b[both][::step]
    cv2.setRNGSeed(0)
    E, _ = cv2.findEssentialMat(first, second, np.eye(3), cv2.RANSAC, 0.9999, _THRESHOLD_PX / focal)
    if E is None or E.shape != (3, 3):
        return None
    count, R, t, _ = cv2.recoverPose(E, first, second, np.eye(3))
    if count < _MIN_INLIERS * len(first):
        return None
    # The known size of people gives the distance between the cameras.
    rays_a = np.concatenate([a, np.ones_like(a[..., :1])], -1)
    rays_b = np.concatenate([b, np.ones_like(b[..., :1])], -1) @ R
    rays_a, rays_b = (rays / np.linalg.norm(rays, axis=-1, keepdims=True) for rays in (rays_a, rays_b))
    depth, other, sine2 = closest_approach(-(R.T @ t)[:, 0], rays_a, rays_b)
    people = np.where(((depth > 0) & (other > 0) & (sine2 > 0.01))[..., None], depth[..., None] * rays_a, np.nan)
    size = relative_size(people, skeleton)
    if size is None:
        return None
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = R, t[:, 0] / size
    return pose, float(count)
