"""What the systems share: detections of a frame, points of two views, lengths of bones, and people as tracks.

n detections of all views of a frame in a row; V views; J joints.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import BODY25, Skeleton
from dmae.numerics.body import parents_first
from dmae.numerics.statistics import evenly_spaced, median_over_frames
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.evidence import Evidence, evidence_blocks
from dmae.reconstruction.triangulation import closest_approach

_NEAR_M, _SHARED = 0.05, 0.5
"""Two detections are taken for one body, to measure bones, if the median distance of their rays is below `_NEAR_M`
and they share this part of the joints."""
_MEASURED_FRAMES = 60  # Frames of a clip in which bones are measured
_LEAST_SPREAD = 0.02  # m; least standard deviation of the length of a bone
_COLUMNS = 100
"""Tracks of a clip with a column of their own, so that memory does not grow with the ghosts of a long recording."""
_TRACK_M, _TRACK_SPEED, _TRACK_S = 0.5, 2.0, 1.0
"""A pose continues a track within this distance, m, plus this speed, m/s, for an absence of at most these seconds."""


@dataclass(frozen=True)
class Frame:
    """Detections of one frame, by view."""

    view: np.ndarray  # (n,) view of each detection, ascending
    xy: np.ndarray  # (n, J, 2) undistorted px; NaN where a joint is absent
    score: np.ndarray  # (n, J) confidence from 0 to 1; NaN where absent
    rays: np.ndarray  # (n, J, 3) unit directions, world; NaN where absent


def frames_of(clip: Clip, config: CaptureConfig) -> Iterator[Frame]:
    """Yield the detections of each frame, without joints below `config.th_p`."""
    for part in evidence_blocks(clip):
        evidence = Evidence.of(clip, config.th_p, config, part)
        for frame in range(len(evidence.xy)):
            view, row = np.nonzero(np.isfinite(evidence.confidence[frame]).any(-1))
            score = evidence.confidence[frame, view, row]
            yield Frame(view, evidence.xy[frame, view, row], score, evidence.rays(frame, view, row))


def learned_joints(clip: Clip, method: str) -> tuple[list[int], list[int]]:
    """Return the joints of a clip that networks for BODY_25 have learned, and where they are in `BODY25`.

    Raises:
        ValueError: hips and shoulders are not among them.
    """
    skeleton = clip.detections.skeleton
    shared = [joint for joint in skeleton.joints if joint in BODY25.joints]
    if not {"l_hip", "r_hip", "l_shoulder", "r_shoulder"} <= set(shared):
        raise ValueError(
            f"clip {clip.id!r}: method={method} has learned joints of {BODY25.name}, hips and shoulders among them; "
            f"found {skeleton.name!r} with {len(shared)} of them"
        )
    return skeleton.index(*shared), BODY25.index(*shared)


def on_body25(frame: Frame, here: list[int], there: list[int]) -> Frame:
    """Return detections on `BODY25`, from `learned_joints`. Joints that their skeleton lacks are absent, and so are
    detections of other joints alone."""
    shown = np.flatnonzero(np.isfinite(frame.score[:, here]).any(-1))
    xy, score, rays = (np.full((len(shown), len(BODY25), *each), np.nan) for each in ((2,), (), (3,)))
    rows, columns = shown[:, None], np.array(here)
    xy[:, there], score[:, there] = frame.xy[rows, columns], frame.score[rows, columns]
    rays[:, there] = frame.rays[rows, columns]
    return Frame(frame.view[shown], xy, score, rays)


def meet(frame: Frame, centers: np.ndarray, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where the rays of pairs of detections (m,) pass closest: points (m, J, 3), m, and distances (m, J), m.

    Both are NaN where a joint is absent, or the rays pass closest behind a camera.
    """
    start, end = centers[frame.view[a]][:, None], centers[frame.view[b]][:, None]
    along_a, along_b, _ = closest_approach(end - start, frame.rays[a], frame.rays[b])
    on_a, on_b = start + along_a[..., None] * frame.rays[a], end + along_b[..., None] * frame.rays[b]
    ahead = (along_a > 0) & (along_b > 0)
    points = np.where(ahead[..., None], (on_a + on_b) / 2, np.nan)
    return points, np.where(ahead, np.linalg.norm(on_a - on_b, axis=-1), np.nan)


