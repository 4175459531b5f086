"""Foot contacts, locked feet, legs that follow them, and the weight on each foot."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dmae.data.rng import Stream, generator
from synth.motion.config import MotionConfig, ProceduralConfig
from synth.motion.feet import FEET, SOLE, fit_to_body, foot_contacts, lock_feet, sole_points, weight_on_feet
from synth.motion.motion import redirect
from synth.motion.procedural.trajectory import HEEL, STATURE, TIP
from synth.motion.source import cut, load_motion, read_take, takes
from synth.people.body import SEGMENTS, Body, segment_origins
from tests.support.scenes import BODY, gliding

FPS = 25.0
LEGS = [i for i, name in enumerate(SEGMENTS) if name.endswith(("thigh", "shin", "foot"))]


def walk(seed: int = 1, body: Body = BODY, **config):
    ways = {"standing": 0, "straight": 1, "gesture": 0} | config
    config = MotionConfig(procedural=ProceduralConfig(**ways))
    return fit_to_body(load_motion(config, seconds=3.0, fps=FPS, rng=generator(seed, 0, Stream.MOTION)), body)


def speeds(points: np.ndarray) -> np.ndarray:
    """(F - 1, ...) horizontal speed of points (F, ..., 3), m/s."""
    return np.linalg.norm(np.diff(points[..., :2], axis=0), axis=-1) * FPS


def skates(body: Body, root: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """(F - 1,) True where the body is on the floor and nothing on the floor stays in place."""
    points = sole_points(body, root, rotations)
    low = (points[1:, ..., 2] < 0.015) & (points[:-1, ..., 2] < 0.015)
    return low.any((1, 2)) & (np.where(low, speeds(points), np.inf).min((1, 2)) > 0.25)


def sideways(rotations: np.ndarray) -> np.ndarray:
    """(F, 2) degrees by which the left and the right shin leave the plane in which the knee bends."""
    thighs, shins = (rotations[:, [SEGMENTS.index(f"{side}_{part}") for side in "lr"]] for part in ("thigh", "shin"))
    return np.degrees(np.arcsin(np.clip((thighs[..., 1] * shins[..., 2]).sum(-1), -1, 1)))


def bends(rotations: np.ndarray) -> np.ndarray:
    """(F, 2) degrees by which the knees bend, below zero to the front."""
    thighs, shins = (rotations[:, [SEGMENTS.index(f"{side}_{part}") for side in "lr"]] for part in ("thigh", "shin"))
    return np.degrees(np.arctan2((thighs[..., 0] * shins[..., 2]).sum(-1), (thighs[..., 2] * shins[..., 2]).sum(-1)))


def test_soles_are_where_a_flat_foot_meets_the_floor():
    motion = gliding(BODY, 3, (1, 2), (0, 0))
    points = sole_points(BODY, motion.root, motion.rotations)
    assert points.shape == (3, 2, 2, 3)
    np.testing.assert_allclose(points[..., 2], 0, atol=1e-9)
    assert points[0, 0, 0, 1] > 2 > points[0, 1, 0, 1]
    np.testing.assert_allclose(points[0, :, 1, 0] - points[0, :, 0, 0], 0.144 * BODY.stature)


@pytest.mark.parametrize("turn", [0.0, 0.5, 2.2])
def test_contacts_of_a_bent_walk_are_those_of_the_straight_one(turn):
    motion = walk(seed=4)  # walks to the end
    straight = foot_contacts(BODY, motion.root, motion.rotations, FPS, turn=0.0)
    bent = redirect(motion, (0.0, 0.0), 0.0, turn)
    found = foot_contacts(BODY, bent.root, bent.rotations, FPS, turn=turn)
    assert 0.5 < straight.mean() < 0.8
    assert (found == straight).mean() > 0.95


def test_locked_feet_stay_in_place_when_a_walk_is_bent_and_shifted():
    turn = 0.5
    motion = redirect(walk(), (0.0, 0.0), 0.0, turn)
    standing = foot_contacts(BODY, motion.root, motion.rotations, FPS, turn=turn)
    pushed = motion.root.copy()
    pushed[:, 1] += 0.3 * np.sin(np.linspace(0, np.pi, len(pushed)))
    root, firm = lock_feet(BODY, pushed, motion.rotations, standing, FPS)
    both = standing[1:] & standing[:-1]

    def slide(root, rotations):
        return speeds(sole_points(BODY, root, rotations)).min(2)[both].max()

    assert slide(root, firm) < 0.05 < slide(pushed, motion.rotations)
    np.testing.assert_allclose(firm @ firm.swapaxes(-1, -2), np.tile(np.eye(3), (*firm.shape[:2], 1, 1)), atol=1e-9)
    upper = [i for i in range(len(SEGMENTS)) if i not in LEGS]
    np.testing.assert_array_equal(firm[:, upper], motion.rotations[:, upper])
    np.testing.assert_array_equal(root[:, :2], pushed[:, :2])


@given(
    hips=st.lists(st.floats(-60, 60), min_size=6, max_size=6),
    knees=st.lists(st.floats(-8, 120), min_size=2, max_size=2),
    aside=st.lists(st.floats(-0.4, 0.4), min_size=2, max_size=2),
    turn=st.floats(-1.5, 1.5),
)
@settings(max_examples=40)
def test_knees_are_hinges_however_far_the_hips_go(hips, knees, aside, turn):
    """Any pose of the legs; feet stand while the hips go aside and turn, and the legs reach them as far as they can."""
    motion = gliding(BODY, 20, (0, 0), (0, 0))
    rotations = motion.rotations.copy()
    for side, angles, knee in (("l", hips[:3], knees[0]), ("r", hips[3:], knees[1])):
        thigh, shin, foot = (SEGMENTS.index(f"{side}_{part}") for part in ("thigh", "shin", "foot"))
        rotations[:, thigh] = Rotation.from_euler("zxy", angles, degrees=True).as_matrix()
        rotations[:, shin] = rotations[:, thigh] @ Rotation.from_euler("y", knee, degrees=True).as_matrix()
        rotations[:, foot] = rotations[:, shin]
    share = np.linspace(0, 1, 20)
    root = motion.root + np.pad(share[:, None] * aside, ((0, 0), (0, 1)))
    rotations = Rotation.from_euler("z", share[:, None] * turn).as_matrix()[:, None] @ rotations
    _, firm = lock_feet(BODY, root, rotations, np.ones((20, 2), bool), FPS)
    np.testing.assert_allclose(sideways(firm), 0, atol=1e-4)
    assert bends(firm).min() > 0


@pytest.mark.parametrize(
    ("kind", "folder"), [("amc", "asf_amc"), ("bvh", "bvh_cc"), ("bvh", "bvh_daz"), ("c3d", "c3d")]
)
def test_knees_of_recorded_people_are_hinges(kind, folder, data_folder):
    """As read, and when they sidestep by 30 cm on feet that stay in place."""
    # Markers show the axis of a nearly straight knee to some 10 degrees.
    limit = 12 if kind == "c3d" else 3
    for path in takes(MotionConfig(kind=kind, path=str(data_folder / "cmu" / folder))):
        motion = fit_to_body(cut(read_take(path), start=0.4, seconds=4.0, fps=FPS), BODY)
        assert np.abs(sideways(motion.rotations)).max() < limit
        standing = foot_contacts(BODY, motion.root, motion.rotations, FPS, turn=0.0, recorded=True)
        root = motion.root.copy()
        root[:, 1] += 0.3 * np.sin(np.linspace(0, np.pi, len(root)))
        root, firm = lock_feet(BODY, root, motion.rotations, standing, FPS, recorded=True)
        np.testing.assert_allclose(sideways(firm), 0, atol=1e-4)
        assert bends(firm).min() > 0


def test_a_foot_that_is_held_turns_the_leg_and_not_the_ankle():
    """A person who turns by 40 degrees on feet that stay in place."""
    motion = gliding(BODY, 20, (0, 0), (0, 0))
    bent = motion.rotations.copy()
    for side in "lr":
        thigh, shin = (SEGMENTS.index(f"{side}_{part}") for part in ("thigh", "shin"))
        bent[:, thigh], bent[:, shin] = (
            Rotation.from_euler("y", angle, degrees=True).as_matrix() for angle in (-20, 20)
        )
    turns = Rotation.from_euler("z", np.linspace(-20, 20, 20)[:, None], degrees=True).as_matrix()
    rotations = turns[:, None] @ bent
    root = motion.root - (0, 0, 0.05)
    _, firm = lock_feet(BODY, root, rotations, np.ones((20, 2), bool), FPS)
    for foot in FEET:
        shins, feet = firm[:, foot - 1], firm[:, foot]
        about_shin = np.degrees(np.arctan2(*(shins.swapaxes(-1, -2) @ feet)[:, 1::-1, 0].T))
        assert np.abs(about_shin).max() < 5
        assert np.abs(feet - feet[:1]).max() < 1e-6


def test_a_walk_that_does_not_slide_is_hardly_changed():
    motion = walk()
    standing = foot_contacts(BODY, motion.root, motion.rotations, FPS, turn=0.0)
    root, firm = lock_feet(BODY, motion.root, motion.rotations, standing, FPS)
    moved = sole_points(BODY, root, firm) - sole_points(BODY, motion.root, motion.rotations)
    assert np.median(np.linalg.norm(moved, axis=-1)) < 0.005
    sunk = motion.root[:, 2] - root[:, 2]
    assert np.median(sunk) < 0.002
    assert sunk.max() < 0.02


def test_toes_below_the_floor_bend_up_and_keep_the_ankle_in_place():
    motion = gliding(BODY, 10, (0, 0), (0, 0))
    rotations, foot = motion.rotations.copy(), FEET[0]
    rotations[:, foot] = Rotation.from_euler("y", np.linspace(0, 0.5, 10)[:, None]).as_matrix()
    root = motion.root + (0, 0, 0.03)
    assert sole_points(BODY, root, rotations)[-1, 0, :, 2].min() < -0.05
    standing = np.zeros((10, 2), bool)
    standing[:, 1] = True
    root, firm = lock_feet(BODY, root, rotations, standing, FPS)
    assert sole_points(BODY, root, firm)[..., 2].min() > -1e-6
    ankles = segment_origins(BODY, root, firm)[:, foot]
    np.testing.assert_allclose(ankles[-1, :2], segment_origins(BODY, root, rotations)[-1, foot, :2], atol=0.01)


def test_hips_sink_until_legs_reach_the_floor():
    motion = gliding(BODY, 25, (0, 0), (0, 0))
    root, firm = lock_feet(BODY, motion.root + (0, 0, 0.02), motion.rotations, np.ones((25, 2), bool), FPS)
    np.testing.assert_allclose(sole_points(BODY, root, firm)[..., 2], 0, atol=0.002)
    np.testing.assert_allclose(root[:, 2], BODY.hip_height, atol=0.003)


def test_the_weight_shifts_from_foot_to_foot():
    motion = walk()
    standing = foot_contacts(BODY, motion.root, motion.rotations, FPS, turn=0.0)
    share = weight_on_feet(BODY, motion.root, motion.rotations, standing, FPS)
    assert share.shape == (len(motion), 2)
    assert (share >= 0).all()
    assert share.sum(1).max() <= 1 + 1e-9
    assert np.median(share.sum(1)) > 0.9
    alone = standing & ~standing[:, ::-1]
    assert np.median(share[alone]) > 0.9
    assert share[~standing].max() < 0.5
    assert np.abs(np.diff(share, axis=0)).max() < 0.7


def test_feet_in_flight_bear_no_weight():
    motion = gliding(BODY, 20, (0, 0), (0, 0))
    root = motion.root + (0, 0, 0.3)
    standing = foot_contacts(BODY, root, motion.rotations, FPS, turn=0.0)
    assert not standing.any()
    assert not weight_on_feet(BODY, root, motion.rotations, standing, FPS).any()
    assert foot_contacts(BODY, motion.root[:1], motion.rotations[:1], FPS, turn=0.0).all()


def test_feet_stay_above_the_floor_in_a_leap():
    """A low leap at 2 m/s, which begins and ends so flat that feet would graze the floor."""
    motion = gliding(BODY, 30, (0, 0), (0, 0))
    flight = np.clip((np.arange(30) - 9) / 12, 0, 1)
    root = motion.root + np.stack([flight, 0 * flight, 0.3 * flight * (1 - flight)], axis=1)
    standing = foot_contacts(BODY, root, motion.rotations, FPS, turn=0.0, recorded=True)
    flying = ~standing.any(1)
    assert 8 < flying.sum() < 13
    lowest = [
        sole_points(BODY, *lock_feet(BODY, root, motion.rotations, standing, FPS, recorded=recorded))[
            flying, ..., 2
        ].min()
        for recorded in (False, True)
    ]
    assert lowest[0] < 0.037 < 0.039 < lowest[1]


def test_single_intervals_between_contacts_are_no_flight(data_folder):
    """A run and a dance, with steps faster than 25 frames a second resolve."""

    def torn(take, recorded: bool) -> int:
        motion = fit_to_body(cut(read_take(data_folder / "cmu/bvh_cc" / take), start=0.4, seconds=4.0, fps=FPS), BODY)
        standing = foot_contacts(BODY, motion.root, motion.rotations, FPS, turn=0.0, recorded=recorded)
        return int((standing[1:].any(1) & standing[:-1].any(1) & ~(standing[1:] & standing[:-1]).any(1)).sum())

    takes_of = ("002_03.bvh", "005_14.bvh", "005_16.bvh")
    assert sum(torn(take, True) for take in takes_of) < sum(torn(take, False) for take in takes_of)


@pytest.mark.parametrize(
    ("kind", "folder", "limit"), [("bvh", "bvh_daz", 0.02), ("bvh", "bvh_cc", 0.02), ("amc", "asf_amc", 0.01)]
)
def test_recorded_people_do_not_skate(kind, folder, limit, data_folder):
    """Salsa, karate, dance and walks, of which a tenth of the frames skate as recorded."""
    as_recorded, ours = [], []
    for take in takes(MotionConfig(kind=kind, path=str(data_folder / "cmu" / folder))):
        motion = fit_to_body(cut(read_take(take), start=0.4, seconds=4.0, fps=FPS), BODY)
        standing = foot_contacts(BODY, motion.root, motion.rotations, FPS, turn=0.0)
        root, rotations = lock_feet(BODY, motion.root, motion.rotations, standing, FPS)
        as_recorded.append(skates(BODY, motion.root, motion.rotations))
        ours.append(skates(BODY, root, rotations))
        assert sole_points(BODY, root, rotations)[..., 2].min() > -0.02
    assert np.concatenate(ours).mean() < min(limit, np.concatenate(as_recorded).mean() / 2)


def test_sole_is_as_long_as_procedural_feet_are():
    np.testing.assert_allclose(SOLE[:, 0] * STATURE, (HEEL, TIP), atol=0.001)
