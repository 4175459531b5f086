"""Boxes that are passed, and people at a shelf."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from synth.interactions.registry import InteractionConfig
from synth.motion.config import MotionConfig
from synth.physics.simulation import simulate
from synth.scene.sampling import sample_scene
from tests.support.scenes import RIG
from tests.support.simulated_interactions import SCENE, facing, hips, palms, played, spec_of


def test_a_box_is_passed_from_one_person_to_another():
    spec, simulation = played("pass_box")
    (load,), model, data = spec.loads, simulation.model, mujoco.MjData(simulation.model)
    gaps, tilt = np.empty((len(simulation.qpos), 2)), np.empty(len(simulation.qpos))
    for frame, state in enumerate(simulation.qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        tilt[frame] = data.body("load0/box").xmat[8]
        for number in range(2):
            sites = [f"load0/grip{number}{side}" for side in "lr"]
            gaps[frame, number] = max(np.linalg.norm(data.site(s).xpos - data.site(f"{s}/palm").xpos) for s in sites)
    time = np.arange(len(gaps)) / spec.fps
    for number, grip in enumerate(load.grips):
        # Palms reach it within a moment, and let go.
        assert gaps[(time > grip.begin + 0.15) & (time < grip.end), number].max() < 0.02
        assert gaps[(time < grip.begin - 0.4) | (time > grip.end + 0.4), number].min() > 0.06
    assert np.degrees(np.arccos(tilt)).max() < 35
    assert "load0/box" in simulation.objects


def test_people_at_a_shelf_face_it_and_reach_for_it():
    spec = spec_of("shelving", scene=replace(SCENE, middle=[0.4, -0.3], seconds=12.0))
    simulation = simulate(spec, RIG, painted=False)
    (shelf,) = spec.furniture
    assert np.linalg.norm(np.subtract(shelf.at, (0.4, -0.3))) < 0.6
    inward = shelf.at - hips(simulation)
    distance = np.linalg.norm(inward, axis=-1)
    bearing = np.degrees(np.arccos((facing(spec, simulation) * inward).sum(-1) / distance))
    assert 0.75 < (bearing < 60).mean() < 0.97
    assert 0.4 < distance[:, :2].min() < distance[:, :2].max() < 1.8
    assert (distance[-1, 2:] < distance[0, 2:] - 0.2).all()
    raised = np.maximum(*(palms(spec, simulation, side)[..., 2] for side in "lr")) > 1.0
    assert raised[:, :2].any(0).all()
    assert (distance[raised] < 1.2).all()
    assert simulation.quality["penetration_mm"] <= 20
    assert simulation.quality["foot_slide"] <= 0.05


@pytest.mark.parametrize("people", [2, 4])
def test_a_box_is_passed_at_the_shelf(people):
    scene = replace(SCENE, persons=[people, people], seconds=8.0)
    specs = [
        sample_scene(scene, MotionConfig(), interaction=InteractionConfig("shelving"), seed=1, clip=clip).spec
        for clip in range(12)
    ]
    assert 2 <= sum(bool(spec.loads) for spec in specs) <= 10
    spec = next(spec for spec in specs if spec.loads)
    (load,), simulation = spec.loads, simulate(spec, RIG, painted=False)
    assert [grip.person for grip in load.grips] == [people - 1, 0]
    frame = round(load.grips[1].begin * spec.fps)
    giver, taker = facing(spec, simulation)[frame, [people - 1, 0]]
    assert giver @ taker < -0.8
    for number, grip in enumerate(load.grips):
        held = slice(round((max(grip.begin, 0) + 0.3) * spec.fps), round(min(grip.end, 7.9) * spec.fps))
        gaps = palms(spec, simulation, "l")[held, grip.person] - palms(spec, simulation, "r")[held, grip.person]
        assert np.abs(np.linalg.norm(gaps, axis=-1) - 2 * load.half_width).max() < 0.05, number
