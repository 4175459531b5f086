"""Procedural sequences of actions: feet hold, joints stay within limits, motion is smooth and in balance."""

import numpy as np
import pytest

from dmae.data.rng import generator
from synth.interactions.script import seated
from synth.motion.config import ACTIONS, MotionConfig
from synth.motion.procedural.sequence import SEATED, TurnTo, make_sequence, walk_to
from synth.motion.procedural.trajectory import HIP_HEIGHT, STATURE, Stance
from synth.motion.source import load_motion
from synth.people.body import SEGMENTS, Body, segment_origins
from synth.physics.simulation import simulate
from synth.scene.config import SceneConfig
from synth.scene.sampling import load_motions, sample_scene
from tests.support.scenes import RIG
from tests.support.stick_figure import elbows, joints, knees, soles

FPS = 100


def doing(*actions: str, seed: int = 0, seconds: float = 6, fps: float = FPS, **weights: float):
    return make_sequence(actions, weights, speed=(0.8, 1.5), seconds=seconds, fps=fps, rng=np.random.default_rng(seed))


def flexion(motion, upper: str, lower: str) -> np.ndarray:
    """(F,) angle between the long axes of two segments that hang from each other, rad."""
    one, other = (motion.rotations[:, SEGMENTS.index(name), :, 2] for name in (upper, lower))
    return np.arccos(np.clip((one * other).sum(1), -1, 1))


@pytest.mark.parametrize("action", ACTIONS)
def test_soles_neither_slide_nor_sink(action):
    motion = doing(action, "walk", seed=3, seconds=10)
    points = soles(motion)
    assert points[..., 2].min() > -0.004
    low = points[..., 2] < 0.002
    bearing = low[:-1] & low[1:]
    assert low.any(axis=(1, 2)).mean() > 0.99, "a frame without a foot on the floor"
    speed = np.linalg.norm(np.diff(points[..., :2], axis=0), axis=-1) * FPS
    # A foot may brush the floor as it leaves or meets it.
    assert np.percentile(speed[bearing], 97) < 0.1
    slowest = np.where(bearing, speed, np.inf).min(axis=(1, 2))
    assert (slowest[np.isfinite(slowest)] < 0.25).all()


@pytest.mark.parametrize("action", ACTIONS)
def test_joints_stay_within_human_limits(action):
    """Ranges of motion after the American Academy of Orthopaedic Surgeons (1965), a few degrees beyond for style."""
    for seed in range(3):
        motion = doing(action, seed=seed)
        assert np.degrees(knees(motion).min()) > 3.9
        assert np.degrees(knees(motion).max()) < 145
        assert np.degrees(elbows(motion).min()) > 0
        assert np.degrees(elbows(motion).max()) < 150
        for side in "lr":
            assert np.degrees(flexion(motion, "pelvis", f"{side}_thigh").max()) < 125
            ankle = flexion(motion, f"{side}_shin", f"{side}_foot")
            assert np.degrees(ankle.max()) < 50
        assert np.degrees(flexion(motion, "pelvis", "chest").max()) < 60
        assert np.degrees(flexion(motion, "chest", "head").max()) < 65


@pytest.mark.parametrize("action", ACTIONS)
def test_motion_is_smooth(action):
    """Transitions between actions count too; there are several in ten seconds."""
    motion = doing(action, "walk", "stand", seed=5, seconds=10)
    speed = np.diff(joints(motion), axis=0) * FPS
    acceleration = np.linalg.norm(np.diff(speed, axis=0), axis=-1) * FPS
    root = acceleration[:, 0]
    assert root.max() < 16, "of the hips, m/s^2"
    assert acceleration[:, 3].max() < 30, "of the head"
    assert acceleration.max() < 200, "of hands and feet"
    assert np.linalg.norm(speed, axis=-1).max() < 10
    turns = np.swapaxes(motion.rotations[:-1], -1, -2) @ motion.rotations[1:]
    angles = np.arccos(np.clip((np.trace(turns, axis1=-2, axis2=-1) - 1) / 2, -1, 1))
    assert np.degrees(angles.max()) * FPS < 1800


