"""Children take part in all motion and interactions, and physics follows."""

from dataclasses import replace

import numpy as np
import pytest

from synth.interactions import InteractionConfig, find_interaction, interaction_choices
from synth.motion.source import MotionConfig
from synth.people.body import SKELETON, body_at
from synth.physics.simulation import Simulation, simulate
from synth.scene import sampling as sample
from synth.scene.sampling import sample_scene
from synth.scene.spec import SceneConfig, SceneSpec
from tests.support.scenes import RIG
from tests.support.simulated_interactions import RECORDED, palms

SCENE = SceneConfig(seconds=3.0, persons=[4, 4], props=[0, 0], children=0.8)
"""Four people, or as near to four as the interaction takes."""


def played(kind: str, motion: MotionConfig, scene: SceneConfig = SCENE) -> tuple[SceneSpec, Simulation]:
    if kind != "none":
        count = int(np.clip(scene.persons[0], *find_interaction(kind).persons))
        scene = replace(scene, persons=[count, count])
    spec = sample_scene(scene, motion, interaction=InteractionConfig(kind), seed=4, clip=0).spec
    return spec, simulate(spec, RIG, painted=False)


def check(spec: SceneSpec, simulation: Simulation) -> None:
    assert min(person.body.age for person in spec.persons) < 11
    quality = simulation.quality
    assert quality["tracking_error_mm"] <= 30
    assert quality["penetration_mm"] <= 20
    assert quality["object_penetration_mm"] <= 25
    assert quality["shift_m"] <= 0.3
    assert quality["foot_slide"] <= 0.15


@pytest.mark.slow
@pytest.mark.parametrize("kind", interaction_choices())
def test_children_take_part_in_every_interaction(kind):
    check(*played(kind, MotionConfig()))


@pytest.mark.parametrize("source", RECORDED)
@pytest.mark.parametrize("kind", ["none", "crossing", "table"])
def test_children_follow_recorded_motion(kind, source, data_folder):
    motion = MotionConfig(kind=source, path=str(data_folder / "cmu" / RECORDED[source]))
    check(*played(kind, motion, replace(SCENE, seconds=2.0)))


@pytest.mark.parametrize("kind", ["handshake", "hug", "pass_box", "dance"])
@pytest.mark.parametrize("order", [1, -1])
def test_a_small_child_reaches_a_tall_man(kind, order, monkeypatch):
    bodies = iter((body_at(0, stature=1.6), body_at(1, 6))[::order])
    monkeypatch.setattr(sample, "sample_body", lambda *args, **kwargs: next(bodies))
    spec, simulation = played(kind, MotionConfig(), replace(SCENE, persons=[2, 2], children=0.0))
    check(spec, simulation)
    right, left = palms(spec, simulation, "r"), palms(spec, simulation, "l")
    if kind == "handshake":
        assert np.linalg.norm(right[:, 0] - right[:, 1], axis=-1).min() < 0.05
    elif kind == "hug":
        child = 1 if order == 1 else 0
        shoulder = simulation.joints[-1, child, SKELETON.index("body25.l_shoulder")[0], 2]
        assert max(left[-1, child, 2], right[-1, child, 2]) < shoulder + 0.1
        assert simulation.quality["contact_frames"] > 30
    elif kind == "dance":
        assert np.median(np.linalg.norm(left[:, 0] - right[:, 1], axis=-1)) < 0.11
    else:
        # The second person takes the box and keeps it.
        apart = np.linalg.norm(left - right, axis=-1)
        assert apart[-1, 1] == pytest.approx(2 * spec.loads[0].half_width, abs=0.08)


def test_short_legs_hang_from_a_stool():
    spec, simulation = played("table", MotionConfig())
    ankles = simulation.joints[-1, :, SKELETON.index("body25.l_ankle")[0], 2]
    hips = simulation.joints[-1, :, SKELETON.index("body25.mid_hip")[0], 2]
    for person, ankle, hip in zip(spec.persons, ankles, hips, strict=True):
        assert person.body.stature > 1.3 or ankle > 0.15
        assert person.body.stature < 1.5 or ankle < 0.10
        assert 0.47 < hip < 0.62
    assert ankles.max() > 0.15 > 0.10 > ankles.min()
