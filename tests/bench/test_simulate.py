"""What making labels costs beside the engine calls it contains."""

import time

import mujoco
import numpy as np
import pytest

from dmae.rng import Stream, generator
from synth.motion.source import MotionConfig
from synth.rigs import RigConfig, make_rig
from synth.simulate import simulate_motions
from synth.spec import SceneConfig, load_motions, sample_spec
from synth.visibility import joint_visibility

pytestmark = pytest.mark.bench


def test_labels_of_four_people_in_five_views():
    scene = SceneConfig(persons=[4, 4], seconds=5.0, fps=25.0)
    rig = make_rig(RigConfig(), rng=generator(0, 0, Stream.CAMERAS))
    start = time.perf_counter()
    spec = sample_spec(scene, MotionConfig(), seed=0, clip=0)
    motions = load_motions(spec)
    planning = time.perf_counter() - start

    start = time.perf_counter()
    made = simulate_motions(spec, motions, rig)
    simulating = time.perf_counter() - start

    # The same number of steps from the same states, and nothing else.
    model, data = made.model, mujoco.MjData(made.model)
    steps = round(1 / (scene.fps * model.opt.timestep))
    start = time.perf_counter()
    for state in made.qpos[:-1]:
        data.qpos[:], data.qvel[:] = state, 0
        for _ in range(steps):
            mujoco.mj_step(model, data)
    bare = time.perf_counter() - start

    start = time.perf_counter()
    visibility, _ = joint_visibility(model, made.qpos, made.joints, made.depth, made.geom_ids, rig)
    seeing = time.perf_counter() - start
    frames = len(made.qpos)
    print(f"\n4 people, 5 views, {frames} frames: planning {planning:.2f} s, simulating {simulating:.2f} s")
    print(f"  ({simulating / bare:.2f} x its bare mj_step calls), visibility {seeing:.2f} s")
    print(f"  {frames / (planning + simulating + seeing):.0f} frames/s; visible {np.mean(visibility == 0):.0%}")
