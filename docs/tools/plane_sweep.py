"""Train the networks of the plane sweep (`dmae.reconstruction.systems.plane_sweep`) and write the package's weights.

    synth generate motion=recorded motion.path=$DMAE_DATA/cmu clips=60 seed=61 scene.fps=10 scene.seconds=6 \
      scene.persons=[2,3] rig=ring rig.ring.views=2 out=people
    python docs/tools/plane_sweep.py people 3000

Only the poses of the clips are used: cameras and places are drawn for every scene.
"""

import sys

import numpy as np
import torch

import dmae
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25
from dmae.reconstruction.systems.plane_sweep import WEIGHTS, train


def main(folder: str, steps: int) -> None:
    poses = np.concatenate([convert(clip.truth, BODY25).xyz.reshape(-1, 25, 3) for clip in dmae.load_dataset(folder)])
    poses = poses[np.isfinite(poses).all((1, 2))]
    print(f"{len(poses)} poses")
    torch.manual_seed(0)
    train(poses, steps, np.random.default_rng(0), WEIGHTS)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
