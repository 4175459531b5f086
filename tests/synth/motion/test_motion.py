"""Paths: motions moved and bent, and sidesteps around people and obstacles."""

import numpy as np
import pytest

from synth.motion.motion import avoid_collisions, redirect
from tests.support.scenes import BODY, gliding

FPS = 25.0
NOTHING = np.empty((0, 3))


def crossing(*starts_and_velocities, frames: int = 100) -> np.ndarray:
    """(F, P, 2) straight paths."""
    time = np.arange(frames)[:, None] / FPS
    return np.stack([np.array(start) + time * np.array(velocity) for start, velocity in starts_and_velocities], axis=1)


def test_redirect_turns_and_moves_a_motion_rigidly():
    motion = gliding(BODY, 50, (3, 4), (1, 0))
    moved = redirect(motion, (1.0, -2.0), np.pi / 2, 0.0)
    np.testing.assert_allclose(moved.root[0, :2], (1, -2))
    np.testing.assert_allclose(np.diff(moved.root[:, :2], axis=0), np.tile((0, 0.04), (49, 1)), atol=1e-12)
    np.testing.assert_allclose(moved.rotations[:, 0, :, 0], np.tile((0, 1, 0), (50, 1)), atol=1e-12)


def test_a_bent_walk_circles_facing_ahead():
    moved = redirect(gliding(BODY, 200, (0, 0), (1.2, 0)), (0.0, 0.0), 0.0, 0.8)
    centre = np.array((0, 1.2 / 0.8))
    np.testing.assert_allclose(np.linalg.norm(moved.root[:, :2] - centre, axis=1), 1.5, atol=0.03)
    ahead = np.diff(moved.root[:, :2], axis=0)
    facing = moved.rotations[:-1, 0, :2, 0]
    assert ((ahead * facing).sum(1) / np.linalg.norm(ahead, axis=1)).min() > 0.999


@pytest.mark.parametrize("offset", [0.0, 0.01, 0.2, 0.4])
def test_people_who_meet_head_on_step_aside(offset):
    paths = crossing(((-2, 0), (1, 0)), ((2, offset), (-1, 0)))
    shift = avoid_collisions(paths, FPS, clearance=0.5, obstacles=NOTHING)
    moved = paths + shift
    assert np.linalg.norm(moved[:, 0] - moved[:, 1], axis=1).min() > 0.49
    np.testing.assert_allclose(shift[:, 0], -shift[:, 1], atol=1e-12)
    assert np.linalg.norm(np.diff(shift, axis=0), axis=-1).max() * FPS < 1.0
    assert np.abs(shift[[0, -1]]).max() < 1e-6


def test_crowds_keep_clear_of_each_other_and_of_obstacles():
    paths = crossing(((-2, 0), (1, 0)), ((2, 0.1), (-1, 0)), ((0, -2), (0, 1)))
    obstacles = np.array([[0.9, 0.1, 0.3]])
    moved = paths + avoid_collisions(paths, FPS, clearance=0.5, obstacles=obstacles)
    for one in range(3):
        for other in range(one):
            assert np.linalg.norm(moved[:, one] - moved[:, other], axis=1).min() > 0.44
    assert np.linalg.norm(moved - obstacles[0, :2], axis=-1).min() > 0.3 + 0.2


def test_paths_with_room_are_unchanged():
    paths = crossing(((-2, 0), (1, 0)), ((2, 1.0), (-1, 0)))
    assert not avoid_collisions(paths, FPS, clearance=0.6, obstacles=np.array([[0, 3.0, 0.5]])).any()


def test_people_in_the_same_place_separate():
    paths = crossing(((0, 0), (0, 0)), ((0, 0), (0, 0)))
    moved = paths + avoid_collisions(paths, FPS, clearance=0.5, obstacles=NOTHING)
    assert np.linalg.norm(moved[:, 0] - moved[:, 1], axis=1).min() > 0.49
