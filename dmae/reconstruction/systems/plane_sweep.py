"""Plane sweep: each 2D pose is moved through depth, and networks of one dimension read its depth from the other views.

Lin and Lee, Multi-View Multi-Person 3D Pose Estimation with Plane Sweep Stereo, CVPR 2021. Layers and constants are
those of the released code for Shelf (github.com/jiahaoLjh/PlaneSweepPose). Published on Shelf: 97.9 % PCP (99.3, 96.5,
98.0 by actor).

1. A 2D pose of one view, the target, is put on planes of all depths. On each it is projected into the other views and
   compared with the nearest 2D pose there: a score of each joint by depth.
2. A network turns these scores into the depth of the middle of the hips, section 3.2.
3. The same around this depth, joint by joint: a second network gives the depth of each joint from it, section 3.3.
4. Poses of all targets closer to each other than 10 cm are one person: their mean, weighted by how frontal each is.

What differs:
- The networks have 32 channels, not 128. They learn from poses of people simulated on recorded motion, in rings of
  cameras drawn at random, not from poses of CMU Panoptic in the cameras of Shelf: one set of weights serves any rig.
- The standard deviations of scores are angles, those of 10 and 8 px on Shelf. Depths reach as far as cameras are apart.
- OpenPose leaves joints out: they are left out here as well. A 2D pose without both hips is not swept.

Poses that no other target agrees with stay, as published: precision is low where a 2D pose has no partner.
n 2D poses of a target, J joints of `BODY25`, D depths.
"""

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import load_file, save_file
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial.distance import squareform
from torch import Tensor, nn

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import BODY25
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.registry import capture_method
from dmae.reconstruction.systems.common import Frame, as_tracks, frames_of, project

WEIGHTS = Path(__file__).parents[2] / "models" / "plane_sweep.safetensors"
_NEAREST, _FARTHEST, _LIMIT, _STEP = 1.0, 8.0, 50.0, 7 / 63
"""m; depths of the first plane, and of the last one at least and at most; and between planes."""
_AROUND = np.linspace(-1, 1, 64)  # m; depths of the planes of joints, from the middle of the hips
_SIGMA, _JOINT_SIGMA = 10 / 1063, 8 / 1063  # rad; at this distance in the image a score is 1/e
_WINDOW = 16  # Planes around the best ones over which the depth of a person is averaged
_SAME_M = 0.1  # m; mean distance of joints below which poses of two targets are one person
_CHANNELS = 32
_HIPS = BODY25.index("l_hip", "r_hip")
_SHOULDERS = BODY25.index("l_shoulder", "r_shoulder")


