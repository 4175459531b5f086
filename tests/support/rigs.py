"""The rigs of `configs/rig/`, and cameras and points for tests of rigs."""

from pathlib import Path

import numpy as np
from omegaconf import OmegaConf

from dmae.data.cameras import CameraRig
from synth.rigs.config import RigConfig
from synth.rigs.rig import make_rig

CONFIGS = Path(__file__).parents[2] / "configs" / "rig"
PRESETS = sorted(path.stem for path in CONFIGS.glob("*.yaml"))
AHEAD = [1.0, 0, 0, 0, 0, 0, -1, 1, 0, 1, 0, 4]
LEFT = {"name": "left", "size": [64, 48], "K": [50.0, 0, 32, 0, 50, 24, 0, 0, 1], "cam_from_world": AHEAD}


def preset(name: str, seed: int = 0) -> CameraRig:
    return make_rig(config(name), rng=np.random.default_rng(seed))


def config(name: str) -> RigConfig:
    return OmegaConf.to_object(
        OmegaConf.merge(OmegaConf.structured(RigConfig), OmegaConf.load(CONFIGS / f"{name}.yaml"))
    )


def points_in_area(radius: float, count: int = 4000) -> np.ndarray:
    """(1, N, 3) points anywhere in the people's area, including its rims."""
    rng = np.random.default_rng(1)
    angle, reach = rng.uniform(0, 2 * np.pi, count), radius * np.sqrt(rng.uniform(size=count))
    reach[::4] = radius
    height = rng.uniform(0, 2, count)
    height[1::4], height[2::4] = 0, 2
    return np.stack([reach * np.cos(angle), reach * np.sin(angle), height], -1)[None]


def distorted(rig: CameraRig) -> CameraRig:
    dist = np.tile([-0.3, 0.1, 0.002, -0.001, 0.01], (len(rig), 1))
    return CameraRig(rig.names, rig.K, dist, rig.cam_from_world, rig.size)


def wide(focal: float = 300.0) -> CameraRig:
    """A fisheye that looks along x, 4 m before the middle; its image's corners are beyond a right angle."""
    K = [[focal, 0, 449.5], [0, focal, 449.5], [0, 0, 1]]
    pose = [[0, -1, 0, 0], [0, 0, -1, 1], [1, 0, 0, 1.2], [0, 0, 0, 1.0]]
    return CameraRig(("wide",), [K], [[0.02, -0.005, 0.001, 0, 0]], [pose], [[900, 900]], [True])
