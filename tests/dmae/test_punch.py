import numpy as np
import pytest

from dmae.clip import Poses3D, Source
from dmae.gaps import neighbours
from dmae.hiding import HidingConfig
from dmae.metrics import gap_lengths
from dmae.punch import disturb, punch
from dmae.skeleton import BODY25

from .examples import walkers
from .strollers import strollers

CONFIG = HidingConfig()


def test_holes_lie_between_samples_and_are_as_long_as_asked_for():
    truth = strollers(400, 3, rng=np.random.default_rng(0))
    xyz = truth.xyz.copy()
    xyz[:50, 1] = np.nan
    truth = Poses3D(BODY25, xyz)
    given = punch(truth, 25.0, CONFIG, rng=np.random.default_rng(1))
    hidden = (given.source == Source.ABSENT) & (truth.source != Source.ABSENT)
    before, after = neighbours(given.measured)
    assert ((before >= 0) & (after < 400))[hidden].all()
    np.testing.assert_array_equal(given.xyz[given.measured], truth.xyz[given.measured])
    lengths = gap_lengths(given.measured)[hidden]
    assert all(
        ((lengths >= low) & (lengths <= high)).sum() > 100 for low, high in ((1, 5), (6, 15), (16, 40), (41, 400))
    )
    assert 0.1 < hidden.mean() < 0.6


@pytest.mark.parametrize("fps", [5.0, 25.0, 100.0])
def test_errors_have_their_size_at_any_frame_rate(fps):
    truth = strollers(int(60 * fps), 6, rng=np.random.default_rng(0), fps=fps)
    given = punch(truth, fps, HidingConfig(bursts=1.0), rng=np.random.default_rng(1))
    found = disturb(given, fps, rng=np.random.default_rng(2))
    np.testing.assert_array_equal(found.source, given.source)
    off = np.linalg.norm(found.xyz - truth.xyz, axis=-1)
    assert 0.01 < np.nanmedian(off) < 0.025
    assert 0.002 < (off[given.measured] > 0.1).mean() < 0.05


def test_what_is_beside_a_hole_is_worse():
    truth = strollers(1000, 6, rng=np.random.default_rng(0))
    given = punch(truth, 25.0, HidingConfig(bursts=1.0), rng=np.random.default_rng(1))
    off = np.linalg.norm(disturb(given, 25.0, rng=np.random.default_rng(2)).xyz - truth.xyz, axis=-1)
    last, first = neighbours(~given.measured)
    index = np.arange(1000)[:, None, None]
    away = np.minimum(np.where(last >= 0, index - last, 1000), np.where(first < 1000, first - index, 1000))
    edge, near, far = (np.mean(off[given.measured & (away == frames)]) for frames in (1, 3, 8))
    assert edge > 0.04
    assert edge > near > far
    assert far < 0.035


def test_the_same_draws_are_the_same_poses():
    truth = walkers(frames=100)
    first, again, other = (disturb(truth, 25.0, rng=np.random.default_rng(seed)).xyz for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


@pytest.mark.parametrize("shape", [(0, 2), (20, 0), (1, 1)])
def test_nothing_is_no_problem(shape):
    truth = Poses3D(BODY25, np.full((*shape, 25, 3), 1.0))
    given = punch(truth, 25.0, CONFIG, rng=np.random.default_rng(0))
    assert disturb(given, 25.0, rng=np.random.default_rng(0)).xyz.shape == truth.xyz.shape
    np.testing.assert_array_equal(given.source, truth.source)