@capture_method("plane_sweep", paper="Lin and Lee 2021")
def capture_by_plane_sweep(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Estimate the depth of each 2D pose by a sweep of planes and two small networks; for joints of BODY_25."""
    skeleton, rig = clip.detections.skeleton, clip.rig.undistorted
    shared = [joint for joint in skeleton.joints if joint in BODY25.joints]
    if not {"l_hip", "r_hip", "l_shoulder", "r_shoulder"} <= set(shared):
        raise ValueError(
            f"clip {clip.id!r}: method=plane_sweep has learned joints of {BODY25.name}, hips and shoulders among them; "
            f"found {skeleton.name!r} with {len(shared)} of them"
        )
    here, there = skeleton.index(*shared), BODY25.index(*shared)
    networks, found, views = load_networks(), [], []
    for frame in frames_of(clip, config):
        poses, weight = _sweep_frame(_on_body25(frame, here, there), rig, networks)
        people, targets = _fused(poses, weight)
        found.append(np.full((len(people), len(skeleton), 3), np.nan))
        views.append(np.zeros((len(people), len(skeleton)), int))
        found[-1][:, here], views[-1][:, here] = people[:, there], targets[:, there]
    return as_tracks(clip, found, views)


def _on_body25(frame: Frame, here: list[int], there: list[int]) -> Frame:
    count = len(frame.view)
    xy, score, rays = (np.full((count, len(BODY25), *each), np.nan) for each in ((2,), (), (3,)))
    xy[:, there], score[:, there], rays[:, there] = frame.xy[:, here], frame.score[:, here], frame.rays[:, here]
    return Frame(frame.view, xy, score, rays)


def _sweep_frame(frame: Frame, rig: CameraRig, networks: "Networks") -> tuple[np.ndarray, np.ndarray]:
    """Return the poses (N, J, 3), m, of all 2D poses of a frame with hips, and their weights (N,)."""
    swept = np.flatnonzero(np.isfinite(frame.score[:, _HIPS]).all(1))
    poses, weight = np.full((len(swept), len(BODY25), 3), np.nan), np.zeros(len(swept))
    depths = planes(rig)
    for view in np.unique(frame.view[swept]):
        target = swept[frame.view[swept] == view]
        with torch.inference_mode():
            scores = sweep(frame, rig, target, np.tile(depths, (len(target), 1)), _SIGMA)
            hips = networks.person(torch.from_numpy(scores), torch.from_numpy(depths).float()).numpy()
            scores = sweep(frame, rig, target, hips[:, None] + _AROUND, _JOINT_SIGMA)
            joints = networks.joints(torch.from_numpy(scores)).numpy() + hips[:, None]
        found = back_projected(rig, int(view), frame.xy[target], joints)
        across = found[:, _SHOULDERS[0]] - found[:, _SHOULDERS[1]]
        front = np.cross(across, found[:, _HIPS].mean(1) - found[:, _SHOULDERS].mean(1))
        towards = found[:, _HIPS].mean(1) - rig.centers[view]
        with np.errstate(invalid="ignore"):
            cosine = (front * towards).sum(-1) / np.linalg.norm(front, axis=-1) / np.linalg.norm(towards, axis=-1)
        # 90 degrees less the angle to the front or the back. Without shoulders it is unknown: a weight of 1 degree.
        weight[frame.view[swept] == view] = np.nan_to_num(np.degrees(np.arcsin(np.abs(cosine).clip(0, 1))), nan=1.0)
        poses[frame.view[swept] == view] = found
    return poses, weight


def planes(rig: CameraRig) -> np.ndarray:
    """Return the depths (D,) of the planes of a rig, m: those published for Shelf, or more in a larger rig."""
    between = np.linalg.norm(rig.centers[:, None] - rig.centers, axis=-1).max()
    return np.arange(_NEAREST, np.clip(between, _FARTHEST, _LIMIT) + _STEP / 2, _STEP)


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
        return (self.joint_layers(scores).softmax(-1) * torch.from_numpy(_AROUND).float()).sum(-1)


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


# Training, on people placed at random in rings of cameras.

_BATCH, _RATE = 8, 2e-3
_MISSING = {"elbow": 0.1, "knee": 0.1, "wrist": 0.2, "ankle": 0.2}  # How often a joint is not detected; others 0.05


def train(poses: np.ndarray, steps: int, rng: np.random.Generator, out: Path) -> None:
    """Train the networks for any ring of cameras, and write their weights.

    Args:
        poses: (N, 25, 3) m, people on BODY_25, z up.
        steps: Batches of 8 scenes.
        rng: Draws scenes.
        out: File of the weights.
    """
    networks = Networks()
    optimiser = torch.optim.AdamW(networks.parameters(), _RATE)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps)
    for step in progress(range(steps), "training"):
        drawn = [scene for _ in range(_BATCH) if (scene := _scene(poses, rng)) is not None]
        scores, around, *truth = (
            [torch.from_numpy(each).float() for each in parts] for parts in zip(*drawn, strict=True)
        )
        # Planes that a rig does not reach have scores of zero.
        longest = max(each.shape[-1] for each in scores)
        scores = torch.cat([nn.functional.pad(each, (0, longest - each.shape[-1])) for each in scores])
        hips, joints = (torch.cat(each) for each in truth)
        person = networks.person(scores, _NEAREST + _STEP * torch.arange(longest))
        relative, known = networks.joints(torch.cat(around)), torch.isfinite(joints)
        losses = [(person - hips).abs().mean(), (relative - joints)[known].abs().mean()]
        optimiser.zero_grad()
        sum(losses).backward()
        optimiser.step()
        schedule.step()
        if (step + 1) % 100 == 0:
            print(f"step {step + 1}: hips {1000 * losses[0]:.0f} mm, joints {1000 * losses[1]:.0f} mm")
    tensors = {name: each for name, each in networks.state_dict().items() if each.is_floating_point()}
    save_file({name: each.half().contiguous() for name, each in tensors.items()}, out)


def _scene(poses: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, ...] | None:
    """Return what a target view has to learn: scores by depth, scores around the true depth of the hips, and the true
    depths of hips and, from there, of joints. None where the view sees nobody's hips."""
    rig = _ring(rng)
    chosen = poses[rng.integers(len(poses), size=rng.integers(1, 6))]
    angle = rng.uniform(-np.pi, np.pi, len(chosen))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
    middle = chosen[:, _HIPS, :2].mean(1, keepdims=True)
    room = max(np.linalg.norm(rig.centers[0, :2]) - 1.5, 1)
    xyz = chosen.astype(float)
    xyz[..., :2] = (xyz[..., :2] - middle) @ turn.swapaxes(1, 2) + rng.uniform(-room, room, (len(chosen), 1, 2)) / 1.4
    xy, depth = (each[0] for each in rig.project(xyz[None]))
    often = np.array([_MISSING.get(joint[2:], 0.05) for joint in BODY25.joints])
    lost = rng.random(depth.shape) < often
    xy = xy + rng.normal(0, rng.uniform(1, 5), xy.shape)
    seen = np.isfinite(xy).all(-1) & rig.inside(xy[None])[0] & ~lost
    view, row = np.nonzero(seen[:, :, _HIPS].all(-1))
    xy, score = np.where(seen[..., None], xy, np.nan), np.where(seen, rng.uniform(0.4, 1, seen.shape), np.nan)
    frame = Frame(view, xy[view, row], score[view, row], np.empty((len(view), 0, 3)))
    target = np.flatnonzero(view == rng.integers(len(rig)))
    if not len(target):
        return None
    of_people = depth[view[target], row[target]]
    hips, depths = of_people[:, _HIPS].mean(1), planes(rig)
    scores = sweep(frame, rig, target, np.tile(depths, (len(target), 1)), _SIGMA)
    around = sweep(frame, rig, target, hips[:, None] + _AROUND, _JOINT_SIGMA)
    known = np.isfinite(frame.score[target])
    return scores, around, hips, np.where(known, of_people - hips[:, None], np.nan)


def _ring(rng: np.random.Generator) -> CameraRig:
    """Return 3 to 6 cameras of Shelf's image size around the origin, with any lens that shows whole people."""
    views, radius = rng.integers(3, 7), rng.uniform(3.5, 6.5)
    angle = np.linspace(0, 2 * np.pi, views, endpoint=False) + rng.uniform(-0.4, 0.4, views)
    centers = np.stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(1.2, 3.5, views)], -1)
    cam_from_world = np.tile(np.eye(4), (views, 1, 1))
    forward = np.append(rng.uniform(-0.5, 0.5, 2), 1) - centers
    forward /= np.linalg.norm(forward, axis=-1, keepdims=True)
    right = np.cross(forward, (0, 0, 1.0))
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    cam_from_world[:, :3, :3] = np.stack([right, np.cross(forward, right), forward], 1)
    cam_from_world[:, :3, 3] = -(cam_from_world[:, :3, :3] @ centers[..., None])[..., 0]
    focal = rng.uniform(0.17, 0.3) * radius * 1032
    K = np.array([[focal, 0, 515.5], [0, focal, 387.5], [0, 0, 1]])
    sizes = np.tile((1032, 776), (views, 1))
    return CameraRig(
        [f"c{i}" for i in range(views)], np.tile(K, (views, 1, 1)), np.zeros((views, 5)), cam_from_world, sizes
    )
