"""A gate reports worse figures, ignores noise, and refuses figures that cannot be compared."""

import copy
import json
import re
from dataclasses import replace
from functools import reduce
from operator import getitem
from pathlib import Path

import numpy as np
import pytest

from dmae.commands import evaluate as command
from dmae.data.clip import Clip, Detections2D
from dmae.data.labels import DetectionLabels
from dmae.data.store import save_clip
from dmae.evaluation.config import EvaluateConfig
from dmae.evaluation.evaluate import evaluate
from dmae.evaluation.gates import compare_scores, scored_clip
from dmae.evaluation.scores import FIGURES, read_scores
from tests.support.commands import dmae
from tests.support.scored_clips import config, seen


def ten_seconds() -> Clip:
    return replace(seen(frames=50), fps=5.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("gates")
    save_clip(ten_seconds(), folder / "data")
    return folder


@pytest.fixture(scope="module")
def baseline(folder: Path) -> dict:
    scores = evaluate(config(folder / "data", methods=["measured", "linear"], views=[4, 3]))
    return json.loads(json.dumps(scores))


def worse(scores: dict, figure: str, by: float, method: str = "linear", views: int = 4, blocks=slice(None)) -> dict:
    """Scores in which a figure of a method is worse, or better, in some blocks of time by so much of each count."""
    scores = copy.deepcopy(scores)
    (result,) = [each for each in scores["results"] if (each["method"], each["views"]) == (method, views)]
    for run in result["runs"]:
        sums = run["blocks"][figure]
        changed = np.array(sums["sum"], float)
        changed[:, blocks] += by * np.array(sums["count"])[:, blocks]
        sums["sum"] = changed.tolist()
    return scores


def test_every_figure_with_sums_by_time_has_a_mean_to_judge(baseline: dict):
    for result in baseline["results"]:
        summed = result["runs"][0]["blocks"].keys() - {"seconds", "block"}
        assert summed == FIGURES.keys() - {"angles"}
        for name in summed:
            value = reduce(getitem, FIGURES[name].place, result["mean"])
            assert value is None or value >= 0


def test_equal_scores_pass(baseline: dict):
    gate = compare_scores(baseline, copy.deepcopy(baseline))
    assert gate.passed and not gate.worse
    assert {(change.method, change.views, change.figure) for change in gate.changes} >= {
        ("measured", 3, "pcp"), ("linear", 4, "mpjpe"), ("linear", 3, "hidden"),
    }  # fmt: skip
    assert str(gate).startswith("passed: of ")


@pytest.mark.parametrize(("figure", "by", "text"), [
    ("pcp", -0.02, r"linear, 4 views: strict PCP is worse by 2.0 % \(95 % interval 2.0 to 2.0\): 100.0 -> 98.0"),
    ("mpjpe", 5.0, r"linear, 4 views: MPJPE is worse by 5.0 mm \(95 % interval 5.0 to 5.0\): 0.\d -> 5.\d"),
    ("hidden", 3.0, "linear, 4 views: MPJPE of unmeasured joints is worse by 3.0 mm"),
])  # fmt: skip
def test_what_is_worse_is_named_with_its_interval(baseline: dict, figure: str, by: float, text: str):
    gate = compare_scores(baseline, worse(baseline, figure, by))
    assert [change.figure for change in gate.worse] == [figure]
    assert not gate.passed
    assert re.search(text, str(gate)), str(gate)


def test_what_is_better_is_named_and_passes(baseline: dict):
    gate = compare_scores(worse(baseline, "mpjpe", 5.0), baseline)
    assert gate.passed
    assert "MPJPE is better by 5.0 mm" in str(gate)


def test_a_change_in_one_second_of_many_is_noise(baseline: dict):
    """Drawing other moments, the difference would often be none."""
    gate = compare_scores(baseline, worse(baseline, "mpjpe", 8.0, blocks=slice(3, 4)))
    assert gate.passed
    (change,) = [each for each in gate.changes if (each.method, each.views, each.figure) == ("linear", 4, "mpjpe")]
    assert change.low == 0 < change.new - change.old
    assert "within its interval" in str(change)


def test_what_would_not_be_printed_is_no_change(baseline: dict):
    assert compare_scores(baseline, worse(baseline, "mpjpe", 0.04)).passed


def test_the_order_of_clips_and_subsets_does_not_matter(baseline: dict):
    shuffled = copy.deepcopy(baseline)
    for result in shuffled["results"]:
        result["runs"].reverse()
    gate = compare_scores(baseline, shuffled)
    assert gate.passed and all(change.low == change.high == 0 for change in gate.changes)


def test_a_method_or_number_of_views_that_is_missing_is_refused_by_name(baseline: dict):
    fewer = copy.deepcopy(baseline)
    fewer["results"] = [each for each in fewer["results"] if (each["method"], each["views"]) != ("linear", 3)]
    gate = compare_scores(baseline, fewer)
    assert gate.refused == ("linear, 3 views: in the baseline, and not scored now",)
    assert not gate.passed and not gate.worse
    more = compare_scores(fewer, baseline)
    assert more.passed and "linear, 3 views: new, not in the baseline" in more.notes


def test_figures_without_an_interval_are_named_and_not_judged(baseline: dict):
    other = copy.deepcopy(baseline)
    other["results"][1]["mean"]["pck"]["precision"] = 90.0
    gate = compare_scores(baseline, other)
    assert gate.passed
    assert gate.notes == ("linear, 4 views: precision 100.0 -> 90.0 %, has no interval",)


def test_a_figure_measured_on_one_side_alone_is_refused(baseline: dict):
    other = worse(baseline, "hidden", 0)
    for run in other["results"][1]["runs"]:
        run["blocks"]["hidden"]["count"] = [[0] * len(run["blocks"]["block"])]
    gate = compare_scores(baseline, other)
    assert gate.refused == ("linear, 4 views: MPJPE of unmeasured joints: measured in the baseline alone",)


def test_few_seconds_are_refused_where_they_changed(folder: Path):
    save_clip(seen(frames=50), folder / "short")
    short = json.loads(json.dumps(evaluate(config(folder / "short", methods=["linear"]))))
    assert compare_scores(short, short).passed
    (refused,) = compare_scores(short, worse(worse(short, "mpjpe", 5.0), "pcp", 3.0)).refused
    assert re.fullmatch(
        r"linear, 4 views: strict PCP [\d.]+ -> [\d.]+ %, MPJPE [\d.]+ -> [\d.]+ mm: too little truth for intervals, "
        "which need 5 s in one clip, and 1 s more for each further clip",
        refused,
    )
    # Another processor can cause smaller changes.
    assert compare_scores(short, worse(short, "mpjpe", 0.04)).passed


@pytest.mark.parametrize(("edit", "message"), [
    (
        lambda s: s["options"].update({f"capture.option_{n}": n for n in range(5)}),
        "capture.option_2=2 in the baseline, not an option here and 2 more. .*changed=.capture.$",
    ),
    (lambda s: s["options"].update(smooth=0.2), "other options.*smooth=0.2 in the baseline, 0.1 here.*changed=.smooth"),
    (lambda s: s["options"].update(input="true_poses"), "input=true_poses in the baseline, captured_poses here"),
    (lambda s: s["options"].update({"capture.th_v": 3}), r"capture.th_v=3 in the baseline"),
    (lambda s: s.update(skeleton="body25"), "other data.*skeleton body25 in the baseline, shelf14 here"),
    (lambda s: s["clips"].update(b=s["clips"].pop("seen")), "'b' is of the baseline alone; clip 'seen' is not of"),
    (lambda s: s["clips"]["seen"].update(frames=90), "clip 'seen': frames 90 in the baseline, 50 here"),
    (lambda s: s["clips"]["seen"].update(cameras=["x"]), "clip 'seen': cameras"),
    (lambda s: s.pop("options"), "dmae evaluate wrote, found other content, or scores of an earlier version; make"),
    (lambda s: s["results"][0]["runs"][0].pop("blocks"), "expected the scores.json that dmae evaluate wrote"),
    (lambda s: s.update(results=5), "expected the scores.json that dmae evaluate wrote"),
    (lambda s: s.update(results=[{}]), "expected the scores.json that dmae evaluate wrote"),
])  # fmt: skip
def test_what_cannot_be_compared_is_refused_with_both_sides(baseline: dict, edit, message: str):
    other = copy.deepcopy(baseline)
    edit(other)
    with pytest.raises(ValueError, match=message):
        compare_scores(other, baseline)


def test_recordings_without_truth_are_compared_too(tmp_path: Path):
    """All cameras together are the reference of fewer."""
    save_clip(replace(ten_seconds(), truth=None), tmp_path / "data")
    scores = evaluate(config(tmp_path / "data", methods=["linear"], views=[3], reference="capture"))
    gate = compare_scores(json.loads(json.dumps(scores)), scores)
    assert gate.passed and gate.changes


def test_options_may_change_on_purpose(baseline: dict):
    other = copy.deepcopy(baseline)
    other["options"].update({"smooth": 0.2, "capture.tracking.coasting_s": 9})
    assert compare_scores(other, baseline, ["smooth", "capture"]).passed
    with pytest.raises(ValueError, match="coasting_s=9"):
        compare_scores(other, baseline, ["smooth"])


def labelled(shift: float = 0.0, misses: int = 0) -> Clip:
    """A clip that counts as simulated, with detections moved by so many px, some of them missed."""
    clip = ten_seconds()
    xy, found = clip.detections.xy + np.float32(shift), clip.detections.score.copy()
    xy[:misses], found[:misses] = np.nan, np.nan
    shape = found.shape
    labels = DetectionLabels(
        person=np.zeros(shape[:3], np.int16),
        joint_person=np.where(np.isnan(found), -1, 0),
        error=np.where(np.isnan(found), 0, 1),
        offset_px=np.where(np.isnan(found), np.nan, 2.0 + shift),
    )
    return replace(clip, detections=Detections2D(clip.detections.skeleton, xy, found), detection_labels=labels)


@pytest.mark.parametrize(("shift", "misses", "same"), [(1e-4, 0, True), (0.5, 0, False), (0.0, 5, False)])
def test_simulated_clips_may_differ_in_rounding_alone(baseline: dict, shift: float, misses: int, same: bool):
    clips = labelled(), labelled(shift, misses)
    scores = [baseline | {"clips": {clip.id: json.loads(json.dumps(scored_clip(clip)))}} for clip in clips]
    if same:
        assert compare_scores(*scores).passed
    else:
        with pytest.raises(ValueError, match=r"clip 'seen': (offset_px|detected)"):
            compare_scores(*scores)


def test_recordings_must_be_the_same_to_the_last_digit(baseline: dict):
    clip = ten_seconds()
    xy = clip.detections.xy.copy()
    xy[0, 0, 0, 0] += 0.01
    moved = replace(clip, detections=Detections2D(clip.detections.skeleton, xy, clip.detections.score))
    with pytest.raises(ValueError, match="clip 'seen': sha256"):
        compare_scores(baseline, baseline | {"clips": {clip.id: scored_clip(moved)}})


def test_the_command_says_so_by_its_status(folder: Path, baseline: dict, monkeypatch):
    options = ("data=data", "methods=[measured,linear]", "views=[4,3]", "out=scores")
    (folder / "old.json").write_text(json.dumps(baseline))
    done = dmae(folder, "evaluate", *options, "baseline=old.json")
    assert (done.returncode, done.stderr) == (0, "")
    assert "passed: of" in done.stdout
    scores = read_scores(folder / "scores/scores.json")

    def same(config: EvaluateConfig) -> dict:
        """The scores that were just computed."""
        return scores | {"results": [each for each in scores["results"] if each["method"] in config.methods]}

    monkeypatch.setattr(command, "evaluate", same)
    (folder / "good.json").write_text(json.dumps(worse(baseline, "mpjpe", -1.0)))
    done = dmae(folder, "evaluate", *options, "baseline=good.json")
    assert done.returncode == 2
    assert "linear, 4 views: MPJPE is worse" in done.stdout and "FAILED: of 14 figures 1 are worse" in done.stdout
    assert (folder / "scores/scores.json").is_file()
    done = dmae(folder, "evaluate", *options[:1], "methods=[linear]", *options[2:], "baseline=scores")
    assert done.returncode == 1
    assert "not compared: measured, 4 views: in the baseline, and not scored now" in done.stdout
    done = dmae(folder, "evaluate", *options, "baseline=nowhere.json")
    assert done.returncode == 1 and "nowhere.json: no such file" in done.stderr
