"""Evidence: the confident detections of a clip, undistorted, ready to be compared with each other and with people."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.numerics.compiled import compiled
from dmae.reconstruction.config import CaptureConfig, DistanceUnit
from dmae.reconstruction.noise import DetectionNoise
from dmae.reconstruction.triangulation import Points, project, triangulate_by_sigma

_BLOCK = 1 << 18
"""Number of joints of detections, or of people, in all cameras that are processed together: some hundred MB."""
_FEWEST = 64  # Frames in a block


def evidence_blocks(clip: Clip, persons: int = 1) -> list[slice]:
    """Return the frames of a clip in blocks that are processed together; a short clip is one block.

    Args:
        persons: Number of people that are compared with the detections.
    """
    frames, views, detections, joints = clip.detections.score.shape
    step = max(_BLOCK // max(views * joints * max(detections, persons), 1), _FEWEST)
    return [slice(start, min(start + step, frames)) for start in range(0, max(frames, 1), step)]


@dataclass(frozen=True)
class Evidence:
    """Confident detections of F frames, V views, D detections per view, J joints."""

    rig: CameraRig  # V pinhole cameras; `xy` is in their undistorted pixels
    xy: np.ndarray  # (F, V, D, J, 2) undistorted px; NaN where absent
    confidence: np.ndarray  # (F, V, D, J) in [0, 1]; NaN where absent
    config: CaptureConfig  # How detections are compared and triangulated, with distances for detections of this noise
    noise: DetectionNoise  # How far detections scatter

    @classmethod
    def of(
        cls,
        clip: Clip,
        th_p: float,
        config: CaptureConfig,
        frames: slice | np.ndarray = slice(None),
        noise: DetectionNoise | None = None,
    ) -> Evidence:
        """Return the detections of a clip with confidence `th_p` or more (joint-level filtering of the paper).

        Args:
            frames: Of the clip.
            noise: How far its detections scatter; by default as `config.noise` says.
        """
        xy, score = clip.detections.xy[frames], clip.detections.score[frames].astype(np.float64)
        noise = noise or DetectionNoise.prior(config.noise, score.shape[1], score.shape[-1])
        confidence = noise.trusted(score)
        confident = (np.fmax(score, confidence) >= th_p) & np.isfinite(xy).all(-1)
        xy = clip.rig.undistort(np.where(confident[..., None], xy, np.nan))
        # Pixels beyond the reach of a lens have no ray.
        confidence = np.where(np.isnan(xy[..., 0]), np.nan, confidence)
        return cls(clip.rig.undistorted, xy, confidence, config.widened(noise.widening), noise)

    def at(self, frame: int) -> Evidence:
        """Return the evidence of one frame."""
        one = slice(frame, frame + 1)
        return replace(self, xy=self.xy[one], confidence=self.confidence[one])

    def triangulate(self, assigned: np.ndarray, iterations: int = 8) -> Points:
        """Triangulate the joints of P people in all frames from the detections assigned to them.

        Args:
            assigned: (F, P, V, J) index of the detection that shows the joint in each view, or `NONE`.
            iterations: See `dmae.reconstruction.triangulation.triangulate`.

        Returns:
            Points (F, P, J), with xyz NaN where fewer than `th_v` views agree.
        """
        xy, confidence = gather(self.xy, self.confidence, np.ascontiguousarray(assigned, np.int64))
        sigma, floor = self.noise.sigma(confidence), self.noise.floor_px
        points = triangulate_by_sigma(self.rig, xy, sigma, floor, self.config.noise, iterations)
        points.xyz[points.views < self.config.th_v] = np.nan
        return points

    def rays(self, frame: int | np.ndarray, view: np.ndarray, detection: np.ndarray) -> np.ndarray:
        """Return unit directions (n, J, 3), world, of the joints of n detections, NaN where absent.

        Args:
            frame: Index of the frame, or indices (n,).
            view: (n,) of each detection.
            detection: (n,) index of each detection in its view.
        """
        xy = self.xy[frame, view, detection]
        direction = np.concatenate([xy, np.ones_like(xy[..., :1])], -1) @ self.rig.world_from_pixel[view].swapaxes(1, 2)
        return direction / np.linalg.norm(direction, axis=-1, keepdims=True)

    def distances(self, xyz: np.ndarray, unit: DistanceUnit) -> np.ndarray:
        """Return distances (F, V, P, D, J) from reprojections of people (F, P, J, 3) to detections."""
        rig = self.rig
        scale = np.full(len(rig), np.nan) if unit == DistanceUnit.metres else 1 / np.hypot(*rig.size.T)
        return measure_distances(rig.projections, rig.focal, scale, self.xy, np.ascontiguousarray(xyz, np.float64))


@compiled()
def gather(xy, confidence, assigned):
    """Return pixels (F, P, J, V, 2) and confidences (F, P, J, V) of assigned detections; NaN where none is assigned.

    Args:
        xy: (F, V, D, J, 2) px.
        confidence: (F, V, D, J).
        assigned: (F, P, V, J) index of the detection that shows the joint in each view; negative for none.
    """
    frames, persons, views, joints = assigned.shape
    found_xy = np.full((frames, persons, joints, views, 2), np.nan)
    found_confidence = np.full((frames, persons, joints, views), np.nan)
    for f in range(frames):
        for p in range(persons):
            for v in range(views):
                for j in range(joints):
                    d = assigned[f, p, v, j]
                    if d >= 0:
                        found_xy[f, p, j, v, 0] = xy[f, v, d, j, 0]
                        found_xy[f, p, j, v, 1] = xy[f, v, d, j, 1]
                        found_confidence[f, p, j, v] = confidence[f, v, d, j]
    return found_xy, found_confidence


@compiled()
def measure_distances(projections, focal, scale, xy, xyz):
    """Return distances (F, V, P, D, J) from reprojections of people to detections; NaN where either is absent.

    Args:
        projections: (V, 3, 4) pinhole projection matrices.
        focal: (V,) px.
        scale: (V,) by which pixels are multiplied; NaN for metres at the depth of the person.
        xy: (F, V, D, J, 2) px; NaN where absent.
        xyz: (F, P, J, 3) m; NaN where unknown.
    """
    frames, views, detections, joints = xy.shape[:4]
    persons = xyz.shape[1]
    distances = np.empty((frames, views, persons, detections, joints))
    for f in range(frames):
        for v in range(views):
            for p in range(persons):
                for j in range(joints):
                    x, y, depth = project(projections[v], xyz[f, p, j])
                    size = depth / focal[v] if np.isnan(scale[v]) else scale[v]
                    for d in range(detections):
                        dx, dy = x - xy[f, v, d, j, 0], y - xy[f, v, d, j, 1]
                        distances[f, v, p, d, j] = np.sqrt(dx * dx + dy * dy) * size
    return distances
