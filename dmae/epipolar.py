"""How well detections of two views fit their cameras, before anybody knows whose they are.

S frames looked at, out of F; D detections a view; n pairs of views, or people.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations

import numpy as np

from dmae.cameras import CameraRig
from dmae.clip import Clip
from dmae.conventions import Convention
from dmae.metrics import mean_known
from dmae.skeleton import Skeleton

TOLERANCE = 0.025
"""Distance of a joint from its epipolar line, as a share of the person's size in the image, that counts half.

Real detectors leave about .015 of a person's height.
"""
AGREED = 0.35
"""Detections of at least this much agreement are of one person."""
_LEAST_JOINTS = 6
"""Fewer make no person."""
_FINE = ("eye", "ear", "toe", "heel")
"""Joints so near to others that they say nothing more."""


@dataclass(frozen=True)
class Reading:
    """Cameras and detections, as they were read or as they would be had a fault been mended.

    Attributes:
        rig: V cameras.
        xy: (F, V, D, J, 2) px; NaN where absent.
        skeleton: Of the J joints.
        delay: (V,) frames by which each camera's detections are put off.
        convention: How the files are taken to write the world and the extrinsics.
    """

    rig: CameraRig
    xy: np.ndarray
    skeleton: Skeleton
    delay: np.ndarray
    convention: Convention

    @classmethod
    def of(cls, clip: Clip, convention: Convention) -> "Reading":
        """The clip's detections, without those of few joints, and without the small joints of face and feet."""
        skeleton, xy = clip.detections.skeleton, clip.detections.xy.astype(np.float64)
        kept = [i for i, joint in enumerate(skeleton.joints) if not joint.endswith(_FINE)]
        joints = clip.detections.observed[..., kept].sum(-1)
        xy[joints < _LEAST_JOINTS] = np.nan
        fullest_first = np.argsort(-joints, axis=-1, kind="stable")
        most = int((joints >= _LEAST_JOINTS).sum(-1).max(initial=0))
        xy = np.take_along_axis(xy[..., kept, :], fullest_first[..., None, None], 2)[:, :, :most]
        part = Skeleton(skeleton.name, tuple(skeleton.joints[i] for i in kept), (-1,) * len(kept))
        return cls(clip.rig, xy, part, np.zeros(len(clip.rig), int), convention)

    def put_off(self, delay: np.ndarray) -> "Reading":
        return replace(self, delay=self.delay + delay)


@dataclass(frozen=True)
class Sight:
    """What a reading's cameras see in S frames.

    Attributes:
        rig: The V cameras, without distortion.
        xy: (V, S, D, J, 2) pixels of these; NaN where absent.
        joints: (V, S, D, J) True where a joint was detected, even where no ray belongs to it.
        size: (V, S, D) extent of each detection, px.
    """

    rig: CameraRig
    xy: np.ndarray
    joints: np.ndarray
    size: np.ndarray

    @cached_property
    def homogeneous(self) -> np.ndarray:
        """(V, S, D, J, 3) float32."""
        return np.concatenate([self.xy, np.ones_like(self.xy[..., :1])], -1).astype(np.float32)

    def rays(self, view: np.ndarray, frame: np.ndarray, index: np.ndarray) -> np.ndarray:
        """(m, J, 3) unit directions, world, of detections by view, frame and index, all (m,)."""
        xy = self.xy[view, frame, index]
        world_from_pixel = np.linalg.inv(self.rig.K @ self.rig.cam_from_world[:, :3, :3])[view]
        rays = xy @ world_from_pixel[:, :, :2].swapaxes(-1, -2) + world_from_pixel[:, None, :, 2]
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def frames_of(reading: Reading, most: int) -> np.ndarray:
    """Up to `most` frames, evenly spread over those in which two views or more see somebody."""
    frames = np.flatnonzero(np.isfinite(reading.xy[..., 0]).any((2, 3)).sum(1) >= 2)
    return frames[np.unique(np.linspace(0, max(len(frames) - 1, 0), most).astype(int))] if len(frames) else frames


def look(reading: Reading, frames: np.ndarray, views: list[int] | None = None) -> Sight:
    """What the cameras, or some of them, see in frames (S,)."""
    views = list(range(len(reading.rig))) if views is None else views
    rig = reading.rig if len(views) == len(reading.rig) else reading.rig[views]
    rows = frames[:, None] - reading.delay[views]
    there = (rows >= 0) & (rows < len(reading.xy))
    xy = np.where(there[..., None, None, None], reading.xy[np.where(there, rows, 0), views], np.nan)
    joints = np.isfinite(xy[..., 0])
    low, high = (np.where(joints[..., None], xy, far) for far in (np.inf, -np.inf))
    size = np.hypot(*np.moveaxis(np.maximum(high.max(3) - low.min(3), 0), -1, 0))
    return Sight(rig.undistorted, *(array.swapaxes(0, 1) for array in (rig.undistort(xy), joints, np.maximum(size, 1))))


def fundamental(rig: CameraRig, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """(n, 3, 3) F with x_b^T F x_a = 0 (Hartley & Zisserman, 2nd ed., 9.2), of undistorted pixels, of norm 1."""
    b_from_a = rig.cam_from_world[b] @ np.linalg.inv(rig.cam_from_world[a])
    x, y, z = b_from_a[:, :3, 3].T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)
    F = np.linalg.inv(rig.K[b]).swapaxes(-1, -2) @ cross @ b_from_a[:, :3, :3] @ np.linalg.inv(rig.K[a])
    return F / np.maximum(np.linalg.norm(F, axis=(-2, -1), keepdims=True), 1e-12)


