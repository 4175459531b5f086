"""Plane sweep: each 2D pose is moved through depth, and networks of one dimension read its depth from the other views.

Lin and Lee, Multi-View Multi-Person 3D Pose Estimation with Plane Sweep Stereo, CVPR 2021. Layers and constants
follow the released code for Shelf (github.com/jiahaoLjh/PlaneSweepPose). Published on Shelf: 97.9 % PCP (99.3, 96.5,
98.0 by actor).

1. A 2D pose of one view, the target, is put on planes of all depths. On each it is projected into the other views and
   compared with the nearest 2D pose there: a score of each joint by depth.
2. A network turns these scores into the depth of the middle of the hips, section 3.2.
3. The same around this depth, joint by joint: a second network gives the depth of each joint from it, section 3.3.
4. Poses of all targets closer to each other than 10 cm are one person: their mean, weighted by how frontal each is.

What differs:
- The networks have 32 channels, not 128. They learn from poses of people simulated on recorded motion, in rings of
  cameras drawn at random, not from poses of CMU Panoptic in the cameras of Shelf: one set of weights serves any rig.
- The standard deviations of scores are angles: on Shelf, of 10 and 8 px. Depths reach as far as cameras are apart.
- OpenPose leaves joints out: they are left out here as well. A 2D pose without both hips is not swept.

Poses that no other target agrees with stay, as published: precision is low where a 2D pose has no partner.
n 2D poses of a target, J joints of `BODY25`, D depths.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform
from torch import Tensor, nn

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import BODY25
from dmae.reconstruction.config import CaptureConfig, capture_method
from dmae.reconstruction.systems.common import Frame, as_tracks, frames_of, learned_joints, on_body25, project

WEIGHTS = Path(__file__).parents[2] / "models" / "plane_sweep.safetensors"
NEAREST, _FARTHEST, _LIMIT, STEP = 1.0, 8.0, 50.0, 7 / 63
"""m; depths of the first plane, and of the last one at least and at most; and between planes."""
AROUND = np.linspace(-1, 1, 64)  # m; depths of the planes of joints, from the middle of the hips
SIGMA, JOINT_SIGMA = 10 / 1063, 8 / 1063  # rad; at this distance in the image a score is 1/e
_WINDOW = 16  # Planes around the best ones over which the depth of a person is averaged
_SAME_M = 0.1  # m; mean distance of joints below which poses of two targets are one person
_CHANNELS = 32
HIPS = BODY25.index("l_hip", "r_hip")
_SHOULDERS = BODY25.index("l_shoulder", "r_shoulder")


@capture_method("plane_sweep", paper="Lin and Lee 2021")
def capture_by_plane_sweep(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Estimate the depth of each 2D pose by a sweep of planes and two small networks; for joints of BODY_25."""
    here, there = learned_joints(clip, "plane_sweep")
    skeleton, rig = clip.detections.skeleton, clip.rig.undistorted
    networks, found, views = load_networks(), [], []
    for frame in frames_of(clip, config):
        poses, weight = _sweep_frame(on_body25(frame, here, there), rig, networks)
        people, targets = _fused(poses, weight)
        found.append(np.full((len(people), len(skeleton), 3), np.nan))
        views.append(np.zeros((len(people), len(skeleton)), int))
        found[-1][:, here], views[-1][:, here] = people[:, there], targets[:, there]
    return as_tracks(clip, found, views)


def _sweep_frame(frame: Frame, rig: CameraRig, networks: "Networks") -> tuple[np.ndarray, np.ndarray]:
    """Return the poses (N, J, 3), m, of all 2D poses of a frame with hips, and their weights (N,)."""
    swept = np.flatnonzero(np.isfinite(frame.score[:, HIPS]).all(1))
    poses, weight = np.full((len(swept), len(BODY25), 3), np.nan), np.zeros(len(swept))
    depths = planes(rig)
    for view in np.unique(frame.view[swept]):
        target = swept[frame.view[swept] == view]
        with torch.inference_mode():
            scores = sweep(frame, rig, target, np.tile(depths, (len(target), 1)), SIGMA)
            hips = networks.person(torch.from_numpy(scores), torch.from_numpy(depths).float()).numpy()
            scores = sweep(frame, rig, target, hips[:, None] + AROUND, JOINT_SIGMA)
            joints = networks.joints(torch.from_numpy(scores)).numpy() + hips[:, None]
        found = back_projected(rig, int(view), frame.xy[target], joints)
        across = found[:, _SHOULDERS[0]] - found[:, _SHOULDERS[1]]
        front = np.cross(across, found[:, HIPS].mean(1) - found[:, _SHOULDERS].mean(1))
        towards = found[:, HIPS].mean(1) - rig.centers[view]
        with np.errstate(invalid="ignore"):
            cosine = (front * towards).sum(-1) / np.linalg.norm(front, axis=-1) / np.linalg.norm(towards, axis=-1)
        # 90 degrees less the angle to the front or the back. Without shoulders it is unknown: a weight of 1 degree.
        weight[frame.view[swept] == view] = np.nan_to_num(np.degrees(np.arcsin(np.abs(cosine).clip(0, 1))), nan=1.0)
        poses[frame.view[swept] == view] = found
    return poses, weight


def planes(rig: CameraRig) -> np.ndarray:
    """Return the depths (D,) of the planes of a rig, m: those published for Shelf, or more in a larger rig."""
    between = np.linalg.norm(rig.centers[:, None] - rig.centers, axis=-1).max()
    return np.arange(NEAREST, np.clip(between, _FARTHEST, _LIMIT) + STEP / 2, STEP)


