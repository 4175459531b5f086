"""How stated uncertainty ranks errors."""

import numpy as np
import pytest
from scipy.stats import spearmanr

from dmae.metrics.uncertainty import COVERAGES, rank_scores


def test_a_perfect_order_has_the_least_risk():
    error = np.arange(1.0, 101.0)
    scores = rank_scores(error, error**2)
    assert (scores["spearman"], scores["auc"]) == pytest.approx((1, 1))
    assert scores["risk_10"] == 5.5
    assert scores["risk_100"] == 50.5
    turned = rank_scores(error, -error)
    assert (turned["spearman"], turned["auc"]) == pytest.approx((-1, 0))
    assert turned["risk_10"] == 95.5


def test_it_agrees_with_scipy_and_with_counted_pairs():
    rng = np.random.default_rng(0)
    stated = rng.integers(1, 20, 300).astype(float)
    error = 60 * rng.gamma(stated) / 10
    scores = rank_scores(error, stated)
    assert scores["spearman"] == pytest.approx(spearmanr(stated, error).statistic)
    large, small = stated[error > 50][:, None], stated[error <= 50]
    assert scores["auc"] == pytest.approx((large > small).mean() + (large == small).mean() / 2)


def test_what_is_undefined_is_nan():
    assert np.isnan([*rank_scores(np.empty(0), np.empty(0)).values()]).all()
    same = rank_scores(np.full(5, 10.0), np.full(5, 1.0))
    assert np.isnan([same["spearman"], same["auc"]]).all()
    assert [same[f"risk_{share}"] for share in COVERAGES] == [10.0] * len(COVERAGES)
