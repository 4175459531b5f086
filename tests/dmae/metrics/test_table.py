"""The score table: intervals against the normal theory of means, and how often they contain the true value."""

import numpy as np
import pandas as pd
import pytest

from dmae.metrics.table import Score, block_of, ratios, score_of, tally


def blocks(values, counts=None, clip="a", cameras="0,1") -> pd.DataFrame:
    """The table of one run with the ratios `values` in blocks of time."""
    counts = np.ones(len(values)) if counts is None else counts
    keys = {"cameras": cameras, "clip": clip, "block": np.arange(len(values))}
    return pd.DataFrame(keys | {"value": values * counts, "count": counts})


def score(*tables: pd.DataFrame, **options) -> Score:
    return score_of(pd.concat(tables), "cameras", "clip", **options)


def test_arrays_are_summed_by_keys_and_rows_without_a_count_are_kept_where_asked_for():
    value = np.array([[1.0, 2, 3], [10, 20, np.nan]])
    table = tally(value, ~np.isnan(value), block=np.array([[0], [1]]), part=np.array(["a", "b", "b"]))
    assert table.to_dict("list") == {
        "block": [0, 0, 1, 1], "part": ["a", "b", "a", "b"], "value": [1, 5, 10, 20], "count": [1, 2, 1, 1],
    }  # fmt: skip
    counted = np.array([[True, False, False], [False, False, False]])
    assert tally(value, counted, block=np.array([[0], [1]])).to_dict("list") == {
        "block": [0], "value": [1], "count": [1],
    }  # fmt: skip
    assert tally(value, counted, among=True, block=np.array([[0], [1]]))["count"].tolist() == [1, 0]


def test_ratios_are_of_sums_in_the_order_of_the_rows_and_nan_where_nothing_counts():
    table = pd.DataFrame({"gap": ["long", "short", "long", "none"], "value": [3.0, 1, 4, 0], "count": [1, 2, 1, 0]})
    found = ratios(table, "gap", scale=100)
    assert found.index.tolist() == ["long", "short", "none"]
    np.testing.assert_array_equal(found, [350, 50, np.nan])


def test_a_frame_at_the_end_of_a_second_begins_the_next_block():
    assert block_of(np.array([0, 24, 25, 49, 50]), 25.0).tolist() == [0, 0, 1, 1, 2]
    assert block_of(np.arange(0, 300, 30), 29.97).tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]


def test_the_interval_is_that_of_a_mean():
    values = np.random.default_rng(0).normal(50, 10, 400)
    found = score(blocks(values), draws=4000)
    half = 1.96 * values.std() / np.sqrt(len(values))
    assert found.value == pytest.approx(values.mean())
    assert found.interval == pytest.approx([values.mean() - half, values.mean() + half], abs=0.06 * half)


def test_intervals_of_95_percent_hold_the_mean_of_95_percent_of_samples():
    rng = np.random.default_rng(1)
    intervals = [score(blocks(rng.normal(7, 2, 60)), draws=400).interval for _ in range(300)]
    held = np.mean([low <= 7 <= high for low, high in intervals])
    assert 0.91 <= held <= 0.98


def test_blocks_count_by_what_is_in_them():
    found = score(blocks(np.array([1.0, 3] * 5), np.array([3.0, 1] * 5)), scale=100)
    assert found.value == pytest.approx(100 * 6 / 4)


def test_what_two_scores_share_cancels_in_their_difference():
    rng = np.random.default_rng(2)
    shared = rng.normal(100, 30, 80)
    one, other = (score(blocks(shared + rng.normal(offset, 1, 80))) for offset in (2, 0))
    difference = one - other
    assert difference.excludes_zero and difference.value == pytest.approx(2, abs=0.5)
    assert np.ptp(difference.interval) < 1
    assert np.ptp(one.interval) > 10
    assert not (one - one).excludes_zero


def test_clips_count_the_same_whatever_their_length_and_subsets_of_cameras_as_well():
    long, short = np.full(30, 10.0), np.full(6, 40.0)
    tables = [
        blocks(long, clip="long"),
        blocks(short, clip="short"),
        blocks(long + 30, clip="long", cameras="0,2"),
        blocks(short, clip="short", cameras="0,2"),
    ]
    low, high = score(*tables).interval
    assert score(*tables).value == low == high == pytest.approx((10 + 40 + 40 + 40) / 4)


def test_what_has_no_ratio_leaves_its_weight_to_the_others_of_its_clip_and_subset():
    none, ten, forty = (np.full(6, ratio) for ratio in (0.0, 10.0, 40.0))
    one = [blocks(none, np.zeros(6), "a"), blocks(ten, clip="b"), blocks(ten, clip="c")]
    other = [blocks(forty, clip=clip, cameras="0,2") for clip in "abc"]
    low, high = score(*one, *other).interval
    assert score(*one, *other).value == pytest.approx((10 + 40) / 2) and [low, high] == pytest.approx([25, 25])
    persons = [blocks(each, np.full(6, float(known)), clip).assign(person=person) for each, known, clip, person in (
        (ten, 1, "a", 0), (none, 0, "a", 1), (forty, 1, "b", 0), (forty, 1, "b", 1),
    )]  # fmt: skip
    assert score_of(pd.concat(persons), "cameras", "clip", "person").value == pytest.approx((10 + 40) / 2)


def test_a_score_of_nothing_is_nan_and_few_blocks_have_no_interval():
    for nothing in (score(blocks(np.zeros(9), np.zeros(9))), score(blocks(np.zeros(0)))):
        assert np.isnan([nothing.value, *nothing.interval]).all()
    few = score(blocks(np.arange(4.0)))
    assert few.value == 1.5 and np.isnan(few.interval).all() and not few.excludes_zero


def test_clips_of_one_block_each_have_no_interval():
    """Nothing else can be drawn in place of the only block of a clip, so that the drawn scores do not vary."""
    clips = [blocks(np.array([value]), clip=f"{value}") for value in np.arange(8.0)]
    assert np.isnan(score(*clips).interval).all() and not score(*clips).excludes_zero
    assert np.isnan(score(*clips[:4], blocks(np.arange(4.0))).interval).all()
    assert np.isfinite(score(*clips[:4], blocks(np.arange(5.0))).interval).all()


def test_scores_of_other_blocks_have_no_difference():
    one, other = (score(blocks(np.arange(float(count)))) for count in (9, 8))
    with pytest.raises(ValueError, match=r"same clips expected; found \[9\] and \[8\]"):
        one - other


def test_a_score_is_printed_with_its_interval():
    score = Score(-35.0, np.linspace(-60, -10, 101), [8, 8])
    assert repr(score) == "-35 [-58.75, -11.25]"
