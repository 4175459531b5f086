"""Curves, breaking points and pages, of scores that are made for the test."""

import json
import re
from itertools import product

import numpy as np
import pytest

from dmae.evaluation.stress.matrix import Axis, Cell, Contender, Plan, breaking_point, curves
from dmae.evaluation.stress.page import axis_figure, breaking_sentence, breaking_tables, summary, write_result
from dmae.reconstruction.config import CaptureConfig

LEVELS = np.array([0.0, 10.0, 20.0, 40.0])


@pytest.mark.parametrize(
    ("margins", "level"),
    [
        ([10, 5, 1, 0.5], np.inf),
        ([10, 5, -5, -20], 15),
        ([10, -10, 5, -5], 5),
        ([10, 6, -2, 3], 17.5),
        ([-1, -2, -3, -4], 0),
        ([10, np.nan, -10, -20], 10),
        ([10, 5, 1, np.nan], np.inf),
        ([np.nan, np.nan, -1, -2], 20),
    ],
)
def test_a_curve_breaks_where_it_first_falls_below_the_bound(margins, level):
    values = np.array([margins], float)
    assert breaking_point(LEVELS, values, values < 0) == pytest.approx([level])


def scores(pcp: float, hidden: float | None, seconds: int = 8, seed: int = 0) -> dict:
    """Scores of a clip with noise from second to second."""
    rng = np.random.default_rng(seed)
    limbs = np.full(seconds, 1000)
    correct = np.clip(np.rint(10 * (pcp + rng.normal(0, 0.3, seconds))), 0, 1000)
    joints = np.full(seconds, 0 if hidden is None else 50)
    error = np.zeros(seconds) if hidden is None else 50 * (hidden + rng.normal(0, 1, seconds))
    sums = {
        "pcp": {"sum": [correct.tolist()], "count": [limbs.tolist()]},
        "hidden": {"sum": [error.tolist()], "count": [joints.tolist()]},
    }
    sums |= {"mpjpe": sums["hidden"], "recall": sums["hidden"]}
    return {
        "clip": "a", "cameras": [], "blocks": {"seconds": 1.0, "block": list(range(seconds)), **sums},
        "pck": {"recall": pcp, "precision": np.nan}, "idf1": 100.0, "shares": {"absent": 0.0},
    }  # fmt: skip


def labels(name: str, cell: Cell) -> dict:
    return {"method": name, "levels": cell.levels, "seed": cell.seed}


PCP = {"steady": [99, 99, 98, 95], "frail": [90, 85, 75, 40], "as_good": [99, 99, 98, 95.01]}
HIDDEN = {"steady": [30, 40, 50, 60], "frail": [None] * 4, "as_good": [80, 90, 110, 150]}


@pytest.fixture
def result() -> dict:
    config = CaptureConfig()
    contenders = [Contender(name, f"The {name} one.", config, name, None) for name in PCP]
    plan = Plan((Axis(("objects",), ((10.0,), (20.0,), (40.0,))),), (Axis(("cameras", "objects"), ((1, 20.0),)),), (0,))

    runs = []
    for name, cell in product(PCP, plan.cells()):
        which = int(np.flatnonzero(dict(cell.levels).get("objects", 0) == LEVELS)[0])
        runs.append(scores(PCP[name][which], HIDDEN[name][which], seed=which) | labels(name, cell))
    return curves(plan, contenders, runs, ["a"], "truth")


def test_points_have_values_and_intervals(result):
    (axis,) = result["axes"]
    points = axis["methods"]["frail"]["points"]
    assert [point["level"] for point in points] == LEVELS.tolist()
    for point, expected in zip(points, PCP["frail"], strict=True):
        value, low, high = point["pcp"]
        assert low <= value <= high and value == pytest.approx(expected, abs=0.4)
        assert point["hidden"] == [None, None, None] and point["precision"] is None


def test_breaking_points_are_interpolated_and_lie_in_their_intervals(result):
    breaks = {name: method["breaks"] for name, method in result["axes"][0]["methods"].items()}
    level, low, high = breaks["frail"]["pcp"]
    assert low <= level <= high and level == pytest.approx(15, abs=1)
    assert breaks["frail"]["hidden"] is None
    assert breaks["steady"] == {"pcp": [None] * 3, "hidden": [None] * 3}
    assert breaks["as_good"]["hidden"][0] == pytest.approx(15, abs=1)


def test_short_clips_have_no_intervals(tmp_path):
    contenders = [Contender(name, "", CaptureConfig(), "linear", None) for name in ("frail", "other")]
    plan = Plan((Axis(("objects",), ((40.0,),)),), (), (0,))

    runs = [
        scores(50.0 if cell.levels else 90.0, None, seconds=3) | labels(name, cell)
        for name, cell in product(("frail", "other"), plan.cells())
    ]
    (axis,) = (result := curves(plan, contenders, runs, ["a"], "truth"))["axes"]
    assert axis["methods"]["frail"]["breaks"]["pcp"] == [pytest.approx(10, abs=0.5), None, None]
    assert axis["methods"]["frail"]["points"][1]["pcp"][1:] == [None, None]
    assert breaking_tables(result)[0].rows == [("objects", "%", "10", "10")]
    assert axis["level_with"] is None and "too short for intervals" in summary(result)[-1]
    assert not any("95 %" in table.caption for table in breaking_tables(result))
    write_result(result, tmp_path)
    assert "Bands" not in (tmp_path / "stress.html").read_text()


def test_the_best_is_named_with_those_that_noise_does_not_tell_from_it(result):
    (axis,) = result["axes"]
    assert {axis["best"], *axis["level_with"]} == {"steady", "as_good"}


def test_words_say_what_breaks_and_what_was_not_measured(result):
    text = " ".join(summary(result))
    assert "3 methods on 1 clip (a), 1 corruption. Results are compared with the truth" in text
    assert "PCP before any corruption, in %: steady " in text
    assert "Of 1 corruption, this many do not break a method: steady 1, frail 0, as_good 1." in text
    sentence = breaking_sentence(result["axes"][0])
    assert re.fullmatch(
        r"By PCP, in %: frail breaks at 15 \(.*\); steady and as_good hold over the whole range\.", sentence
    )
    pcp, hidden = breaking_tables(result)
    assert pcp.rows[0][:3] == ("objects", "%", "> 40") and re.fullmatch(r"15 \(1\d to 1\d\)", pcp.rows[0][3])
    assert hidden.rows[0][2:4] == ("> 40", "-")


def test_a_panel_without_values_says_so_and_has_a_scale(result):
    axis = result["axes"][0]
    for names, said in ((("steady", "frail"), False), (("frail",), True)):
        _, right = axis_figure(axis | {"methods": {name: axis["methods"][name] for name in names}}).axes
        assert any("no unmeasured joint was filled" in text.get_text() for text in right.texts) == said
    assert right.get_ylim() == (0, 120)


def test_result_is_strict_json_and_a_page_that_loads_nothing(result, tmp_path):
    write_result(result, tmp_path)
    assert json.loads((tmp_path / "stress.json").read_text()) == result
    page = (tmp_path / "stress.html").read_text()
    assert "Bands are 95 %" in page
    assert page.count('role="img"') == 1 and "Two corruptions" in page and "pillars that stand in the scene" in page
    assert not re.search(r'(src|href)="http', page)
