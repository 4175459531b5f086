"""The evidence of each candidate camera on each joint: the probability and the accuracy of its detection."""

from dataclasses import dataclass

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25
from synth.datasets.occlusion import DETECTED
from synth.detector.config import DetectorConfig
from synth.detector.parts import by_joint
from synth.detector.view import ErrorStream, View, height
from synth.labels.visibility import joint_visibility
from synth.planning.candidates import CandidateCameras
from synth.planning.rehearsal import Rehearsal
from synth.rigs.camera_geometry import intrinsics

_JOINTS = BODY25.index(
    "nose", "r_ear", "l_ear", "neck", "r_shoulder", "r_elbow", "r_wrist", "l_shoulder", "l_elbow", "l_wrist",
    "r_hip", "r_knee", "r_ankle", "l_hip", "l_knee", "l_ankle",
)  # fmt: skip
"""Joints that are used. Of joints that are close together only one is used."""
_WIDE_FOCAL, _WIDE_SIDE = 20.0, 4000
"""Focal length and image side of a pinhole that sees nearly everything in front of it, px. It tests all directions from
one place."""
_LEAST_SCALE = 0.003
"""Least error of a detected joint if a preset has no noise, m."""


@dataclass(frozen=True)
class JointEvidence:
    """Evidence of C candidates on N joints. Each person, joint and frame counts as one of the N.

    Attributes:
        probability: (N, C) float32 probability that the camera detects the joint.
        information: (N, C, 6) float32 inverse covariance of the joint's position from one camera, 1/m^2, times the
            probability: xx, yy, zz, xy, xz, yz.
    """

    probability: np.ndarray
    information: np.ndarray

    @staticmethod
    def joined(parts: list["JointEvidence"]) -> "JointEvidence":
        """Return the joined evidence of several clips."""
        return JointEvidence(
            np.concatenate([part.probability for part in parts]), np.concatenate([part.information for part in parts])
        )


def gather(rehearsal: Rehearsal, candidates: CandidateCameras, detector: DetectorConfig, frames: int) -> JointEvidence:
    """Return the evidence of candidates on the joints of a clip.

    Visibility is computed once for each place, by rays through the simulated scene. The detector's preset gives the
    probability and the accuracy of a detection for each kind of visibility.

    Args:
        rehearsal: The clip.
        candidates: C cameras.
        detector: The detector.
        frames: Number of frames that are used, evenly spread.
    """
    chosen = np.unique(np.linspace(0, len(rehearsal.qpos) - 1, frames).round().astype(int))
    joints = rehearsal.joints[chosen][:, :, DETECTED]
    first = np.unique(candidates.place, return_index=True)[1]
    rank = np.searchsorted(candidates.place[first], candidates.place)
    seen = joint_visibility(
        rehearsal.model, rehearsal.qpos[chosen], joints, rehearsal.depth[:, DETECTED], rehearsal.geom_ids,
        _all_round(candidates.rig[first]), rehearsal.bodies[:, DETECTED], rehearsal.objects,
    )  # fmt: skip
    xy, along = candidates.rig.project(joints)
    inside = candidates.rig.inside(xy) & (along > 0)
    parts = by_joint(detector.parts)
    probability, scale = np.empty((2, *xy.shape[:-1]))
    for camera in range(len(candidates)):
        visibility = np.where(inside[:, camera], seen.visibility[:, rank[camera]], Visibility.OUTSIDE_IMAGE)
        view = View(
            fps=rehearsal.spec.fps, size=candidates.rig.size[camera], xyz=joints, true_xy=xy[:, camera],
            visibility=visibility, occluder=seen.occluder[:, rank[camera]], parts=parts, times=detector.times,
            minimum_score=0.0, random=_unused,
        )  # fmt: skip
        probability[:, camera] = 1 - detector.misses.probability(view)
        pixels = np.hypot(parts["noise"] * height(xy[:, camera])[..., None], detector.noise.minimum)
        pixels = pixels * np.where(visibility == Visibility.VISIBLE, 1.0, detector.noise.hidden)
        scale[:, camera] = pixels * along[:, camera] / candidates.rig.K[camera, 0, 0]
    return _evidence(joints, candidates.rig, probability, scale)


def _unused(stream: ErrorStream) -> np.random.Generator:
    raise AssertionError(f"a probability drew random numbers of {stream.name}")


def _evidence(joints: np.ndarray, rig: CameraRig, probability: np.ndarray, scale: np.ndarray) -> JointEvidence:
    """Return the evidence on joints (F, P, 25, 3), m. `probability` and `scale`, m, are (F, C, P, 25) each."""
    toward = joints[:, None] - rig.centers[:, None, None]
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    x, y, z = np.moveaxis(toward, -1, 0)
    # A camera measures the position across its ray, but not along it.
    plane = np.stack([1 - x * x, 1 - y * y, 1 - z * z, -x * y, -x * z, -y * z], -1)
    weight = probability / np.maximum(np.nan_to_num(scale, nan=np.inf), _LEAST_SCALE) ** 2
    present = np.isfinite(joints).all(-1)[:, :, _JOINTS]
    rows = [
        np.moveaxis(array[:, :, :, _JOINTS], 1, 3)[present].astype(np.float32)
        for array in (probability, np.nan_to_num(plane * weight[..., None]))
    ]
    return JointEvidence(*rows)


def _all_round(rig: CameraRig) -> CameraRig:
    """Return cameras at the same places that see nearly everything in front of them."""
    side = [_WIDE_SIDE, _WIDE_SIDE]
    return CameraRig(
        rig.names, np.tile(intrinsics(_WIDE_FOCAL, side), (len(rig), 1, 1)), np.zeros((len(rig), 5)),
        rig.cam_from_world, np.tile(side, (len(rig), 1)),
    )  # fmt: skip
