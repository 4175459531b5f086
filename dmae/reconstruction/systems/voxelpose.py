"""VoxelPose: heatmaps of all views are averaged in voxels, where one network finds people and another their joints.

Tu, Wang and Zeng, VoxelPose: Towards Multi-Camera 3D Human Pose Estimation in Wild Environment, ECCV 2020. The
released code (github.com/microsoft/voxelpose-pytorch) gives the constants for Shelf. It sees no images there either,
but draws heatmaps around 2D poses. Published on Shelf: 97.0 % PCP.

1. A heatmap of each joint and view has a Gaussian around each 2D pose's joint, as high as its confidence.
2. The room is a grid of coarse voxels. Each takes the mean of the heatmaps where it is seen, joint by joint. A network
   gives the probability that the middle of someone's hips is there, section 3.2; its local maxima are the proposals.
3. The 2 m around a proposal are a grid of fine voxels. A second network gives each joint a score in each voxel; the
   joint is the mean place by the softmax of its scores, section 3.3.

What differs:
- Grids are the smaller ones of the released configurations, 48 x 48 x 12 and 32 x 32 x 32 voxels. Networks have half
  the channels or fewer, and first layers of 3 voxels instead of 7.
- The averaged heatmap is added to the scores of joints, and the network sees where a voxel is in its cube: there is
  less to learn.
- They learn from people simulated on recorded motion in the cameras of Shelf and in rings drawn at random, not from
  poses of CMU Panoptic in the cameras of Shelf: one set of weights serves any rig.
- Heatmaps are not images: Gaussians are computed at the projections of voxels. They are twice as wide for coarse
  voxels, which are farther apart than the published width.
- The room reaches as far as cameras are apart. A camera that detects nothing in a frame takes no part in it.

Every person gets all joints, even if no view shows them.
J joints of `BODY25`, V views, n 2D poses of a frame, N voxels.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import BODY25
from dmae.numerics.compiled import compiled
from dmae.reconstruction.config import CaptureConfig, capture_method
from dmae.reconstruction.systems.common import Frame, as_tracks, frames_of, learned_joints, on_body25

WEIGHTS = Path(__file__).parents[2] / "models" / "voxelpose.safetensors"
COARSE, BOTTOM, LAYERS = 1 / 6, -0.2, 12
"""m, between coarse voxels; the lowest ones; and the number of their layers."""
_ROOM, _LARGEST = 8, 24  # m; sides of the room at least and at most
FINE, SIDE = 2 / 32, 32
"""m, between fine voxels; and their number along a side around a proposal."""
SPREAD = 0.2  # m; standard deviation of the probability that the network of proposals learns around hips
_LEAST, _MOST_PEOPLE = 0.1, 10  # Smallest probability of a proposal, and largest number of proposals
_WIDTH, _SMALLEST, _LARGEST_BODY = 3 * 2**0.5 / 96, 48 / 200, 192 / 200
"""Standard deviation of a Gaussian by the longer side of the box of a 2D pose; limits of that side by image width."""
COARSE_WIDTH = 2.0
"""How much wider Gaussians are for coarse voxels."""
HIPS = BODY25.index("l_hip", "r_hip")


@capture_method("voxelpose", paper="Tu et al. 2020")
def capture_by_voxels(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Find people and joints in voxels of averaged heatmaps, by two small networks; for joints of BODY_25."""
    here, there = learned_joints(clip, "voxelpose")
    rig, networks, found, views = clip.rig.undistorted, load_networks(), [], []
    seeing = np.flatnonzero(np.isfinite(clip.detections.score).any((0, 2, 3)))
    room = coarse_grid(rig[seeing]) if len(seeing) else np.empty((0, 0, 0, 3))
    for frame in frames_of(clip, config):
        people, used = _people(on_body25(frame, here, there), rig, room, networks)
        found.append(np.full((len(people), len(clip.detections.skeleton), 3), np.nan))
        views.append(np.zeros(found[-1].shape[:2], int))
        found[-1][:, here], views[-1][:, here] = people[:, there], used[:, there]
    return as_tracks(clip, found, views)