@pytest.mark.parametrize("action", ["stand", "reach", "wave", "bend", "crouch", "lift"])
def test_the_centre_of_mass_is_over_the_feet(action):
    motion = doing(action, seed=2)
    body = Body(stature=STATURE)
    # Masses half way between joints are accurate to centimetres.
    origins = segment_origins(body, motion.root, motion.rotations)
    middles = origins.copy()
    for child, parent in (
        (1, 0),
        (2, 1),
        (3, 2),
        (5, 4),
        (6, 5),
        (8, 7),
        (9, 8),
        (11, 10),
        (12, 11),
        (14, 13),
        (15, 14),
    ):
        middles[:, parent] = (origins[:, parent] + origins[:, child]) / 2
    centre = np.einsum("fsi,s->fi", middles, body.masses / body.mass)[:, :2]
    points = soles(motion)[..., :2].mean(2).mean(1)
    assert np.linalg.norm(centre - points, axis=1).max() < 0.08


def test_each_action_does_what_its_name_says():
    def spread(motion):
        return np.ptp(motion.root, axis=0)

    assert spread(doing("walk", seconds=8))[:2].max() > 0.8
    facing = doing("turn", seconds=8).rotations[:, 0, :2, 0]
    assert np.ptp(np.unwrap(np.arctan2(facing[:, 1], facing[:, 0]))) > 0.6
    assert doing("crouch", seconds=8).root[:, 2].min() < 0.6 * HIP_HEIGHT
    assert doing("sit", seconds=8).root[:, 2].min() == pytest.approx(SEATED * HIP_HEIGHT, abs=0.01)
    hands = {name: joints(doing(name, seconds=9))[:, [6, 9], 2] for name in ("stand", "wave", "bend", "lift", "punch")}
    assert hands["wave"].max() > 1.3 > 1.1 > hands["stand"].max()
    assert hands["bend"].min() < 0.65
    assert hands["lift"].min() < 0.55 < 1.3 < hands["lift"].max()
    assert hands["punch"].max() > 1.2
    feet = joints(doing("kick", seconds=9))[:, [12, 15], 2]
    assert 0.4 < feet.max() < 1.4
    assert np.ptp(joints(doing("dance", seconds=9))[:, 0, :2], axis=0).max() > 0.05


def test_sequences_are_determined_by_the_seed():
    assert np.array_equal(doing(*ACTIONS, seed=5).rotations, doing(*ACTIONS, seed=5).rotations)
    assert len({doing(*ACTIONS, seed=seed).name for seed in range(10)}) == 10
    assert len(doing("kick", seconds=0.02, fps=50)) == 1


def test_weights_set_the_frequency_of_actions():
    names = [doing("walk", "kick", "wave", seed=seed, kick=0.0, walk=0.1).name for seed in range(20)]
    assert not any("kick" in name for name in names)
    assert sum("wave" in name for name in names) > sum("walk" in name for name in names)


def test_people_sit_on_seats_and_walk_around_them():
    found = 0
    for seed in range(16):
        motion = doing("sit", "walk", "kick", seed=seed, seconds=12, fps=25)
        for frame in motion.seats:
            found += 1
            assert motion.root[frame, 2] < (SEATED + 0.02) * HIP_HEIGHT
            upright = motion.root[:, 2] > 0.9 * HIP_HEIGHT
            gap = np.linalg.norm(motion.root[upright, :2] - motion.root[frame, :2], axis=1)
            assert gap.min() > 0.2
        low = motion.root[:, 2] < 0.7 * HIP_HEIGHT
        assert len(motion.seats) or not low.any(), "a person sits without a seat"
    assert found > 4


def test_people_too_small_for_a_stool_stand():
    motion = make_sequence(["sit"], {}, speed=(1, 1), seconds=6, fps=25, rng=np.random.default_rng(0), seated=0.95)
    assert not motion.seats
    assert motion.root[:, 2].min() > (SEATED + 0.15) * HIP_HEIGHT, "knees bend a little in standing"


