"""People at what they do together, and where their hips, palms and faces are."""

from functools import cache

import mujoco
import numpy as np

from synth.interactions import InteractionConfig, InteractionKind
from synth.landmarks import SKELETON
from synth.motion.limbs import PALM
from synth.motion.source import MotionConfig
from synth.sample import sample_spec
from synth.simulate import Simulation, simulate
from synth.spec import SceneConfig, SceneSpec
from tests.synth.people import RIG

SCENE = SceneConfig(seconds=3.0, persons=[4, 4], props=[0, 0])
MID_HIP = SKELETON.index("body25.mid_hip")[0]


def spec_of(kind: InteractionKind, motion: MotionConfig | None = None, scene: SceneConfig = SCENE) -> SceneSpec:
    return sample_spec(scene, motion or MotionConfig(), interaction=InteractionConfig(kind), seed=3, clip=0)


@cache
def played(kind: InteractionKind) -> tuple[SceneSpec, Simulation]:
    spec = spec_of(kind)
    return spec, simulate(spec, RIG, painted=False)


def hips(simulation: Simulation) -> np.ndarray:
    """(F, P, 2)"""
    return simulation.joints[:, :, MID_HIP, :2]


def apart(points: np.ndarray) -> np.ndarray:
    """(F, P, P) distances between people's points (F, P, D), large from anybody to themselves."""
    return np.linalg.norm(points[:, :, None] - points[:, None], axis=-1) + 99 * np.eye(points.shape[1])


def palms(spec: SceneSpec, simulation: Simulation, side: str) -> np.ndarray:
    """(F, P, 3) skin of people's palms in the simulated state."""
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
    """(F, P, 2) where people's trunks face: from the shoulders, left over right."""
    left, right = (simulation.joints[:, :, SKELETON.index(f"body25.{s}_shoulder")[0], :2] for s in "lr")
    across = left - right
    ahead = np.stack([across[..., 1], -across[..., 0]], -1)
    return ahead / np.linalg.norm(ahead, axis=-1, keepdims=True)
