"""Train the networks of the plane sweep (`dmae.reconstruction.systems.plane_sweep`) and write the package's weights.

    synth generate motion=recorded motion.path=$DMAE_DATA/cmu clips=60 seed=61 scene.fps=10 scene.seconds=6 \
      scene.persons=[2,3] rig=ring rig.ring.views=2 out=people
    python docs/tools/plane_sweep.py people 3000

Only the poses of the clips are used: cameras and places are drawn for every scene.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from torch import nn

import dmae
from dmae.data.cameras import CameraRig
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25
from dmae.progress import progress
from dmae.reconstruction.systems.common import Frame
from dmae.reconstruction.systems.plane_sweep import (
    AROUND,
    HIPS,
    JOINT_SIGMA,
    NEAREST,
    SIGMA,
    STEP,
    WEIGHTS,
    Networks,
    planes,
    sweep,
)

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
        person = networks.person(scores, NEAREST + STEP * torch.arange(longest))
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
    rig = ring(rng)
    chosen = poses[rng.integers(len(poses), size=rng.integers(1, 6))]
    angle = rng.uniform(-np.pi, np.pi, len(chosen))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
    middle = chosen[:, HIPS, :2].mean(1, keepdims=True)
    room = max(np.linalg.norm(rig.centers[0, :2]) - 1.5, 1)
    xyz = chosen.astype(float)
    xyz[..., :2] = (xyz[..., :2] - middle) @ turn.swapaxes(1, 2) + rng.uniform(-room, room, (len(chosen), 1, 2)) / 1.4
    xy, depth = (each[0] for each in rig.project(xyz[None]))
    often = np.array([_MISSING.get(joint[2:], 0.05) for joint in BODY25.joints])
    lost = rng.random(depth.shape) < often
    xy = xy + rng.normal(0, rng.uniform(1, 5), xy.shape)
    seen = np.isfinite(xy).all(-1) & rig.inside(xy[None])[0] & ~lost
    view, row = np.nonzero(seen[:, :, HIPS].all(-1))
    xy, score = np.where(seen[..., None], xy, np.nan), np.where(seen, rng.uniform(0.4, 1, seen.shape), np.nan)
    frame = Frame(view, xy[view, row], score[view, row], np.empty((len(view), 0, 3)))
    target = np.flatnonzero(view == rng.integers(len(rig)))
    if not len(target):
        return None
    of_people = depth[view[target], row[target]]
    hips, depths = of_people[:, HIPS].mean(1), planes(rig)
    scores = sweep(frame, rig, target, np.tile(depths, (len(target), 1)), SIGMA)
    around = sweep(frame, rig, target, hips[:, None] + AROUND, JOINT_SIGMA)
    known = np.isfinite(frame.score[target])
    return scores, around, hips, np.where(known, of_people - hips[:, None], np.nan)


def ring(rng: np.random.Generator) -> CameraRig:
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


def poses_of(folder: str) -> np.ndarray:
    """Return all whole poses (N, 25, 3), m, of a set of simulated clips, on BODY_25."""
    poses = np.concatenate([convert(clip.truth, BODY25).xyz.reshape(-1, 25, 3) for clip in dmae.load_dataset(folder)])
    return poses[np.isfinite(poses).all((1, 2))]


def main(folder: str, steps: int) -> None:
    poses = poses_of(folder)
    print(f"{len(poses)} poses")
    torch.manual_seed(0)
    train(poses, steps, np.random.default_rng(0), WEIGHTS)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
