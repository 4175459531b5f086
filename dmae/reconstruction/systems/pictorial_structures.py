"""3D pictorial structures: bodies from the points of all pairs of views, without matching people between views.

Belagiannis, Amin, Andriluka, Schiele, Navab and Ilic, 3D Pictorial Structures for Multiple Human Pose Estimation, CVPR
2014; the same, Revisited, TPAMI 2016. Published on Shelf: 71.4 % PCP (66.1, 65.0, 83.2 by actor) in 2014, 77.5 % (75.3,
69.7, 87.6) revisited.

The states of a joint are the points at which the rays of any two views pass each other, whoever they are of: all
people share them, and ghosts are among them, where rays of different people cross. Potentials of states and of bones
decide what is a body, equation 2. People are parsed one after another, the most certain first, and a detection that one
person explains is used by no other.

What differs:
- Detections are joints of 2D poses by a network, not of pictorial structures in 2D. Which 2D pose a joint is of is not
  used, as in the publication. This is why figures are better than the published ones.
- Potentials are products of the detector's confidence, the distance between the two rays, the share of views that show
  the joint there, and the length of each bone. There are none of rotation and of collision.
- The tree of the skeleton is solved exactly, by max-product, where the publication samples from loopy beliefs.
- Lengths of bones are measured in the clip, not learned from annotations.
- Nothing is temporal, as in the publication of 2014: tracks only number people.
"""

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.reconstruction.config import CaptureConfig, capture_method
from dmae.reconstruction.systems.common import Frame, as_tracks, bone_lengths, frames_of, max_product, meet, project

_APART_M = 0.2  # m; rays that pass each other at more are not a state
_ERROR_M = 0.05
"""m at the person; error of reprojection by which a potential falls to 1/e, and within which a view shows a joint."""
_LEAST_LOG = -4.5
"""Logarithm of a potential, three standard deviations of a bone. A state does not fall below it: a joint that nobody
sees takes any. What a person has below it is left out."""
_LEAST_JOINTS = 0.5  # A parse with a smaller share of its joints is not a person, and ends the frame
_MOST_PEOPLE, _MOST_STATES, _MOST_NEAR = 20, 400, 2000
"""In a frame; of a joint, the most certain; and before that, the nearest pairs of rays."""


@capture_method("pictorial_structures", paper="Belagiannis et al. 2014")
def capture_by_pictorial_structures(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Choose the joints of bodies among the points of all pairs of views, by bone lengths."""
    skeleton, rig, found, views = clip.detections.skeleton, clip.rig.undistorted, [], []
    mean, spread = bone_lengths(clip, config)

    def prior(lengths: np.ndarray, joint: int) -> np.ndarray:
        # Logarithm of a normal density, up to a constant. A bone that was never measured does not decide.
        return np.nan_to_num(-(((lengths - mean[joint]) / spread[joint]) ** 2) / 2)

    for frame in frames_of(clip, config):
        people = _parse(frame, rig, skeleton, prior)
        found.append(np.array([xyz for xyz, _ in people]).reshape(-1, len(skeleton), 3))
        views.append(np.array([seen for _, seen in people], int).reshape(-1, len(skeleton)))
    return as_tracks(clip, found, views)


def _parse(frame: Frame, rig: CameraRig, skeleton: Skeleton, prior) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return the people of a frame: joints (J, 3), m, and the number of views (J,) that show each."""
    points, scores, explained = zip(*(_states(frame, rig, joint) for joint in range(len(skeleton))), strict=True)
    used, people = np.zeros(frame.score.shape, bool), []
    while len(people) < _MOST_PEOPLE:
        # A state is used up with one of the two detections that it was made of.
        free = [~(used[:, joint] & made[..., 0]).any(1) for joint, made in enumerate(explained)]
        left = [each[kept] for each, kept in zip(points, free, strict=True)]
        unary = [each[kept] for each, kept in zip(scores, free, strict=True)]
        chosen = max_product(unary, left, skeleton, prior)
        joints = [joint for joint in np.flatnonzero(chosen >= 0).tolist() if unary[joint][chosen[joint]] > _LEAST_LOG]
        place = {joint: left[joint][chosen[joint]] for joint in joints}
        joints = [joint for joint in joints if _tied(joint, place, skeleton, prior)]
        if len(joints) < _LEAST_JOINTS * len(skeleton):
            break
        xyz, seen = np.full((len(skeleton), 3), np.nan), np.zeros(len(skeleton), int)
        for joint in joints:
            xyz[joint] = place[joint]
            shown = explained[joint][free[joint]][chosen[joint]].any(-1)
            used[shown, joint] = True
            seen[joint] = len(np.unique(frame.view[shown]))
        people.append((xyz, seen))
    return people


def _tied(joint: int, place: dict[int, np.ndarray], skeleton: Skeleton, prior) -> bool:
    """Whether any bone of a joint, to the places (3,) of its neighbours, has a length that bones have."""
    bones = [(a, b) for a, b in skeleton.bones if joint in (a, b) and a in place and b in place]
    return any(prior(np.linalg.norm(place[a] - place[b]), b) > _LEAST_LOG for a, b in bones)


def _states(frame: Frame, rig: CameraRig, joint: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points (C, 3) m, log potentials (C,), and detections (C, n, 2) that made a state, and that show it."""
    shows = np.flatnonzero(np.isfinite(frame.score[:, joint]))
    only = slice(joint, joint + 1)
    one = Frame(frame.view, frame.xy[:, only], frame.score[:, only], frame.rays[:, only])
    a, b = (shows[index] for index in np.nonzero(frame.view[shows][:, None] < frame.view[shows]))
    points, gap = (each[:, 0] for each in meet(one, rig.centers, a, b))
    near = np.argsort(np.where(gap < _APART_M, gap, np.inf), kind="stable")[: min((gap < _APART_M).sum(), _MOST_NEAR)]
    a, b, points = a[near], b[near], points[near]
    count, detections = len(points), np.arange(len(frame.view))
    xy, depth = project(rig.projections[frame.view], points[:, None])
    error = np.linalg.norm(xy - frame.xy[:, joint], axis=-1) * depth / rig.focal[frame.view]
    made = (detections == a[:, None]) | (detections == b[:, None])
    shown = made | (error < _ERROR_M)
    views = np.zeros((count, len(rig)), bool)
    for detection, view in enumerate(frame.view):
        views[:, view] |= shown[:, detection]
    confidence = np.maximum((frame.score[a, joint] + frame.score[b, joint]) / 2, 1e-3)
    score = np.log(confidence) + np.log(views.mean(1))
    score -= np.where(made, error, 0).sum(1) / 2 / _ERROR_M
    best = np.argsort(-score, kind="stable")[:_MOST_STATES]
    score = np.maximum(score, _LEAST_LOG)
    return points[best], score[best], np.stack([made, shown], -1)[best]