def _people(frame: Frame, rig: CameraRig, room: np.ndarray, networks: "Networks") -> tuple[np.ndarray, np.ndarray]:
    """Return the people (P, J, 3), m, of a frame, and the number of views (P, J) that are averaged."""
    if not len(frame.view):
        return np.empty((0, len(BODY25), 3)), np.zeros((0, len(BODY25)), int)
    with torch.inference_mode():
        scores = networks.hips(as_volume(heat(frame, rig, room, COARSE_WIDTH)))[0]
        peaks = nn.functional.max_pool3d(scores[None], 3, 1, 1)[0]
        chosen = torch.where((scores == peaks) & (scores > _LEAST), scores, 0).flatten()
        best = chosen.topk(min(_MOST_PEOPLE, len(chosen)))
        centers = room.reshape(-1, 3)[best.indices[best.values > 0].numpy()]
        poses = [networks.joints(as_volume(heat(frame, rig, fine_grid(center)))).numpy() + center for center in centers]
    people = np.concatenate(poses) if poses else np.empty((0, len(BODY25), 3))
    return people, np.full(people.shape[:2], len(np.unique(frame.view)))


def coarse_grid(rig: CameraRig) -> np.ndarray:
    """Return the coarse voxels (X, X, Z, 3), m, of the room around the point where cameras look."""
    forward = rig.cam_from_world[:, 2, :3]
    across = np.eye(3) - forward[:, :, None] * forward[:, None]  # Displacements from the axis of each camera
    middle = np.linalg.lstsq(across.sum(0), (across @ rig.centers[..., None]).sum(0)[:, 0], rcond=None)[0]
    apart = np.linalg.norm(rig.centers[:, None, :2] - rig.centers[:, :2], axis=-1).max()
    side = 4 * round(np.clip(apart, _ROOM, _LARGEST) / COARSE / 4)
    across = (np.arange(side) - (side - 1) / 2) * COARSE
    up = BOTTOM + (np.arange(LAYERS) + 0.5) * COARSE
    return np.stack(np.meshgrid(middle[0] + across, middle[1] + across, up, indexing="ij"), -1)


def fine_grid(center: np.ndarray) -> np.ndarray:
    """Return the fine voxels (32, 32, 32, 3), m, of the cube around a proposal (3,)."""
    return center + np.stack(np.meshgrid(*[(np.arange(SIDE) - (SIDE - 1) / 2) * FINE] * 3, indexing="ij"), -1)


def heat(frame: Frame, rig: CameraRig, grid: np.ndarray, wider: float = 1.0) -> np.ndarray:
    """Return heatmaps (..., J), float32, at voxels (..., 3), m: the mean over the views in whose images they are."""
    low, high = np.nanmin(frame.xy, 1), np.nanmax(frame.xy, 1)
    width = rig.size[frame.view, 0]
    body = np.clip((high - low).max(-1), _SMALLEST * width, _LARGEST_BODY * width)
    sigma = wider * _WIDTH * body
    views = np.unique(frame.view)
    start = np.searchsorted(frame.view, [*views, views[-1] + 1])
    reach = 3 * sigma[:, None]
    heights = np.nan_to_num(frame.score).astype(np.float32)
    boxes = np.concatenate([low - reach, high + reach], 1)
    out = np.empty((*grid.shape[:-1], heights.shape[1]), np.float32)
    _average(
        grid.reshape(-1, 3), rig.projections[views], rig.size[views].astype(float), start, boxes,
        np.nan_to_num(frame.xy), heights, 1 / (2 * sigma**2), out.reshape(-1, heights.shape[1]),
    )  # fmt: skip
    return out


@compiled(fastmath=True)
def _average(points, projections, sizes, start, boxes, xy, heights, by_square, out):
    highest = np.empty(out.shape[1], out.dtype)
    for voxel in range(len(points)):
        x, y, z = points[voxel]
        out[voxel] = 0
        count = 0
        for view in range(len(projections)):
            P = projections[view]
            depth = P[2, 0] * x + P[2, 1] * y + P[2, 2] * z + P[2, 3]
            if depth <= 0:
                continue
            u = (P[0, 0] * x + P[0, 1] * y + P[0, 2] * z + P[0, 3]) / depth
            v = (P[1, 0] * x + P[1, 1] * y + P[1, 2] * z + P[1, 3]) / depth
            if u < 0 or v < 0 or u > sizes[view, 0] - 1 or v > sizes[view, 1] - 1:
                continue
            count += 1
            shown = False
            for pose in range(start[view], start[view + 1]):
                if u < boxes[pose, 0] or v < boxes[pose, 1] or u > boxes[pose, 2] or v > boxes[pose, 3]:
                    continue
                if not shown:
                    highest[:] = 0
                    shown = True
                for joint in range(out.shape[1]):
                    off = (xy[pose, joint, 0] - u) ** 2 + (xy[pose, joint, 1] - v) ** 2
                    off *= by_square[pose]
                    if off < 4.5:  # 3 standard deviations
                        highest[joint] = max(highest[joint], heights[pose, joint] * np.exp(-off))
            if shown:
                for joint in range(out.shape[1]):
                    out[voxel, joint] += highest[joint]
        for joint in range(out.shape[1]):
            out[voxel, joint] /= max(count, 1)


