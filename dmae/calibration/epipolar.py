"""How well do pairs of views agree? Epipolar geometry of detections without known identities.

S sampled frames out of F; D detections per view; J joints; n pairs of views; m matched detections.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from io import BytesIO
from itertools import combinations

import numpy as np

from dmae.calibration.bundle_adjustment import coarse_skeleton
from dmae.data.cameras import CameraRig, camera_label
from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import Skeleton
from dmae.formats.config import Convention
from dmae.formats.reading import shift_views
from dmae.numerics.statistics import evenly_spaced, mean_known
from dmae.reconstruction.triangulation import closest_approach

CHECKED_FRAMES = 150
"""Number of sampled frames for a check of a result from fewer frames."""
_MIN_JOINTS = 6  # Smallest number of joints of a detection that is compared


@dataclass(frozen=True)
class Hypothesis:
    """Cameras and detections of F frames, V views, D detections per view, J joints."""

    rig: CameraRig  # V cameras
    xy: np.ndarray  # (F, V, D, J, 2) px; NaN where absent
    score: np.ndarray  # (F, V, D, J) confidence; NaN where absent
    skeleton: Skeleton  # J joints
    fps: float  # 1/s
    offsets: np.ndarray  # (V,) frames by which the detections of each camera are delayed
    convention: Convention  # How the files are assumed to write the world and the extrinsics

    @classmethod
    def of(cls, clip: Clip, convention: Convention) -> Hypothesis:
        """Return a clip as it was read, without detections of few joints and without small joints of face and feet."""
        skeleton, xy = clip.detections.skeleton, clip.detections.xy.astype(np.float64)
        part, kept = coarse_skeleton(skeleton)
        joints = clip.detections.observed[..., kept].sum(-1)
        xy[joints < _MIN_JOINTS] = np.nan
        fullest_first = np.argsort(-joints, axis=-1, kind="stable")
        most = int((joints >= _MIN_JOINTS).sum(-1).max(initial=0))
        xy = np.take_along_axis(xy[..., kept, :], fullest_first[..., None, None], 2)[:, :, :most]
        score = np.take_along_axis(clip.detections.score[..., kept], fullest_first[..., None], 2)[:, :, :most]
        score = np.where(np.isnan(xy[..., 0]), np.nan, score)
        return cls(clip.rig, xy, score, part, clip.fps, np.zeros(len(clip.rig), int), convention)

    def clip(self) -> Clip:
        """Return cameras and detections, synchronised, as a clip."""
        found = Detections2D(self.skeleton, self.xy, np.where(np.isnan(self.xy[..., 0]), np.nan, self.score))
        return shift_views(Clip("examined", self.fps, self.rig, found), self.offsets.tolist())

    def delayed(self, frames: np.ndarray) -> Hypothesis:
        """Return the hypothesis with the detections of each camera delayed by further frames (V,)."""
        return replace(self, offsets=self.offsets + frames)

    def sample_frames(self, most: int) -> np.ndarray:
        """Return up to `most` frames, evenly spread over the frames in which at least two views detect people."""
        frames = np.flatnonzero(np.isfinite(self.xy[..., 0]).any((2, 3)).sum(1) >= 2)
        return frames[evenly_spaced(len(frames), most)]


@dataclass(frozen=True)
class ViewSample:
    """Detections of some cameras in S frames."""

    rig: CameraRig  # V cameras without distortion
    xy: np.ndarray  # (V, S, D, J, 2) undistorted px; NaN where absent
    joints: np.ndarray  # (V, S, D, J) True where a joint was detected, even if the lens has no ray for its pixel
    size: np.ndarray  # (V, S, D) extent of each detection, px

    @classmethod
    def of(cls, hypothesis: Hypothesis, frames: np.ndarray, views: list[int] | None = None) -> ViewSample:
        """Return the detections in frames (S,) of all cameras, or of some."""
        views = list(range(len(hypothesis.rig))) if views is None else views
        rig = hypothesis.rig if len(views) == len(hypothesis.rig) else hypothesis.rig[views]
        rows = frames[:, None] - hypothesis.offsets[views]
        inside = (rows >= 0) & (rows < len(hypothesis.xy))
        xy = np.where(inside[..., None, None, None], hypothesis.xy[np.where(inside, rows, 0), views], np.nan)
        joints = np.isfinite(xy[..., 0])
        low, high = (np.where(joints[..., None], xy, limit) for limit in (np.inf, -np.inf))
        size = np.hypot(*np.moveaxis(np.maximum(high.max(3) - low.min(3), 0), -1, 0))
        arrays = (rig.undistort(xy), joints, np.maximum(size, 1))
        return cls(rig.undistorted, *(array.swapaxes(0, 1) for array in arrays))

    @cached_property
    def homogeneous(self) -> np.ndarray:
        """(V, S, D, J, 3) homogeneous pixels, float32."""
        return np.concatenate([self.xy, np.ones_like(self.xy[..., :1])], -1).astype(np.float32)

    def rays(self, view: np.ndarray, frame: np.ndarray, index: np.ndarray) -> np.ndarray:
        """Return unit directions (m, J, 3), world, of detections given by view, frame and index, all (m,)."""
        xy = self.xy[view, frame, index]
        world_from_pixel = self.rig.world_from_pixel[view]
        rays = xy @ world_from_pixel[:, :, :2].swapaxes(-1, -2) + world_from_pixel[:, None, :, 2]
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def fundamental(rig: CameraRig, a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return F (n, 3, 3) of unit norm with x_b^T F x_a = 0 (Hartley & Zisserman, 2nd ed., 9.2) for undistorted px."""
    b_from_a = rig.cam_from_world[b] @ np.linalg.inv(rig.cam_from_world[a])
    x, y, z = b_from_a[:, :3, 3].T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], -1).reshape(-1, 3, 3)
    F = np.linalg.inv(rig.K[b]).swapaxes(-1, -2) @ cross @ b_from_a[:, :3, :3] @ np.linalg.inv(rig.K[a])
    return F / np.maximum(np.linalg.norm(F, axis=(-2, -1), keepdims=True), 1e-12)


