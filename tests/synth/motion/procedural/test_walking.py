"""Procedural walking and standing: feet do not slide, knees bend one way, and curves are as published."""

import numpy as np
import pytest

from synth.motion.config import ProceduralConfig
from synth.motion.motion import FloorPath
from synth.motion.procedural.gait import Walk, knee_angle, make_motion
from synth.motion.procedural.trajectory import STRAIGHTEST
from tests.support.stick_figure import elbows, knees, soles, thighs

FPS = 100


def walker(seed: int, **config):
    config = {"standing": 0.0, "gesture": 0.0} | config
    return make_motion(ProceduralConfig(**config), seconds=5, fps=FPS, rng=np.random.default_rng(seed))


@pytest.mark.parametrize("seed", range(12))
def test_soles_neither_slide_nor_sink(seed):
    motion = walker(seed, standing=0.3, gesture=0.5)
    points = soles(motion)
    assert points[..., 2].min() > -0.012
    low = points[..., 2] < 0.002
    assert low.any(axis=(1, 2)).all()
    bearing = low[:-1] & low[1:]
    speed = np.linalg.norm(np.diff(points[..., :2], axis=0), axis=-1) * FPS
    assert np.percentile(speed[bearing], 95) < 0.05
    # A foot that bears weight moves by less than a centimetre in all.
    for foot in range(2):
        for point in range(2):
            edges = np.flatnonzero(np.diff(bearing[:, foot, point], prepend=False, append=False))
            for first, last in zip(edges[::2], edges[1::2], strict=True):
                place = points[first : last + 1, foot, point, :2]
                assert np.linalg.norm(np.ptp(place, axis=0)) < 0.01


@pytest.mark.parametrize("seed", range(6))
def test_hinges_bend_one_way(seed):
    motion = walker(seed, standing=0.3, gesture=1.0)
    assert knees(motion).min() > STRAIGHTEST - 1e-3
    assert knees(motion).max() < np.radians(85)
    assert elbows(motion).min() > 0
    assert elbows(motion).max() < np.radians(130)


def test_legs_alternate_and_arms_oppose_them():
    motion = walker(1, straight=1.0)
    left, right = thighs(motion).T
    assert np.corrcoef(left, right)[0, 1] < -0.7
    hands = motion.rotations[..., 1][:, [4, 7]] * np.array([[1], [-1]])
    ahead = np.einsum("flj,fj->fl", hands, motion.rotations[:, 0, :, 0])
    assert np.corrcoef(ahead[:, 0], right)[0, 1] > 0.7
    assert np.corrcoef(ahead[:, 1], left)[0, 1] > 0.7


@pytest.mark.parametrize("speed", [0.7, 1.0, 1.3, 1.6])
def test_knee_flexion_is_as_published(speed):
    motion = walker(0, straight=1.0, speed=[speed, speed])
    stride = Walk(FloorPath.bent(np.arange(2.0), np.zeros(2)), speed, width=0.1, toe_out=0.1).stride
    phase = np.arange(len(motion)) / FPS * speed / stride
    # The phase at which the clip begins is unknown.
    starts = np.linspace(0, 1, 50, endpoint=False)
    misses = knees(motion)[:, 1] - knee_angle((phase + starts[:, None]) % 1)
    assert np.degrees(np.sqrt((misses**2).mean(1)).min()) < 10


def test_walking_is_forward_and_at_the_requested_speed():
    motion = walker(3, straight=1.0, speed=[1.2, 1.2])
    step = np.diff(motion.root[:, :2], axis=0) * FPS
    facing = motion.rotations[:-1, 0, :2, 0]
    assert (step * facing).sum(1).min() > 0.6
    assert np.linalg.norm(motion.root[-1, :2] - motion.root[0, :2]) / (len(motion) - 1) * FPS == pytest.approx(
        1.2, rel=0.04
    )


def test_a_walk_on_a_circle_keeps_the_radius():
    config = ProceduralConfig(standing=0.0, straight=0.0, radius=[1.5, 1.5])
    clips = (make_motion(config, seconds=12, fps=20, rng=np.random.default_rng(seed)) for seed in range(20))
    motion = next(clip for clip in clips if "circle" in clip.name)
    centre = (motion.root.max(0) + motion.root.min(0)) / 2
    assert np.linalg.norm((motion.root - centre)[:, :2], axis=1) == pytest.approx(1.5, abs=0.1)


def test_standing_sways_a_little():
    motion = walker(0, standing=1.0)
    assert motion.name.startswith("stand")
    assert 0.002 < np.linalg.norm(motion.root[:, :2].std(0)) < 0.06
    assert np.abs(soles(motion)[..., 2]).max() < 1e-9


@pytest.mark.parametrize("kind", ["reach", "wave"])
def test_gestures_raise_one_hand(kind):
    motion = next(m for m in (walker(seed, standing=1.0, gesture=1.0) for seed in range(40)) if kind in m.name)
    side = 4 if motion.name.endswith("l") else 7
    lift = {index: (motion.rotations[:, index, 2, 1] * (1 if index == 4 else -1)).max() for index in (4, 7)}
    assert lift.pop(side) > -0.7
    assert lift.popitem()[1] < -0.9


def test_motion_is_determined_by_the_seed():
    assert np.array_equal(walker(5).rotations, walker(5).rotations)
    assert walker(5).name != walker(6).name
    assert len(make_motion(ProceduralConfig(), seconds=0.02, fps=50, rng=np.random.default_rng(0))) == 1


@pytest.mark.parametrize(
    ("config", "message"),
    [({"standing": 1.5}, "standing"), ({"speed": [1.0, 3.0]}, "speed"), ({"radius": [0.2, 2.0]}, "radius")],
)
def test_invalid_settings_are_refused(config, message):
    with pytest.raises(ValueError, match=message):
        ProceduralConfig(**config)
