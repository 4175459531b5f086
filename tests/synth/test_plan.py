"""Plans: motions fitted to bodies, bent, and led around whoever is in the way."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.rng import Stream, generator
from synth.body import Body, segment_origins
from synth.motion.procedural import ProceduralConfig
from synth.motion.source import MotionConfig, load_motion
from synth.person import capsules
from synth.plan import fit, give_way, lead

from .people import BODY, gliding

FPS = 25.0
NOTHING = np.empty((0, 3))


def walk(seconds: float = 3.0):
    """A straight walk of recorded kind: feet alternate, toes clear the floor."""
    config = MotionConfig(procedural=ProceduralConfig(standing=0, straight=1, gesture=0))
    return load_motion(config, seconds=seconds, fps=FPS, rng=generator(1, 0, Stream.MOTION))


def crossing(*starts_and_velocities, frames: int = 100) -> np.ndarray:
    """(F, P, 2) straight paths."""
    time = np.arange(frames)[:, None] / FPS
    return np.stack([np.array(start) + time * np.array(velocity) for start, velocity in starts_and_velocities], axis=1)


@given(st.floats(1.5, 2.0), st.floats(50, 100))
@settings(max_examples=8, deadline=None)
def test_a_fitted_body_stands_on_the_floor(stature, mass):
    body = Body(stature, mass)
    motion = fit(walk(), body)
    segments, ends, radii = capsules(body)
    origins = segment_origins(body, motion.root, motion.rotations)[:, segments]
    heights = origins[:, :, None, 2] + np.einsum("fcj,cej->fce", motion.rotations[:, segments, 2], ends)
    lowest = (heights.min(2) - radii).min(1)
    assert np.abs(lowest).max() < 0.03
    assert abs(np.median(lowest)) < 0.01


def test_longer_legs_make_longer_steps():
    motion = walk()
    short, tall = fit(motion, Body(1.5, 50)), fit(motion, Body(2.0, 90))
    strides = [np.linalg.norm(m.root[-1, :2] - m.root[0, :2]) for m in (short, tall)]
    assert strides[1] / strides[0] == pytest.approx(2.0 / 1.5)


def test_leading_turns_and_moves_a_motion_without_changing_it():
    motion = gliding(BODY, 50, (3, 4), (1, 0))
    led = lead(motion, (1.0, -2.0), np.pi / 2, 0.0)
    np.testing.assert_allclose(led.root[0, :2], (1, -2))
    np.testing.assert_allclose(np.diff(led.root[:, :2], axis=0), np.tile((0, 0.04), (49, 1)), atol=1e-12)
    np.testing.assert_allclose(led.rotations[:, 0, :, 0], np.tile((0, 1, 0), (50, 1)), atol=1e-12)


def test_a_bent_walk_goes_round_a_circle_facing_ahead():
    led = lead(gliding(BODY, 200, (0, 0), (1.2, 0)), (0.0, 0.0), 0.0, 0.8)
    centre = np.array((0, 1.2 / 0.8))
    np.testing.assert_allclose(np.linalg.norm(led.root[:, :2] - centre, axis=1), 1.5, atol=0.03)
    ahead = np.diff(led.root[:, :2], axis=0)
    facing = led.rotations[:-1, 0, :2, 0]
    assert ((ahead * facing).sum(1) / np.linalg.norm(ahead, axis=1)).min() > 0.999


@pytest.mark.parametrize("offset", [0.0, 0.01, 0.2, 0.4])
def test_people_who_meet_head_on_step_aside(offset):
    paths = crossing(((-2, 0), (1, 0)), ((2, offset), (-1, 0)))
    shift = give_way(paths, FPS, clearance=0.5, obstacles=NOTHING)
    moved = paths + shift
    assert np.linalg.norm(moved[:, 0] - moved[:, 1], axis=1).min() > 0.49
    np.testing.assert_allclose(shift[:, 0], -shift[:, 1], atol=1e-12)
    assert np.linalg.norm(np.diff(shift, axis=0), axis=-1).max() * FPS < 1.0
    assert np.abs(shift[[0, -1]]).max() < 1e-6


def test_people_of_a_crowd_and_obstacles_keep_their_distance():
    paths = crossing(((-2, 0), (1, 0)), ((2, 0.1), (-1, 0)), ((0, -2), (0, 1)))
    obstacles = np.array([[0.9, 0.1, 0.3]])
    moved = paths + give_way(paths, FPS, clearance=0.5, obstacles=obstacles)
    for one in range(3):
        for other in range(one):
            assert np.linalg.norm(moved[:, one] - moved[:, other], axis=1).min() > 0.44
    assert np.linalg.norm(moved - obstacles[0, :2], axis=-1).min() > 0.3 + 0.2


def test_whoever_has_room_keeps_their_way():
    paths = crossing(((-2, 0), (1, 0)), ((2, 1.0), (-1, 0)))
    assert not give_way(paths, FPS, clearance=0.6, obstacles=np.array([[0, 3.0, 0.5]])).any()


def test_people_in_the_same_place_part():
    paths = crossing(((0, 0), (0, 0)), ((0, 0), (0, 0)))
    moved = paths + give_way(paths, FPS, clearance=0.5, obstacles=NOTHING)
    assert np.linalg.norm(moved[:, 0] - moved[:, 1], axis=1).min() > 0.49
