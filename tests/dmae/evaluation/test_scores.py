from dataclasses import replace

import numpy as np
import pytest

from dmae.completion.fillings import fill_linear
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert, resized_poses
from dmae.data.skeleton import BODY25, SHELF14, get_skeleton
from dmae.evaluation.scores import score
from dmae.metrics.registry import metrics
from tests.support.animals import DOG, dog
from tests.support.clips import walkers


def test_scores_equal_those_worked_out_by_hand():
    """One of two walkers has a wrist hidden for four of twenty frames, filled 30 mm off."""
    truth = walkers(20, 2, SHELF14)
    wrist = SHELF14.index("l_wrist")[0]
    xyz = truth.xyz.copy()
    xyz[8:12, 0, wrist] = np.nan
    captured = Poses3D(SHELF14, xyz)
    filled = fill_linear(captured, 25.0)
    off = filled.xyz.copy()
    off[8:12, 0, wrist] += (0, 0, 0.03)
    scores = score(replace(filled, xyz=off), captured, truth)
    assert scores["pcp"] == 100
    assert scores["mpjpe"]["completed"] == pytest.approx(30, abs=0.01)
    assert scores["mpjpe"]["measured"] == 0
    assert scores["hidden"] == {"recall": 100, "mpjpe": pytest.approx(30, abs=0.01)}
    assert scores["shares"]["completed"] == pytest.approx(100 * 4 / (20 * 2 * 14))
    found = {"hidden": 4, "filled": 4, "mpjpe": pytest.approx(30, abs=0.01)}
    assert scores["gaps"][0] == {"frames": "1-5", **found, "stated": 0, "held": pytest.approx(np.nan, nan_ok=True)}
    measured = score(captured, captured, truth)
    assert measured["pcp_limbs"]["l_elbow-l_wrist"] == 90
    assert measured["pcp"] == 99
    assert measured["pcp_persons"] == [98, 100]
    assert measured["hidden"]["recall"] == 0
    assert measured["pck"] == {"recall": pytest.approx(100 * 556 / 560), "precision": 100}


def test_denoised_joints_count_as_measured():
    """With smooth=0, dmae_denoise moves only joints of few views: both kinds are in one prediction."""
    truth = walkers(20, 1, SHELF14)
    xyz, source = truth.xyz.copy(), truth.source.copy()
    xyz[:, :, :6] += (0.1, 0, 0)
    xyz[:, :, 6:] += (0.01, 0, 0)
    source[:, :, 6:] = Source.DENOISED
    found = score(Poses3D(SHELF14, xyz, source), truth, truth)["mpjpe"]
    assert found["measured"] == found["all"] == pytest.approx((6 * 100 + 8 * 10) / 14)
    (column,) = (column for each in metrics() for column in each.columns if column.heading == "measured")
    assert column.value(found) == found["measured"]


def test_regions_allow_for_how_well_the_reference_was_measured():
    truth = walkers(20, 1, SHELF14)
    captured = truth.without((np.arange(20) // 4 == 2)[:, None, None] & (np.arange(14) == 5))
    filled = fill_linear(captured, 25.0)
    lacking = ~captured.measured[..., None, None]
    filled = replace(filled, xyz=truth.xyz + 0.03, cov=np.where(lacking, 0.015**2 * np.eye(3), np.nan))
    held = []
    for deviation in (np.nan, 0.001, 0.02):
        cov = np.broadcast_to(deviation**2 * np.eye(3), filled.cov.shape)
        held.append(score(filled, captured, replace(truth, cov=cov))["gaps"][0]["held"])
    # 52 mm off: beyond 2.5 deviations of 15 mm, within as many of 25 mm.
    assert held == [0, 0, 100]


def test_the_average_is_over_the_actors_asked_for():
    truth = walkers(4, 3, SHELF14)
    xyz = truth.xyz.copy()
    xyz[:, 2] = np.nan
    poses = Poses3D(SHELF14, xyz)
    assert score(poses, poses, truth)["pcp"] == pytest.approx(200 / 3)
    assert score(poses, poses, truth, (0, 1))["pcp"] == 100


def test_skeletons_may_differ():
    truth = walkers(4, 2, SHELF14)
    body25 = walkers(4, 2)
    fused = np.concatenate([body25.xyz, truth.xyz], 2)
    scores = score(Poses3D(get_skeleton("body25+shelf14"), fused), body25, truth)
    assert scores["pcp"] == 100
    assert scores["mpjpe"]["all"] == 0
    assert score(body25, body25, truth)["mpjpe"]["all"] < 1


def test_nothing_captured_scores_zero():
    truth = walkers(4, 2, SHELF14)
    nobody = Poses3D(BODY25, np.empty((4, 0, 25, 3)))
    scores = score(nobody, nobody, truth)
    assert scores["pcp"] == 0
    assert scores["pck"]["recall"] == 0
    assert scores["shares"]["absent"] == 100


def test_persons_must_be_the_same_before_and_after_filling():
    with pytest.raises(ValueError, match="differ in shape"):
        score(walkers(4, 1), walkers(4, 2), walkers(4, 2, SHELF14))


def test_shelf_s_truth_scores_a_hundred_against_itself(data_folder):
    from dmae.formats.shelf import read_shelf

    truth = read_shelf(data_folder / "shelf").truth
    scores = score(truth, truth, truth, (0, 1, 2))
    assert scores["pcp"] == 100
    assert set(scores["pcp_published"].values()) == {100}
    assert (convert(truth, SHELF14).source == Source.ABSENT).any()


@pytest.mark.parametrize("stated", [True, False])
def test_small_bodies_are_matched_and_scored_as_large_ones(stated):
    """Two mice 3 cm apart, the second predicted 9 mm off: at the scale of people another animal is 50 cm off."""
    rng = np.random.default_rng(3)
    truth = np.stack([dog(40, rng=rng, radius=0.6), dog(40, rng=rng, radius=1.5)], 1)
    xyz = truth + rng.normal(0, 0.05, truth.shape)
    xyz[:, 1] += (0, 0, 0.3)
    xyz[::3, 0] += (0, 0, 0.7)
    found = {}
    for factor in (1.0, 0.03):
        skeleton = replace(DOG, size_m=factor * DOG.size_m if stated else None)
        true, pred = (resized_poses(Poses3D(skeleton, part), factor) for part in (truth, xyz))
        found[factor] = score(pred, pred.without(rng.random(pred.source.shape) < 0), true)
    large, small = found[1.0], found[0.03]
    assert large["pck"]["recall"] < 50 < 60 < large["idf1"]
    for name in ("pcp", "pck", "idf1", "identity_switches", "pcp_published"):
        assert small[name] == pytest.approx(large[name]), name
    assert small["mpjpe"]["all"] == pytest.approx(0.03 * large["mpjpe"]["all"], rel=1e-4)
    assert small["hidden"]["recall"] == pytest.approx(large["hidden"]["recall"], nan_ok=True)
