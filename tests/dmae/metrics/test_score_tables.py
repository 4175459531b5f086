"""Scores as tables."""

from dmae.completion.fillings import fill_linear
from dmae.data.clip import Poses3D
from dmae.data.skeleton import SHELF14
from dmae.evaluation.scores import score, summary
from dmae.metrics.score_tables import compared_error, overview, score_tables
from dmae.reporting.tables import print_tables
from tests.support.clips import walkers


def scores() -> dict:
    """Four walkers, one of them without a wrist in four frames of twenty; measured, and filled by a straight line."""
    truth = walkers(20, 4, SHELF14)
    xyz = truth.xyz.copy()
    xyz[8:12, 0, SHELF14.index("l_wrist")] = float("nan")
    captured = Poses3D(SHELF14, xyz)
    results = []
    for name, poses in (("measured", captured), ("linear", fill_linear(captured, 25.0))):
        runs = [{"clip": "a", "cameras": [0, 1], **score(poses, captured, truth)}]
        results.append({"method": name, "views": 2, **summary(runs)})
    return {"skeleton": "shelf14", "results": results}


def test_numbers_stand_under_their_headings():
    pcp, errors, identities, gaps = score_tables(scores())
    assert dict(zip(pcp.header, pcp.rows[0], strict=True)) == {
        "method": "measured", "views": "2", "mean": "99.5", "worst": "99.5",
        "P1": "98.0", "P2": "100.0", "P3": "100.0", "P4": "100.0",
    }  # fmt: skip
    assert dict(zip(errors.header, errors.rows[1], strict=True)) == {
        "method": "linear", "views": "2", "recall": "100.0", "precision": "100.0", "filled": "0.4",
        "absent": "0.0", "MPJPE": "0.0", "measured": "0.0", "unmeasured": "0.0",
    }  # fmt: skip
    assert all("shelf14" in table.caption for table in (pcp, errors, gaps)), "errors depend on the joints"
    assert "Joints of shelf14" in overview(scores()).caption
    assert identities.header == ("method", "views", "switches", "IDF1")
    assert identities.rows[0] == ("measured", "2", "0.0", "100.0")
    assert gaps.header == ("method", "views", "1-5", "6-15", "16-40", ">40")
    assert gaps.rows == [
        ("measured", "2", *["not measured"] * 4),
        ("linear", "2", "0.0", *["not measured"] * 3),
        ("joints", "2", "4 of 4", "0 of 0", "0 of 0", "0 of 0"),
    ]


def test_methods_that_state_covariances_get_a_table_of_regions():
    sure = scores()
    assert len(score_tables(sure)) == 4
    sure["results"][1]["mean"]["gaps"][0] |= {"stated": 4, "held": 75.0}
    regions = score_tables(sure)[4]
    assert regions.rows == [("linear", "2", "75.0", *["not measured"] * 3)]


def test_four_persons_fit_eighty_columns(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    print_tables(score_tables(scores()))
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 80
    assert "…" not in printed


def test_a_method_that_leaves_joints_out_is_compared_on_what_all_filled():
    """A mean over the joints that each method fills favours the one that leaves out the difficult joints."""
    gaps = [{"frames": "1-5", "filled": 3, "mpjpe": 50.0}, {"frames": ">5", "filled": 1, "mpjpe": 90.0}]
    assert compared_error({"gaps": gaps}) == 60
    assert compared_error({"gaps": [{"frames": "1-5", "filled": 0, "mpjpe": None}]}) is None
