"""Requirements that every metric meets, and adding a metric."""

import json
import sys

import numpy as np
import pytest

from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import SHELF14
from dmae.evaluation.scores import score, summary
from dmae.metrics import registry
from dmae.metrics.angles import leg_angles
from dmae.metrics.comparison import Comparison
from dmae.metrics.score_tables import score_tables
from tests.support.clips import walkers
from tests.support.shelf_walkers import aside

METRICS = {metric.name: metric for metric in registry.metrics()}
SCRATCH = '''
import numpy as np
from dmae.metrics.registry import Column, metric


@metric("root_error", columns=(Column("root", "mm"),))
def root_error(comparison) -> float:
    """Median distance of the first joint, mm."""
    offset = comparison.matched[:, :, 0] - comparison.truth.xyz[:, :, 0]
    return float(1000 * np.nanmedian(np.linalg.norm(offset, axis=-1)))
'''


def compare(name: str, pred: np.ndarray, truth: np.ndarray) -> Comparison:
    """Poses beside the truth, with the true angles for the metric that scores them: they take most of the time."""
    poses, true = Poses3D(SHELF14, pred), Poses3D(SHELF14, truth)
    angles = leg_angles(true)[0] if name == "angles" else None
    return Comparison(poses, poses, true, tuple(range(truth.shape[1])), angles=angles)


def numbers(value) -> list[float]:
    """All numbers in a score."""
    if isinstance(value, dict):
        return [number for part in value.values() for number in numbers(part)]
    if isinstance(value, list):
        return [number for part in value for number in numbers(part)]
    return [] if isinstance(value, str) else [float(value)]


@pytest.fixture
def truth() -> np.ndarray:
    return walkers(12, 3, SHELF14).xyz.astype(float)


@pytest.mark.parametrize("name", METRICS)
def test_every_metric_says_in_one_line_what_it_measures(name):
    summary = METRICS[name].help
    assert summary.endswith(".") and len(summary) <= 120 and "\n" not in summary


def test_headings_are_unique():
    headings = [column.heading for metric in METRICS.values() for column in metric.columns]
    assert len(set(headings)) == len(headings) > 5


@pytest.mark.parametrize("name", METRICS)
def test_the_order_of_predictions_does_not_matter(name, truth):
    rng = np.random.default_rng(1)
    pred = np.concatenate([truth + rng.normal(0, 0.05, truth.shape), aside(truth[:, :1], 4)], 1)
    pred[rng.random(pred.shape[:3]) < 0.2] = np.nan
    orders = ([0, 1, 2, 3], [2, 3, 1, 0])
    scores = [numbers(METRICS[name].function(compare(name, pred[:, order], truth))) for order in orders]
    np.testing.assert_allclose(*scores)


@pytest.mark.parametrize("name", METRICS)
def test_frames_without_truth_do_not_count(name, truth):
    rng = np.random.default_rng(2)
    pred = truth + rng.normal(0, 0.05, truth.shape)
    part, whole = truth.copy(), pred.copy()
    part[8:], whole[8:] = np.nan, pred[8:] + 0.3
    scores = [METRICS[name].function(compare(name, *each)) for each in ((pred[:8], truth[:8]), (whole, part))]
    np.testing.assert_allclose(*map(numbers, scores))


@pytest.mark.parametrize("name", METRICS)
def test_no_prediction_and_no_truth_are_scored(name, truth):
    for pred, true in ((truth[:, :0], truth), (np.full_like(truth, np.nan), truth), (truth, truth * np.nan)):
        found = METRICS[name].function(compare(name, pred, true))
        assert json.dumps(found)
        assert not np.isinf(numbers(found)).any()


@pytest.mark.parametrize("name", METRICS)
def test_poses_are_not_changed(name, truth):
    comparison = compare(name, aside(truth, 0.02), truth)
    METRICS[name].function(comparison)
    np.testing.assert_array_equal(comparison.truth.xyz, truth.astype(np.float32))
    assert (comparison.source == Source.MEASURED).all()


def test_a_metric_is_one_file(tmp_path, monkeypatch, truth):
    monkeypatch.setattr(registry.metric, "_added", {})
    (tmp_path / "scratch_metric.py").write_text(SCRATCH)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "scratch_metric", raising=False)
    import scratch_metric  # noqa: F401

    true = Poses3D(SHELF14, truth)
    moved = Poses3D(SHELF14, aside(truth, 0.03))
    scores = score(moved, moved, true)
    assert scores["root_error"] == pytest.approx(30, abs=0.01)
    results = [{"method": "moved", "views": 3, **summary([{"clip": "a", "cameras": [0, 1, 2], **scores}])}]
    table = score_tables({"skeleton": "shelf14", "results": results})[1]
    assert table.header[-1] == "root" and table.rows[0][-1] == "30.0"
    assert "root in mm" in table.caption


@pytest.mark.parametrize(
    ("returned", "found"),
    [("offset", r"an array \(12, 3, 3\)"), ("{'mm': [offset.mean(), offset]}", "dict"), ("comparison", "Comparison")],
)
def test_a_metric_that_returns_no_numbers_is_named(truth, tmp_path, monkeypatch, returned, found):
    monkeypatch.setattr(registry.metric, "_added", {})
    head, _, _ = SCRATCH.partition("    return ")
    (tmp_path / "scratch_metric.py").write_text(f"{head}    return {returned}\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "scratch_metric", raising=False)
    import scratch_metric  # noqa: F401

    poses = Poses3D(SHELF14, truth)
    with pytest.raises(
        ValueError, match=f"^metric 'root_error', scratch_metric:root_error: expected .*; found {found}$"
    ):
        score(poses, poses, poses)


def test_two_metrics_of_one_name_are_refused(monkeypatch):
    monkeypatch.setattr(registry.metric, "_added", {})
    with pytest.raises(ValueError, match="'pck': there is one already, dmae"):
        registry.metric("pck")(lambda comparison: 0.0)
    with pytest.raises(ValueError, match="'new': expected a docstring"):
        registry.metric("new")(lambda comparison: 0.0)