def line_distances(sight_a: Sight, sight_b: Sight, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(n, S, D, D, J) px of a's joints from the epipolar lines of b's, and of b's from those of a's."""
    F = fundamental(sight_a.rig, a, b).astype(np.float32)[:, None, None]
    xy_a, xy_b = sight_a.homogeneous[a], sight_b.homogeneous[b]
    lines_b, lines_a = xy_a @ F.swapaxes(-1, -2), xy_b @ F
    off = np.abs(sum(lines_b[:, :, :, None, :, k] * xy_b[:, :, None, :, :, k] for k in range(3)))
    with np.errstate(divide="ignore", invalid="ignore"):
        return (
            off / np.hypot(lines_a[..., 0], lines_a[..., 1])[:, :, None],
            off / np.hypot(lines_b[..., 0], lines_b[..., 1])[:, :, :, None],
        )


@dataclass(frozen=True)
class Agreement:
    """How n pairs of views agree.

    Attributes:
        total: (n, S) sum, over the detections of either view in frames in which the other has some, of how each
            fits the best of the other's, from 0 to 1.
        detections: (n, S) how many those are.
        pair, frame, a, b: (m,) of the detections that fit each other best and well: index of the pair, the frame
            and the two.
        off: (m, J) px of their joints from the epipolar lines, mean of both views; NaN where not shared.
    """

    total: np.ndarray
    detections: np.ndarray
    pair: np.ndarray
    frame: np.ndarray
    a: np.ndarray
    b: np.ndarray
    off: np.ndarray


def agree(sight: Sight, pairs: list[tuple[int, int]], other: Sight | None = None) -> Agreement:
    """How pairs of views agree, the second view of each as `other` shows it where that is given."""
    other = other or sight
    a, b = np.asarray(pairs).T
    off_a, off_b = line_distances(sight, other, a, b)
    size_a, size_b = sight.size[a].astype(np.float32), other.size[b].astype(np.float32)
    relative = off_a / (2 * size_a)[:, :, :, None, None] + off_b / (2 * size_b)[:, :, None, :, None]
    near = np.nan_to_num(1 / (1 + (relative / TOLERANCE) ** 2))
    joints_a, joints_b = sight.joints[a], other.joints[b]
    shared = joints_a.astype(np.float32) @ joints_b.astype(np.float32).swapaxes(-1, -2)
    # One joint's worth of doubt is added, so that a pair that shares little cannot be sure.
    fit = near.sum(-1) / (shared + 1)
    some_a, some_b = joints_a.any(-1), joints_b.any(-1)
    counted_a, counted_b = some_a & some_b.any(-1, keepdims=True), some_b & some_a.any(-1, keepdims=True)
    best_b, best_a = fit.argmax(-1), fit.argmax(-2)
    mutual = np.take_along_axis(best_a, best_b, -1) == np.arange(fit.shape[2])
    pair, frame, i = np.nonzero(counted_a & mutual & (fit.max(-1) >= AGREED))
    j = best_b[pair, frame, i]
    # Lines do not know front from back: a match behind a camera is none.
    _, _, far_a, far_b, _ = meet(sight, other, a[pair], b[pair], frame, i, j)
    in_front = np.where(np.isnan(far_a), np.nan, (far_a > 0) & (far_b > 0))
    fit[pair, frame, i, j] *= np.nan_to_num(mean_known(in_front, -1))
    total = np.where(counted_a, fit.max(-1), 0).sum(-1) + np.where(counted_b, fit.max(-2), 0).sum(-1)
    kept = fit[pair, frame, i, j] >= AGREED
    pair, frame, i, j = pair[kept], frame[kept], i[kept], j[kept]
    off = (off_a[pair, frame, i, j] + off_b[pair, frame, i, j]) / 2
    return Agreement(total, counted_a.sum(-1) + counted_b.sum(-1), pair, frame, i, j, off)


def meet(sight_a: Sight, sight_b: Sight, a, b, frame, i, j) -> tuple[np.ndarray, ...]:
    """Where rays of detections i of views a and j of views b, all (m,), pass closest.

    Returns:
        rays_a, rays_b: (m, J, 3).
        far_a, far_b: (m, J) along the rays, in the rig's lengths.
        sine2: (m, J) sine squared of the angle between them.
    """
    centers = sight_a.rig.centers
    base = (centers[b] - centers[a])[:, None]
    rays_a, rays_b = sight_a.rays(a, frame, i), sight_b.rays(b, frame, j)
    cosine = (rays_a * rays_b).sum(-1)
    sine2 = np.maximum(1 - cosine**2, 1e-12)
    along_a, along_b = (rays_a * base).sum(-1), (rays_b * base).sum(-1)
    return rays_a, rays_b, (along_a - cosine * along_b) / sine2, (cosine * along_a - along_b) / sine2, sine2


def people(sight: Sight, pairs: list[tuple[int, int]], found: Agreement) -> np.ndarray:
    """(m, J, 3) matched detections as points, in the rig's lengths; NaN where two rays run nearly side by side."""
    a, b = np.asarray(pairs)[found.pair].reshape(-1, 2).T
    rays_a, rays_b, far_a, far_b, sine2 = meet(sight, sight, a, b, found.frame, found.a, found.b)
    centers = sight.rig.centers[:, None]
    middle = (centers[a] + far_a[..., None] * rays_a + centers[b] + far_b[..., None] * rays_b) / 2
    return np.where(((sine2 > 0.03) & (far_a > 0) & (far_b > 0))[..., None], middle, np.nan)


def all_pairs(views: int) -> list[tuple[int, int]]:
    """Pairs of views to compare: all, or in a large rig each with its next two and the one opposite."""
    steps = {1, 2, views // 2}
    return [
        (a, b) for a, b in combinations(range(views), 2) if views <= 8 or (b - a) in steps or views - (b - a) in steps
    ]
