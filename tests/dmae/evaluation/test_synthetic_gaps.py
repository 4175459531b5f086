"""Synthetic gaps and perturbation."""

import numpy as np
import pytest

from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25
from dmae.evaluation.synthetic_gaps import cut_gaps, perturb
from dmae.numerics.paths import gap_lengths, neighbours
from tests.support.circling_people import circling_people
from tests.support.clips import walkers


def test_gaps_lie_between_samples_and_have_many_lengths():
    truth = circling_people(400, 3, rng=np.random.default_rng(0))
    xyz = truth.xyz.copy()
    xyz[:50, 1] = np.nan
    truth = Poses3D(BODY25, xyz)
    given = cut_gaps(truth, 25.0, rng=np.random.default_rng(1))
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
    truth = circling_people(int(60 * min(fps, 40)), 6, rng=np.random.default_rng(0), fps=fps)
    given = cut_gaps(truth, fps, rng=np.random.default_rng(1))
    found = perturb(given, fps, rng=np.random.default_rng(2))
    np.testing.assert_array_equal(found.source, given.source)
    off = np.linalg.norm(found.xyz - truth.xyz, axis=-1)
    assert 0.01 < np.nanmedian(off) < 0.025
    assert 0.002 < (off[given.measured] > 0.1).mean() < 0.05


def test_errors_are_larger_beside_gaps():
    truth = circling_people(1000, 6, rng=np.random.default_rng(0))
    given = cut_gaps(truth, 25.0, rng=np.random.default_rng(1))
    off = np.linalg.norm(perturb(given, 25.0, rng=np.random.default_rng(2)).xyz - truth.xyz, axis=-1)
    last, first = neighbours(~given.measured)
    index = np.arange(1000)[:, None, None]
    away = np.minimum(np.where(last >= 0, index - last, 1000), np.where(first < 1000, first - index, 1000))
    edge, near, far = (np.mean(off[given.measured & (away == frames)]) for frames in (1, 3, 8))
    assert edge > 0.04
    assert edge > near > far
    assert far < 0.035


def test_the_same_seed_gives_the_same_poses():
    truth = walkers(frames=100)
    first, again, other = (perturb(truth, 25.0, rng=np.random.default_rng(seed)).xyz for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert (first != other).any()


@pytest.mark.parametrize("shape", [(0, 2), (20, 0), (1, 1)])
def test_empty_and_single_poses(shape):
    truth = Poses3D(BODY25, np.full((*shape, 25, 3), 1.0))
    given = cut_gaps(truth, 25.0, rng=np.random.default_rng(0))
    assert perturb(given, 25.0, rng=np.random.default_rng(0)).xyz.shape == truth.xyz.shape
    np.testing.assert_array_equal(given.source, truth.source)