def project(projections: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points (..., 3) in the images of cameras (..., 3, 4): (..., 2) px, NaN behind, and depths (...), m."""
    image = (projections[..., :3] @ points[..., None])[..., 0] + projections[..., 3]
    depth = image[..., 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(depth[..., None] > 0, image[..., :2] / depth[..., None], np.nan), depth


def bone_lengths(clip: Clip, config: CaptureConfig) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean and the standard deviation, m, of the bone of each joint (J,) to its parent; NaN if never seen.

    The publications learn them from annotations. Here they are measured on pairs of detections whose rays meet.
    """
    skeleton, centers = clip.detections.skeleton, clip.rig.centers
    parents, found = np.array(skeleton.parents), [np.empty((0, len(skeleton)))]
    for frame in frames_of(clip.select(frames=evenly_spaced(len(clip), _MEASURED_FRAMES)), config):
        a, b = np.nonzero(frame.view[:, None] < frame.view)
        points, gaps = meet(frame, centers, a, b)
        met = np.isfinite(gaps)
        close = np.nanmedian(np.where(met.any(1)[:, None], gaps, np.inf), 1) < _NEAR_M
        points = points[close & (met.mean(1) >= _SHARED)]
        found.append(np.where(parents >= 0, np.linalg.norm(points - points[:, parents], axis=-1), np.nan))
    lengths = np.concatenate(found)
    mean = median_over_frames(lengths)
    spread = 1.4826 * median_over_frames(np.abs(lengths - mean))
    return mean, np.maximum(spread, _LEAST_SPREAD)


def max_product(
    scores: Sequence[np.ndarray],
    points: Sequence[np.ndarray],
    skeleton: Skeleton,
    prior: Callable[[np.ndarray, int], np.ndarray],
) -> np.ndarray:
    """Return the best candidate of each joint by max-product on the tree of a skeleton, which is exact.

    The chosen candidates have the largest sum of scores and of priors of the bones between them. Where a joint has no
    candidates, the tree is cut.

    Args:
        scores: J arrays (C_j,).
        points: J arrays (C_j, 3), m.
        skeleton: Its parents are the tree.
        prior: Takes the lengths (C_parent, C_j) of the bone of a joint, m, and the joint; returns their scores.

    Returns:
        (J,) index of the candidate of each joint, -1 where there is none.
    """
    totals, best, chosen = list(scores), {}, np.full(len(skeleton), -1)
    outwards = parents_first(skeleton)
    for joint in reversed(outwards):
        parent = skeleton.parents[joint]
        if parent >= 0 and len(totals[joint]) and len(totals[parent]):
            lengths = np.linalg.norm(points[parent][:, None] - points[joint], axis=-1)
            both = prior(lengths, joint) + totals[joint]
            best[joint] = both.argmax(1)
            totals[parent] = totals[parent] + both.max(1)
    for joint in outwards:
        if joint in best:
            chosen[joint] = best[joint][chosen[skeleton.parents[joint]]]
        elif len(totals[joint]):
            chosen[joint] = totals[joint].argmax()
    return chosen


def as_tracks(clip: Clip, found: Sequence[np.ndarray], views: Sequence[np.ndarray]) -> Poses3D:
    """Return the people of each frame as tracks: a pose continues the track that was last nearest to it.

    Systems that find people frame by frame are numbered so. No joint moves.

    Args:
        clip: F frames.
        found: F arrays (P, J, 3), m; NaN where a joint is absent.
        views: F arrays (P, J), number of views that a joint was measured from.
    """
    last, seen, number = np.empty((0, len(clip.detections.skeleton), 3)), np.empty(0, int), np.empty(0, int)
    tracks, births = [], 0
    for frame, poses in enumerate(found):
        recent = frame - seen <= _TRACK_S * clip.fps
        last, seen, number = last[recent], seen[recent], number[recent]
        distance = np.linalg.norm(poses[:, None] - last, axis=-1)
        shared = np.isfinite(distance)
        distance = np.where(shared, distance, 0).sum(-1) / np.maximum(shared.sum(-1), 1)
        near = shared.any(-1) & (distance < _TRACK_M + _TRACK_SPEED * (frame - seen) / clip.fps)
        rows, columns = linear_sum_assignment(np.where(near, distance, 1e3))
        track = np.full(len(poses), -1)
        track[rows[near[rows, columns]]] = columns[near[rows, columns]]
        born = np.flatnonzero(track < 0)
        track[born] = len(last) + np.arange(len(born))
        last, seen = np.concatenate([last, poses[born]]), np.concatenate([seen, np.full(len(born), frame)])
        number = np.concatenate([number, births + np.arange(len(born))])
        births += len(born)
        last[track], seen[track] = np.where(np.isfinite(poses), poses, last[track]), frame
        tracks.append(number[track])
    return as_poses(clip, tracks, found, views)


def as_poses(
    clip: Clip, tracks: Sequence[np.ndarray], found: Sequence[np.ndarray], views: Sequence[np.ndarray]
) -> Poses3D:
    """Return tracks as poses, a column each; with more than 100, a column serves again for someone who comes later.

    Args:
        clip: F frames.
        tracks: F arrays (P,), each pose's track, numbered in the order of birth.
        found, views: As for `as_tracks`.
    """
    span: dict[int, list[int]] = {}
    for frame, numbers in enumerate(tracks):
        for track in numbers.tolist():
            span.setdefault(track, [frame, frame])[1] = frame
    column, free_from = {}, []
    for track, (birth, end) in span.items():
        place = int(np.argmin(free_from)) if len(free_from) >= _COLUMNS else len(free_from)
        if place == len(free_from) or free_from[place] + _TRACK_S * clip.fps >= birth:
            place = len(free_from)
            free_from.append(end)
        column[track], free_from[place] = place, end
    skeleton = clip.detections.skeleton
    xyz = np.full((len(clip), len(free_from), len(skeleton), 3), np.nan, np.float32)
    used = np.zeros(xyz.shape[:-1], np.uint8)
    for frame, numbers in enumerate(tracks):
        places = [column[track] for track in numbers.tolist()]
        xyz[frame, places], used[frame, places] = found[frame], views[frame]
    return Poses3D(skeleton, xyz, views=np.where(np.isnan(xyz[..., 0]), 0, used))
