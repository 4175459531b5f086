"""Intervals: against the normal theory of means, and how often they contain the true value."""

import numpy as np
import pytest

from dmae.metrics.intervals import block_sums, bootstrap_difference, bootstrap_ratio


def runs(values, counts=None, clip="a", cameras=(0, 1)):
    """One run with the ratios `values` in blocks of time."""
    counts = np.ones(len(values)) if counts is None else counts
    sums = {"sum": [(values * counts).tolist()], "count": [counts.tolist()]}
    blocks = {"seconds": 1.0, "block": list(range(len(values))), "pcp": sums, "mpjpe": sums, "hidden": sums}
    return [{"clip": clip, "cameras": list(cameras), "blocks": blocks}]


def test_the_interval_is_that_of_a_mean():
    values = np.random.default_rng(0).normal(50, 10, 400)
    interval = bootstrap_ratio(block_sums(runs(values), "mpjpe"), draws=4000)
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert interval.value == pytest.approx(values.mean())
    assert [interval.low, interval.high] == pytest.approx([values.mean() - half, values.mean() + half], abs=0.06 * half)


def test_intervals_of_95_percent_hold_the_mean_of_95_percent_of_samples():
    rng = np.random.default_rng(1)
    intervals = [bootstrap_ratio(block_sums(runs(rng.normal(7, 2, 60)), "mpjpe"), draws=400) for _ in range(300)]
    held = np.mean([interval.low <= 7 <= interval.high for interval in intervals])
    assert 0.91 <= held <= 0.98


def test_blocks_count_by_what_is_in_them():
    interval = bootstrap_ratio(block_sums(runs(np.array([1.0, 3] * 5), np.array([3.0, 1] * 5)), "pcp"))
    assert interval.value == pytest.approx(100 * 6 / 4)


def test_what_two_scores_share_cancels_in_their_difference():
    rng = np.random.default_rng(2)
    shared = rng.normal(100, 30, 80)
    one, other = (block_sums(runs(shared + rng.normal(offset, 1, 80)), "mpjpe") for offset in (2, 0))
    difference = bootstrap_difference(one, other)
    assert difference.excludes_zero and difference.value == pytest.approx(2, abs=0.5)
    assert difference.high - difference.low < 1
    assert bootstrap_ratio(one).high - bootstrap_ratio(one).low > 10
    assert not bootstrap_difference(one, one).excludes_zero


def test_clips_count_the_same_whatever_their_length_and_subsets_of_cameras_as_well():
    long, short = np.full(30, 10.0), np.full(6, 40.0)
    several = [*runs(long, clip="long"), *runs(short, clip="short"), *runs(long + 30, clip="long", cameras=(0, 2))]
    interval = bootstrap_ratio(block_sums([*several, *runs(short, clip="short", cameras=(0, 2))], "mpjpe"))
    assert interval.value == interval.low == interval.high == pytest.approx((10 + 40 + 40 + 40) / 4)


def test_a_score_of_nothing_is_nan_and_few_blocks_have_no_interval():
    nothing = bootstrap_ratio(block_sums(runs(np.zeros(9), np.zeros(9)), "mpjpe"))
    assert np.isnan([nothing.value, nothing.low, nothing.high]).all()
    few = bootstrap_ratio(block_sums(runs(np.arange(4.0)), "mpjpe"))
    assert few.value == 1.5 and np.isnan([few.low, few.high]).all() and not few.excludes_zero


def test_scores_that_do_not_fit_together_are_refused():
    with pytest.raises(ValueError, match=r"same clips expected; found \[9\] and \[8\]"):
        bootstrap_difference(*(block_sums(runs(np.arange(count)), "pcp") for count in (9, 8)))
    with pytest.raises(ValueError, match="no sums by time"):
        block_sums([{"clip": "a", "cameras": []}], "pcp")
    with pytest.raises(ValueError, match="'a' has other annotated frames"):
        block_sums([*runs(np.arange(9.0)), *runs(np.arange(8.0), cameras=(1, 2))], "pcp")