def epipolar_distances(
    sample_a: ViewSample, sample_b: ViewSample, a: np.ndarray, b: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return px (n, S, D, D, J) from joints in views a to the epipolar lines of joints in views b, and vice versa."""
    F = fundamental(sample_a.rig, a, b).astype(np.float32)[:, None, None]
    xy_a, xy_b = sample_a.homogeneous[a], sample_b.homogeneous[b]
    lines_b, lines_a = xy_a @ F.swapaxes(-1, -2), xy_b @ F
    residual = np.abs(sum(lines_b[:, :, :, None, :, k] * xy_b[:, :, None, :, :, k] for k in range(3)))
    with np.errstate(divide="ignore", invalid="ignore"):
        return (
            residual / np.hypot(lines_a[..., 0], lines_a[..., 1])[:, :, None],
            residual / np.hypot(lines_b[..., 0], lines_b[..., 1])[:, :, :, None],
        )


def intersect(sample_a: ViewSample, sample_b: ViewSample, a, b, frame, i, j) -> tuple[np.ndarray, ...]:
    """Return unit rays (m, J, 3) of detections i of views a and j of views b, depths, and the sine squared between.

    Depths (m, J) lead to the closest points along the rays, in the unit of the rig.
    """
    centers = sample_a.rig.centers
    rays_a, rays_b = sample_a.rays(a, frame, i), sample_b.rays(b, frame, j)
    return rays_a, rays_b, *closest_approach((centers[b] - centers[a])[:, None], rays_a, rays_b)


Pairs = list[tuple[int, int]]
"""Pairs of views."""
TOLERANCE = 0.025
"""Distance of a joint from its epipolar line that counts as half a fit, as a share of the person's size in the image.

Real detectors leave distances of about 0.015 of a person's height.
"""
SOUND = 0.3
"""Agreement of views without a gross fault, with the usual share of people that are hidden or cut off."""
MATCH = 0.35
"""Smallest agreement of two detections of one person."""


@dataclass(frozen=True)
class Agreement:
    """Agreement of n pairs of views."""

    # (n, S) sum over the detections of both views: how well each fits its best match in the other view, from 0 to 1, in
    # frames in which both views have detections
    total: np.ndarray
    detections: np.ndarray  # (n, S) number of these detections
    # pair, frame, a, b: (m,) the matches: detections that are each other's best fit, and fit well. Indices of the pair,
    # of the frame, and of the two detections.
    pair: np.ndarray
    frame: np.ndarray
    a: np.ndarray
    b: np.ndarray
    residual: np.ndarray  # (m, J) px from joints to epipolar lines, mean of both views; NaN where a joint is not shared


def measure_agreement(sample: ViewSample, pairs: Pairs, other: ViewSample | None = None) -> Agreement:
    """Measure the agreement of pairs of views. The second view of each pair is taken from `other` if it is given."""
    other = other or sample
    a, b = np.asarray(pairs).T
    distance_a, distance_b = epipolar_distances(sample, other, a, b)
    size_a, size_b = sample.size[a].astype(np.float32), other.size[b].astype(np.float32)
    relative = distance_a / (2 * size_a)[:, :, :, None, None] + distance_b / (2 * size_b)[:, :, None, :, None]
    near = np.nan_to_num(1 / (1 + (relative / TOLERANCE) ** 2))
    joints_a, joints_b = sample.joints[a], other.joints[b]
    shared = joints_a.astype(np.float32) @ joints_b.astype(np.float32).swapaxes(-1, -2)
    # The 1 keeps the fit low for pairs that share few joints.
    fit = near.sum(-1) / (shared + 1)
    some_a, some_b = joints_a.any(-1), joints_b.any(-1)
    counted_a, counted_b = some_a & some_b.any(-1, keepdims=True), some_b & some_a.any(-1, keepdims=True)
    best_b, best_a = fit.argmax(-1), fit.argmax(-2)
    mutual = np.take_along_axis(best_a, best_b, -1) == np.arange(fit.shape[2])
    pair, frame, i = np.nonzero(counted_a & mutual & (fit.max(-1) >= MATCH))
    j = best_b[pair, frame, i]
    # Epipolar lines do not distinguish front from back, so matches behind a camera are excluded.
    _, _, depth_a, depth_b, _ = intersect(sample, other, a[pair], b[pair], frame, i, j)
    in_front = np.where(np.isnan(depth_a), np.nan, (depth_a > 0) & (depth_b > 0))
    fit[pair, frame, i, j] *= np.nan_to_num(mean_known(in_front, -1))
    total = np.where(counted_a, fit.max(-1), 0).sum(-1) + np.where(counted_b, fit.max(-2), 0).sum(-1)
    kept = fit[pair, frame, i, j] >= MATCH
    pair, frame, i, j = pair[kept], frame[kept], i[kept], j[kept]
    residual = (distance_a[pair, frame, i, j] + distance_b[pair, frame, i, j]) / 2
    return Agreement(total, counted_a.sum(-1) + counted_b.sum(-1), pair, frame, i, j, residual)


def triangulate_matches(sample: ViewSample, pairs: Pairs, found: Agreement) -> np.ndarray:
    """Return matched detections as points (m, J, 3), in the unit of the rig; NaN where two rays are almost parallel."""
    a, b = np.asarray(pairs)[found.pair].reshape(-1, 2).T
    rays_a, rays_b, depth_a, depth_b, sine2 = intersect(sample, sample, a, b, found.frame, found.a, found.b)
    centers = sample.rig.centers[:, None]
    middle = (centers[a] + depth_a[..., None] * rays_a + centers[b] + depth_b[..., None] * rays_b) / 2
    return np.where(((sine2 > 0.03) & (depth_a > 0) & (depth_b > 0))[..., None], middle, np.nan)


def pairs_to_compare(views: int) -> Pairs:
    """Return all pairs of views, or in a large rig the pairs of each view with its next two and the opposite view."""
    steps = {1, 2, views // 2}
    return [
        (a, b) for a, b in combinations(range(views), 2) if views <= 8 or (b - a) in steps or views - (b - a) in steps
    ]


PairScores = dict[tuple[int, int], np.ndarray]
"""By pair of views: (2, S) total agreement and number of detections in each frame, as in `Agreement`."""


def score_pairs(hypothesis: Hypothesis, frames: np.ndarray, pairs: Pairs) -> PairScores:
    """Score pairs of views in frames (S,) under a hypothesis."""
    views = sorted({view for pair in pairs for view in pair})
    sample = ViewSample.of(hypothesis, frames, views)
    found = measure_agreement(sample, [(views.index(a), views.index(b)) for a, b in pairs])
    return dict(zip(pairs, np.stack([found.total, found.detections], 1), strict=True))


def mean_agreement(scores: PairScores) -> float:
    """Return the mean agreement, from 0 to 1, of the detections of pairs of views; 0 without detections."""
    total, detections = sum(scores.values(), np.zeros((2, 1))).sum(-1)
    return float(total / max(detections, 1))


_FRAMES = 60
_MOST_ARROWS = 900


def epipolar_arrows(hypothesis: Hypothesis) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return for each camera its joints, (n, 2) undistorted px, and the vectors to the epipolar lines of matches.

    A correct camera has short arrows in all directions. A common pattern shows how the image of the camera is
    displaced.
    """
    pairs = pairs_to_compare(len(hypothesis.rig))
    sample = ViewSample.of(hypothesis, hypothesis.sample_frames(_FRAMES))
    found = measure_agreement(sample, pairs)
    a, b = np.asarray(pairs)[found.pair].reshape(-1, 2).T
    F = fundamental(sample.rig, a, b)
    points = [sample.homogeneous[view, found.frame, index] for view, index in ((a, found.a), (b, found.b))]
    lines = [points[1] @ F, points[0] @ F.swapaxes(-1, -2)]
    arrows = []
    for view in range(len(hypothesis.rig)):
        starts, ways = [], []
        for at, own, line in zip((a, b), points, lines, strict=True):
            own, line = own[at == view].reshape(-1, 3), line[at == view].reshape(-1, 3)
            with np.errstate(divide="ignore", invalid="ignore"):
                off = (own * line).sum(-1, keepdims=True) / (line[:, :2] ** 2).sum(-1, keepdims=True)
            way = -off * line[:, :2]
            known = np.isfinite(way).all(-1)
            starts.append(own[known, :2])
            ways.append(way[known])
        arrows.append((np.concatenate(starts), np.concatenate(ways)))
    return arrows


def draw_arrows(hypothesis: Hypothesis, title: str, images: list[np.ndarray | None] | None = None) -> list[bytes]:
    """Return a PNG for each camera: its epipolar arrows, ten times as long, on its image (h, w, 3) RGB, if any."""
    from matplotlib.figure import Figure

    pictures = []
    for view, (start, way) in enumerate(epipolar_arrows(hypothesis)):
        width, height = hypothesis.rig.size[view]
        figure = Figure(figsize=(8, 8 * height / width + 0.5), layout="constrained")
        axes = figure.subplots()
        if images is not None and (image := images[view]) is not None:
            axes.imshow(image, extent=(-0.5, width - 0.5, height - 0.5, -0.5), alpha=0.6)
        every = slice(None, None, len(start) // _MOST_ARROWS + 1)
        length = np.linalg.norm(way, axis=-1)
        if len(start):
            quiver = axes.quiver(*start[every].T, *(10 * way[every]).T, length[every], angles="xy", scale_units="xy",
                                 scale=1, width=0.002, cmap="viridis", clim=(0, 20))  # fmt: skip
            figure.colorbar(quiver, ax=axes, label="px to the epipolar line", shrink=0.7)
        axes.set(xlim=(0, width), ylim=(height, 0), aspect="equal")
        median = f"median {np.median(length):.1f} px" if len(length) else "no detection matches another camera's"
        axes.set_title(f"{title}, {camera_label(hypothesis.rig.names[view])}: {median}; arrows 10 x", fontsize=10)
        figure.savefig(buffer := BytesIO(), format="png", dpi=90)
        pictures.append(buffer.getvalue())
    return pictures