def test_scenes_have_stools_where_people_sit():
    config = SceneConfig(persons=[2, 2], seconds=5.0, props=[0, 0])
    motion = MotionConfig(actions=["sit"])
    spec = sample_scene(config, motion, seed=1, clip=0).spec
    assert {thing.kind for thing in spec.furniture} == {"stool"}
    motions = load_motions(spec)
    assert len(spec.furniture) >= sum(bool(m.seats) for m in motions) > 0
    for m, person in zip(motions, spec.persons, strict=True):
        for frame in m.seats:
            assert min(np.linalg.norm(m.root[frame, :2] - thing.at) for thing in spec.furniture) < 0.35
            # All stools have the same height.
            assert m.root[frame, 2] == pytest.approx(seated(person.body), abs=0.01)


@pytest.mark.parametrize("action", ["sit", "kick", "punch", "dance", "lift"])
def test_physics_follows_the_action(action):
    config = SceneConfig(persons=[1, 1], seconds=3.0, props=[0, 0])
    spec = sample_scene(config, MotionConfig(actions=[action]), seed=2, clip=0).spec
    quality = simulate(spec, RIG, painted=False).quality
    assert quality["tracking_error_mm"] < 25
    assert quality["foot_slide"] < 0.08


def test_a_walk_begins_and_ends_in_its_stances():
    start = Stance.at(1.0, -2.0, 0.7, 0.2, 0.1)
    walk = walk_to(start, speed=1.2, width=0.09, first=1, distance=2.5, curvature=0.4, apart=0.22)
    ends = walk.lower_body(np.array([0.0, walk.seconds]))
    for number, stance in enumerate((start, walk.stop)):
        assert ends.root[number] == pytest.approx(stance.root, abs=1e-6)
        assert ends.ankles[number, :, :2] == pytest.approx(stance.feet[:, :2], abs=1e-6)
        assert np.arctan2(ends.feet[number, :, 1, 0], ends.feet[number, :, 0, 0]) == pytest.approx(stance.feet[:, 2])
    assert np.linalg.norm(walk.stop.middle[:2] - start.middle[:2]) == pytest.approx(2.4, abs=0.4)
    times = np.arange(0, walk.seconds, 0.01)
    speed = np.linalg.norm(np.diff(walk.lower_body(times).root[:, :2], axis=0), axis=1) * 100
    assert speed.max() == pytest.approx(1.2, rel=0.25)
    assert max(speed[0], speed[-1]) < 0.05


def test_a_turn_ends_where_it_says():
    turn = TurnTo(Stance.at(0, 0, 0.3, 0.2, 0.1), -2.0, pace=1.0)
    ends = turn.lower_body(np.array([0.0, turn.seconds]))
    assert ends.heading == pytest.approx([0.3, -1.7])
    assert ends.ankles[1, :, :2] == pytest.approx(turn.stop.feet[:, :2], abs=1e-6)


@pytest.mark.parametrize(
    ("config", "message"),
    [
        ({"actions": ["kick", "jump"]}, "motion.actions: expected some of walk, turn, .*; found 'jump'"),
        ({"weights": {"fly": 1.0}}, "motion.weights: expected some of walk, .*; found 'fly'"),
        ({"weights": {"kick": -1.0}}, "motion.weights.kick: expected 0 or more, found -1.0"),
        ({"actions": ["kick"], "weights": {"kick": 0.0}}, "expected one above 0"),
    ],
)
def test_unknown_actions_are_refused_with_the_known_ones(config, message):
    with pytest.raises(ValueError, match=message):
        MotionConfig(**config)


def test_without_actions_people_walk_or_stand_throughout():
    names = {
        load_motion(MotionConfig(actions=[]), seconds=2, fps=25, rng=generator(0, clip, 0)).name.split()[0].strip(",")
        for clip in range(12)
    }
    assert names == {"walk", "stand"}