def as_volume(values: np.ndarray) -> Tensor:
    """Return values (X, Y, Z, J) of voxels as a batch of one (1, J, X, Y, Z), with joints together in memory."""
    return torch.from_numpy(values)[None].permute(0, 4, 1, 2, 3)


_PLACES = (torch.arange(SIDE) - (SIDE - 1) / 2) * FINE
_X, _Y, _Z = torch.meshgrid(_PLACES, _PLACES, _PLACES, indexing="ij")
_WHERE = torch.stack([_X, _Y, _Z, torch.hypot(_X, _Y)])  # (4, 32, 32, 32) m, places in the cube


class Networks(nn.Module):
    """The networks of proposals and of joints."""

    def __init__(self):
        super().__init__()
        joints = len(BODY25)
        self.hip_layers = Volumes(joints, 1, (8, 16, 32))
        self.joint_layers = Volumes(joints + len(_WHERE), joints, (16, 32, 48))
        self.gain = nn.Parameter(torch.full((joints,), 0.3))

    def hips(self, heatmaps: Tensor) -> Tensor:
        """Return how probably the hips' middle is in each voxel (n, X, Y, Z), from heatmaps (n, J, X, Y, Z)."""
        return self.hip_layers(heatmaps)[:, 0]

    def joints(self, heatmaps: Tensor) -> Tensor:
        """Return joints (n, J, 3), m, from the middle of the cube, from heatmaps (n, J, 32, 32, 32)."""
        where = _WHERE.to(heatmaps.dtype).expand(len(heatmaps), -1, -1, -1, -1)
        seen = torch.cat([heatmaps, where], 1).contiguous(memory_format=torch.channels_last_3d)
        scores = 10 * self.joint_layers(seen).float() + 100 * self.gain[:, None, None, None] * heatmaps
        share = scores.flatten(2).softmax(-1).unflatten(2, (SIDE,) * 3)
        return torch.stack([share.sum(rest) @ _PLACES for rest in ((3, 4), (2, 4), (2, 3))], -1)


class Volumes(nn.Module):
    """The encoder and decoder of V2V-PoseNet over three resolutions, with additions across."""

    def __init__(self, inputs: int, outputs: int, channels: Sequence[int]):
        super().__init__()
        a, b, c = channels
        self.first = nn.Sequential(nn.Conv3d(inputs, a, 3, padding=1, bias=False), nn.BatchNorm3d(a), nn.ReLU())
        self.down = nn.ModuleList([_Residual(a, b), _Residual(b, c)])
        self.across = _Residual(b, b)
        self.deepest = _Residual(c, c)
        self.up = nn.ModuleList([_doubled(b, a), _doubled(c, b)])
        self.last = nn.Conv3d(a, outputs, 1)
        nn.init.zeros_(self.last.weight)

    def forward(self, x: Tensor) -> Tensor:
        fine = self.first(x)
        middle = self.down[0](nn.functional.max_pool3d(fine, 2))
        coarse = self.deepest(self.down[1](nn.functional.max_pool3d(middle, 2)))
        middle = self.across(middle) + self.up[1](coarse)
        return self.last(fine + self.up[0](middle))


def _doubled(inputs: int, outputs: int) -> nn.Sequential:
    return nn.Sequential(nn.ConvTranspose3d(inputs, outputs, 2, 2, bias=False), nn.BatchNorm3d(outputs), nn.ReLU())


class _Residual(nn.Module):
    """Two convolutions beside one of a single voxel."""

    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        self.around = nn.Sequential(
            nn.Conv3d(inputs, outputs, 3, padding=1, bias=False),
            nn.BatchNorm3d(outputs),
            nn.ReLU(),
            nn.Conv3d(outputs, outputs, 3, padding=1, bias=False),
            nn.BatchNorm3d(outputs),
        )
        same = inputs == outputs
        self.beside = nn.Identity() if same else nn.Conv3d(inputs, outputs, 1)

    def forward(self, x: Tensor) -> Tensor:
        return (self.beside(x) + self.around(x)).relu()


@cache
def load_networks() -> Networks:
    """Return the trained networks."""
    networks = Networks()
    networks.load_state_dict({name: each.float() for name, each in load_file(WEIGHTS).items()}, strict=False)
    return networks.eval()