def back_projected(rig: CameraRig, view: int, xy: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Return the points (..., 3), m, world, of pixels (..., 2) of a view at depths (...), m, along its axis."""
    rays = np.concatenate([xy, np.ones_like(xy[..., :1])], -1) @ rig.world_from_pixel[view].T
    return rig.centers[view] + rays * depth[..., None]


def sweep(frame: Frame, rig: CameraRig, target: np.ndarray, depths: np.ndarray, sigma: float) -> np.ndarray:
    """Return scores (n, J, D), float32, of 2D poses on planes of depth: near 1 where other views show the joint there.

    Args:
        target: (n,) 2D poses of one view.
        depths: (n, D) m, of the planes of each.
        sigma: rad, distance at which a score is 1/e.
    """
    view = frame.view[target[0]]
    points = back_projected(rig, view, frame.xy[target][:, :, None], depths[:, None])
    total, weights = np.zeros((2, *points.shape[:-1]))
    for other in np.unique(frame.view[frame.view != view]):
        members = np.flatnonzero(frame.view == other)
        xy, _ = project(rig.projections[other], points)
        # (n, m, J, D), rad, squared, and the mean over joints weighted by confidence.
        off = (((xy[:, None] - frame.xy[members][:, :, None]) / rig.focal[other]) ** 2).sum(-1)
        shown = np.nan_to_num(frame.score[members])[None, :, :, None] * np.isfinite(off)
        mean = (np.nan_to_num(off) * shown).sum(2) / np.maximum(shown.sum(2), 1e-8)
        nearest = np.where(shown.any(2), mean, np.inf).argmin(1)
        here, planes_ = np.ogrid[: len(target), : depths.shape[1]]
        off, shown = (np.broadcast_to(each, off.shape)[here, nearest, :, planes_] for each in (off, shown))
        inside = ((xy >= 0) & (xy <= rig.size[other] - 1)).all(-1) * shown.swapaxes(1, 2)
        total += np.exp(-np.nan_to_num(off.swapaxes(1, 2), nan=np.inf) / sigma**2) * inside
        weights += inside
    return (total / (weights + 1e-8)).astype(np.float32)


def _fused(poses: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return people (P, J, 3), m, the weighted means of poses close to each other, and the number of targets (P, J)."""
    if not len(poses):
        return poses, np.zeros(poses.shape[:2], int)
    distance = np.linalg.norm(poses[:, None] - poses, axis=-1)
    shared = np.isfinite(distance)
    mean = np.where(shared, distance, 0).sum(-1) / np.maximum(shared.sum(-1), 1)
    np.fill_diagonal(mean, 0)
    label = np.ones(1, int)
    if len(poses) > 1:
        label = fcluster(linkage(squareform(mean, checks=False), "single"), _SAME_M, "distance")
    people, targets = [], []
    for each in np.unique(label):
        known = np.isfinite(poses[label == each][..., 0])
        shares = known * np.maximum(weight[label == each], 1e-3)[:, None]
        total = (np.nan_to_num(poses[label == each]) * shares[..., None]).sum(0)
        with np.errstate(invalid="ignore"):
            people.append(np.where(known.any(0)[:, None], total / shares.sum(0)[:, None], np.nan))
        targets.append(known.sum(0))
    return np.array(people), np.array(targets)


class Networks(nn.Module):
    """The networks of depth. Both see all joints at once, and convolve over depth alone."""

    def __init__(self):
        super().__init__()
        joints = len(BODY25)
        self.person_layers = _Layers(joints, 1, [[1], [1]])
        self.joint_layers = _Layers(joints, joints, [[1, 2, 4, 8, 16, 32, 1]] * 2)

    def person(self, scores: Tensor, depths: Tensor) -> Tensor:
        """Return the depths (n,) of the middle of the hips, m, from scores (n, J, D) on planes at `depths` (D,), m.

        The mean over the 16 neighbouring planes with the largest probability together.
        """
        share = self.person_layers(scores).softmax(-1)
        mass, moment = (nn.functional.avg_pool1d(each, _WINDOW, 1) for each in (share, share * depths))
        best = mass.argmax(-1, keepdim=True)
        return (moment / (mass + 1e-8)).gather(-1, best)[:, 0, 0]

    def joints(self, scores: Tensor) -> Tensor:
        """Return the depths (n, J) of joints from the middle of the hips, m, from scores (n, J, 64) around it."""
        return (self.joint_layers(scores).softmax(-1) * torch.from_numpy(AROUND).float()).sum(-1)


class _Layers(nn.Module):
    """Residual blocks of convolutions with the given dilations."""

    def __init__(self, inputs: int, outputs: int, dilations: Sequence[Sequence[int]]):
        super().__init__()

        def layer(channels: int, width: int, dilation: int = 1) -> nn.Sequential:
            padding = dilation * (width // 2)
            convolution = nn.Conv1d(channels, _CHANNELS, width, padding=padding, dilation=dilation, bias=False)
            return nn.Sequential(convolution, nn.BatchNorm1d(_CHANNELS), nn.ReLU())

        self.first = layer(inputs, 1)
        blocks = (nn.Sequential(*(layer(_CHANNELS, 3, dilation) for dilation in block)) for block in dilations)
        self.blocks = nn.ModuleList(blocks)
        self.last = nn.Conv1d(_CHANNELS, outputs, 1, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        x = self.first(x)
        for block in self.blocks:
            x = x + block(x)
        return self.last(x)


@cache
def load_networks() -> Networks:
    """Return the trained networks."""
    networks = Networks()
    networks.load_state_dict({name: each.float() for name, each in load_file(WEIGHTS).items()}, strict=False)
    return networks.eval()
