"""Leg clearance: people who leap and kick keep clear of others, and their feet stay in place."""

from dataclasses import replace

import numpy as np
import pytest

from synth.motion.config import MotionConfig
from synth.motion.feet import sole_points
from synth.motion.geometry import about
from synth.people.body import SEGMENTS, Body
from synth.physics.planning import leg_clearance, limb_points, plan_motions
from synth.physics.simulation import simulate
from synth.scene.config import SceneConfig
from synth.scene.sampling import sample_scene
from tests.support.scenes import BODY, RIG, gliding, scene

FPS = 25.0
OTHER = Body(1.65, 60, 1.0)
NOTHING = np.empty((0, 3))


def kicking(body: Body, start, frames: int = 60):
    """A person who faces along x and raises the stretched left leg forward, half way through."""
    motion = gliding(body, frames, start, (0, 0))
    rise = about("y", -1.5 * np.exp(-(((np.arange(frames) - frames / 2) / 8) ** 2)))
    for part in ("thigh", "shin", "foot"):
        segment = SEGMENTS.index(f"l_{part}")
        motion.rotations[:, segment] = rise @ motion.rotations[:, segment]
    return motion


def limbs_of(*people) -> np.ndarray:
    return np.stack([limb_points(body, motion.root, motion.rotations) for body, motion in people], axis=1)


def apart(limbs: np.ndarray) -> np.ndarray:
    """(F,) distance of the first person's legs from the second's legs and trunk, m."""
    return np.linalg.norm(limbs[:, 0, :12, None] - limbs[:, 1, None], axis=-1).min((1, 2))


def test_limb_points_are_on_legs_and_trunk():
    motion = gliding(BODY, 3, (1, 2), (0, 0))
    points = limb_points(BODY, motion.root, motion.rotations)
    assert points.shape == (3, 15, 3)
    np.testing.assert_allclose(points[:, 8:12].reshape(3, 2, 2, 3), sole_points(BODY, motion.root, motion.rotations))
    np.testing.assert_allclose(points[:, 12], motion.root)
    assert (points[:, 14, 2] > points[:, 13, 2]).all()


def test_sidesteps_make_space_for_a_kick():
    people = [(BODY, kicking(BODY, (0, 0.0))), (OTHER, gliding(OTHER, 60, (0.7, 0.1), (0, 0)))]
    limbs = limbs_of(*people)
    assert apart(limbs)[0] > 0.3 > 0.1 > apart(limbs).min()
    for _ in range(6):
        shift = leg_clearance(limbs, FPS, NOTHING)
        np.testing.assert_allclose(shift[:, 0], -shift[:, 1], atol=1e-12)
        assert np.linalg.norm(np.diff(shift, axis=0), axis=-1).max() * FPS < 1.0
        limbs[..., :2] += shift[:, :, None]
    assert apart(limbs).min() > 0.17


def test_a_kick_keeps_clear_of_obstacles():
    limbs = limbs_of((BODY, kicking(BODY, (0, 0))))
    drum = np.array([[0.8, 0.0, 0.3]])
    shift = leg_clearance(limbs, FPS, drum)
    feet = (limbs[..., :2] + shift[:, :, None])[:, 0, 8:12]
    assert np.linalg.norm(feet - drum[0, :2], axis=-1).min() > 0.34
    assert np.linalg.norm(limbs[:, 0, 8:12, :2] - drum[0, :2], axis=-1).min() < 0.3


def test_clear_legs_need_no_sidestep():
    people = [(BODY, kicking(BODY, (0, 0))), (OTHER, gliding(OTHER, 60, (-0.6, 0), (0, 0)))]
    assert not leg_clearance(limbs_of(*people), FPS, np.array([[0.0, 2.0, 0.3]])).any()


@pytest.mark.parametrize("kind", ["procedural", "bvh"])
def test_only_recorded_people_sidestep_for_legs(kind):
    """Procedural people keep the paths that are planned for their hips."""
    spec = replace(scene([BODY, OTHER], 60), motion=MotionConfig(kind=kind, path="takes"))
    motions = [kicking(BODY, (0, 0.0)), gliding(OTHER, 60, (0.7, 0.1), (0, 0))]
    plan = plan_motions(spec, motions, NOTHING)
    moved = np.abs(plan.root[..., :2] - np.stack([motion.root[:, :2] for motion in motions], axis=1)).max()
    assert moved == 0 if kind == "procedural" else 0.05 < moved < 0.4


@pytest.mark.parametrize(
    ("folder", "clips"), [("bvh_cc", [3, 8, 17, 21]), ("bvh_daz", [6, 14, 16]), ("bvh_mb", [4, 6])]
)
def test_feet_of_recorded_people_do_not_slide(folder, clips, data_folder):
    """Clips of dancers, fighters and walkers with feet that used to slide in 1.5 to 5 % of the frames."""
    config = SceneConfig(arena="office", props=[0, 2])
    motion = MotionConfig(kind="bvh", path=str(data_folder / "cmu" / folder))
    scenes = [sample_scene(config, motion, seed=12, clip=clip) for clip in clips]
    quality = [simulate(spec, RIG, motions, painted=False).quality for spec, motions in scenes]
    assert np.mean([each["foot_slide"] for each in quality]) <= 0.006
    assert max(each["tracking_error_mm"] for each in quality) < 10
    assert max(each["penetration_mm"] for each in quality) < 40
