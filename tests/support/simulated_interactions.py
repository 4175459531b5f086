"""Simulated interactions, and the hips, palms and headings of their people."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np

from synth.interactions.registry import InteractionConfig, find_interaction
from synth.motion.config import MotionConfig
from synth.motion.geometry import PALM
from synth.people.body import SKELETON
from synth.physics.simulation import Simulation, simulate
from synth.scene.config import SceneConfig
from synth.scene.sampling import SampledScene, sample_scene
from synth.scene.spec import SceneSpec
from tests.support.scenes import RIG

SCENE = SceneConfig(seconds=3.0, persons=[4, 4], props=[0, 0])
"""Four people, or as near to four as the interaction takes."""
RECORDED = {"bvh": "bvh_cc/005_01.bvh", "amc": "asf_amc/02_01.amc", "c3d": "c3d/02_01.c3d"}
"""A take of the CMU database in each kind of file, below `DMAE_DATA/cmu`."""
MID_HIP = SKELETON.index("body25.mid_hip")[0]


def spec_of(kind: str, motion: MotionConfig | None = None, scene: SceneConfig = SCENE) -> SceneSpec:
    return sampled(kind, motion, scene).spec


def sampled(kind: str, motion: MotionConfig | None = None, scene: SceneConfig = SCENE) -> SampledScene:
    count = int(np.clip(scene.persons[0], *find_interaction(kind).persons))
    scene = replace(scene, persons=[count, count])
    return sample_scene(scene, motion or MotionConfig(), interaction=InteractionConfig(kind), seed=3, clip=0)


@cache
def played(kind: str) -> tuple[SceneSpec, Simulation]:
    spec, motions = sampled(kind)
    return spec, simulate(spec, RIG, motions, painted=False)


def hips(simulation: Simulation) -> np.ndarray:
    """(F, P, 2)"""
    return simulation.joints[:, :, MID_HIP, :2]


def apart(points: np.ndarray) -> np.ndarray:
    """(F, P, P) distances between people's points (F, P, D), large on the diagonal."""
    return np.linalg.norm(points[:, :, None] - points[:, None], axis=-1) + 99 * np.eye(points.shape[1])


def palms(spec: SceneSpec, simulation: Simulation, side: str) -> np.ndarray:
    """(F, P, 3) skin of people's palms in the simulated states, m."""
    data, found = mujoco.MjData(simulation.model), []
    for state in simulation.qpos:
        data.qpos[:] = state
        mujoco.mj_kinematics(simulation.model, data)
        places = []
        for p, person in enumerate(spec.persons):
            hand = simulation.model.body(f"person{p}/{side}_hand").id
            local = PALM * (1, (1 if side == "l" else -1) * person.body.arms, 1) * person.body.stature
            places.append(data.xpos[hand] + data.xmat[hand].reshape(3, 3) @ local)
        found.append(places)
    return np.array(found)


def facing(spec: SceneSpec, simulation: Simulation) -> np.ndarray:
    """(F, P, 2) headings of people's trunks, perpendicular to the line of the shoulders."""
    left, right = (simulation.joints[:, :, SKELETON.index(f"body25.{s}_shoulder")[0], :2] for s in "lr")
    across = left - right
    ahead = np.stack([across[..., 1], -across[..., 0]], -1)
    return ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
