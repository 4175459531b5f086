"""Train the networks of VoxelPose (`dmae.reconstruction.systems.voxelpose`) and write the package's weights.

    synth generate motion=recorded motion.path=$DMAE_DATA/cmu clips=60 seed=61 scene.fps=10 scene.seconds=6 \
      scene.persons=[2,3] rig=ring rig.ring.views=2 out=people
    python docs/tools/voxelpose.py people 1400

Only the poses of the clips are used. They are placed at random between the cameras of Shelf or those of a ring
drawn for the scene. A training that was interrupted goes on when the command is given again.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from plane_sweep import poses_of, ring
from safetensors.torch import save_file
from torch import nn

from dmae.data.cameras import CameraRig
from dmae.data.skeleton import BODY25
from dmae.formats.calibrations import read_calibration
from dmae.progress import progress
from dmae.reconstruction.systems.common import Frame
from dmae.reconstruction.systems.voxelpose import (
    COARSE,
    COARSE_WIDTH,
    HIPS,
    SPREAD,
    WEIGHTS,
    Networks,
    as_volume,
    coarse_grid,
    fine_grid,
    heat,
)

_RATE, _WARMING, _FALLING = 2e-3, 100, 0.4
"""Rate of the optimiser; steps in which it rises to that; share of the steps, the last ones, in which it falls to 0."""
_PEOPLE, _CLOSEST, _KEPT_EVERY = 4, 0.4, 200
"""People of a step at most; m, between hips of two people at least; steps between states that are kept."""
_MISSING = {"elbow": 0.1, "knee": 0.1, "wrist": 0.15, "ankle": 0.15}  # How often a joint is not detected; others 0.05
_UNSEEN, _SWAPPED, _ASTRAY, _BEHIND, _LEAST_JOINTS = 0.08, 0.02, 0.03, 0.15, 4
"""How often a view does not detect a person, takes left for right, puts a joint elsewhere, and sees someone in part;
and joints of a 2D pose at least."""


def train(poses: np.ndarray, steps: int, shelf: CameraRig, rng: np.random.Generator, out: Path) -> None:
    """Train the networks on one scene a step, and write their weights.

    Args:
        poses: (N, 25, 3) m, people on BODY_25, z up.
        steps: Scenes.
        shelf: Cameras of half of the scenes.
        rng: Draws scenes.
        out: File of the weights. Beside it, `.state` keeps the state of an unfinished training.
    """
    networks = Networks().to(memory_format=torch.channels_last_3d)
    optimiser = torch.optim.AdamW(networks.parameters(), _RATE)
    state, begin, parts, recent = out.with_suffix(".state"), 0, (networks, optimiser), []
    if state.exists():
        begin, kept, rng.bit_generator.state = torch.load(state)
        for part, values in zip(parts, kept, strict=True):
            part.load_state_dict(values)
    for step in progress(range(begin, steps), "training"):
        optimiser.param_groups[0]["lr"] = _RATE * min((step + 1) / _WARMING, (steps - step) / (_FALLING * steps), 1)
        frame, rig, people = scene(poses, shelf, rng)
        room, hips = coarse_grid(rig), people[:, HIPS].mean(1)
        square = ((room[..., None, :] - hips) ** 2).sum(-1).min(-1)
        target = torch.from_numpy(np.exp(-square / (2 * SPREAD**2))).float()
        centers = hips + rng.uniform(-COARSE, COARSE, hips.shape) * 0.7
        volumes = torch.cat([as_volume(heat(frame, rig, fine_grid(center))) for center in centers[:_PEOPLE]])
        truth = torch.from_numpy(people - centers[:, None])[:_PEOPLE].float()
        with torch.autocast("cpu", torch.bfloat16):
            found = networks.hips(as_volume(heat(frame, rig, room, COARSE_WIDTH)))[0].float()
            off = (networks.joints(volumes) - truth).abs()
        losses = [nn.functional.mse_loss(found, target), off.mean()]
        optimiser.zero_grad()
        (100 * losses[0] + losses[1]).backward()
        optimiser.step()
        recent.append([each.item() for each in losses])
        if (step + 1) % _KEPT_EVERY == 0:
            hip, joint = np.mean(recent[-_KEPT_EVERY:], 0)
            print(f"step {step + 1}: hips {1e4 * hip:.1f}e-4, joints {1000 * joint:.0f} mm by axis", flush=True)
            torch.save((step + 1, [part.state_dict() for part in parts], rng.bit_generator.state), state)
    tensors = {name: each for name, each in networks.state_dict().items() if each.is_floating_point()}
    save_file({name: each.half().contiguous() for name, each in tensors.items()}, out)
    state.unlink(missing_ok=True)


def scene(poses: np.ndarray, shelf: CameraRig, rng: np.random.Generator) -> tuple[Frame, CameraRig, np.ndarray]:
    """Return detections of 1 to 5 people, the cameras, and the people (P, J, 3), m, whom two cameras or more see."""
    while True:
        rig = shelf if rng.random() < 0.5 else ring(rng)
        rig = rig[np.sort(rng.choice(len(rig), rng.integers(3, len(rig) + 1), replace=False))]
        middle = coarse_grid(rig).mean((0, 1, 2))[:2]
        reach = 0.45 * np.linalg.norm(rig.centers[:, :2] - middle, axis=-1).mean()
        places = np.empty((0, 2))
        for _ in range(rng.integers(1, 6)):
            place = middle + rng.uniform(-reach, reach, 2)
            if len(places) and rng.random() < 0.3:
                place = rng.choice(places) + rng.normal(0.5, 0.05, 2) * rng.choice([-1, 1], 2)
            if not len(places) or np.linalg.norm(places - place, axis=-1).min() > _CLOSEST:
                places = np.append(places, place[None], 0)
        people = poses[rng.integers(len(poses), size=len(places))].astype(float)
        angle = rng.uniform(-np.pi, np.pi, len(people))
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
        xy = people[..., :2] - people[:, HIPS, :2].mean(1, keepdims=True)
        people[..., :2] = xy @ turn.swapaxes(1, 2) + places[:, None]
        frame, found = _detected(people, rig, rng)
        if found.any():
            return frame, rig, people[found]


def _detected(people: np.ndarray, rig: CameraRig, rng: np.random.Generator) -> tuple[Frame, np.ndarray]:
    """Return what a detector finds of people (P, J, 3), m, and whom two cameras or more show (P,)."""
    xy = rig.project(people[None])[0][0]
    each = xy.shape[:2]
    xy = np.where((rng.random(each) < _SWAPPED)[:, :, None, None], xy[:, :, list(BODY25.mirror)], xy)
    xy = xy + rng.normal(0, rng.uniform(1, 6), xy.shape)
    xy = xy + rng.normal(0, 40, xy.shape) * (rng.random((*each, len(BODY25), 1)) < _ASTRAY)
    often = np.array([_MISSING.get(joint[2:], 0.05) for joint in BODY25.joints])
    lost = (rng.random(xy.shape[:-1]) < often) | (rng.random(each) < _UNSEEN)[..., None]
    seen = np.isfinite(xy).all(-1) & rig.inside(xy[None])[0] & ~lost
    # Something stands before the lower part of a person.
    hidden = np.nan_to_num(xy[..., 1], nan=np.inf) > rng.uniform(0, rig.size[0, 1], each)[..., None]
    seen &= ~(hidden & (rng.random(each) < _BEHIND)[..., None])
    seen &= (seen.sum(-1) >= _LEAST_JOINTS)[..., None]
    view, row = np.nonzero(seen.any(-1))
    xy, score = np.where(seen[..., None], xy, np.nan), np.where(seen, rng.uniform(0.4, 1, seen.shape), np.nan)
    return Frame(view, xy[view, row], score[view, row], np.empty((len(view), 0, 3))), seen.any(-1).sum(0) >= 2


def main(folder: str, steps: int) -> None:
    torch.manual_seed(0)
    shelf = read_calibration(Path(__file__).parents[2] / "configs/rig/shelf.yaml")
    train(poses_of(folder), steps, shelf.undistorted, np.random.default_rng(0), WEIGHTS)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
