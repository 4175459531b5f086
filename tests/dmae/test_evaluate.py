import json
from dataclasses import replace

import numpy as np
import pytest

from dmae.baselines import fill_linear
from dmae.clip import Clip, Detections2D, Poses3D, Source
from dmae.data import DataConfig, Format
from dmae.evaluate import EvaluateConfig, evaluate, score
from dmae.mapping import convert
from dmae.skeleton import BODY25, SHELF14, get_skeleton
from dmae.store import save_clip, write_manifest

from .examples import looking_at_origin, walkers


def seen(persons: int = 2, frames: int = 20, name: str = "seen") -> Clip:
    """Walkers seen without error by four cameras but for a stretch in which a wrist is not; truth on two skeletons."""
    poses, rig = walkers(frames, persons), looking_at_origin()
    xy, _ = rig.project(poses.xyz)
    score_ = np.full(xy.shape[:-1], 0.9)
    wrist = BODY25.index("l_wrist")[0]
    xy[8:12, :, 0, wrist], score_[8:12, :, 0, wrist] = np.nan, np.nan
    fused = np.concatenate([poses.xyz, walkers(frames, persons, SHELF14).xyz], 2)
    truth = Poses3D(get_skeleton("body25+shelf14"), fused)
    return Clip(name, 25.0, rig, Detections2D(BODY25, xy, score_), truth=truth)


def config(path, **changes) -> EvaluateConfig:
    return EvaluateConfig(data=DataConfig(path=str(path)), **changes)


def by_method(scores: dict) -> dict[tuple[str, int], dict]:
    return {(result["method"], result["views"]): result for result in scores["results"]}


class TestScore:
    def test_by_hand(self):
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
        assert np.isnan(scores["mpjpe"]["denoised"])
        assert scores["hidden"] == {"recall": 100, "mpjpe": pytest.approx(30, abs=0.01)}
        assert scores["shares"]["completed"] == pytest.approx(100 * 4 / (20 * 2 * 14))
        assert scores["gaps"][0] == {"frames": "1-5", "hidden": 4, "filled": 4, "mpjpe": pytest.approx(30, abs=0.01)}
        measured = score(captured, captured, truth)
        assert measured["pcp_limbs"]["l_elbow-l_wrist"] == 90
        assert measured["pcp"] == 99
        assert measured["pcp_persons"] == [98, 100]
        assert measured["hidden"]["recall"] == 0
        assert measured["pck"] == {"recall": pytest.approx(100 * 556 / 560), "precision": 100}

    def test_the_average_is_over_the_actors_asked_for(self):
        truth = walkers(4, 3, SHELF14)
        xyz = truth.xyz.copy()
        xyz[:, 2] = np.nan
        poses = Poses3D(SHELF14, xyz)
        assert score(poses, poses, truth)["pcp"] == pytest.approx(200 / 3)
        assert score(poses, poses, truth, (0, 1))["pcp"] == 100

    def test_skeletons_may_differ(self):
        truth = walkers(4, 2, SHELF14)
        body25 = walkers(4, 2)
        fused = np.concatenate([body25.xyz, truth.xyz], 2)
        scores = score(Poses3D(get_skeleton("body25+shelf14"), fused), body25, truth)
        assert scores["pcp"] == 100
        assert scores["mpjpe"]["all"] == 0
        assert score(body25, body25, truth)["mpjpe"]["all"] < 1

    def test_nobody_captured(self):
        truth = walkers(4, 2, SHELF14)
        nobody = Poses3D(BODY25, np.empty((4, 0, 25, 3)))
        scores = score(nobody, nobody, truth)
        assert scores["pcp"] == 0
        assert scores["pck"]["recall"] == 0
        assert scores["shares"]["absent"] == 100

    def test_persons_must_be_the_same_before_and_after_filling(self):
        with pytest.raises(ValueError, match="differ in shape"):
            score(walkers(4, 1), walkers(4, 2), walkers(4, 2, SHELF14))


class TestEvaluate:
    def test_methods_and_subsets_of_a_clip(self, tmp_path):
        save_clip(seen(), tmp_path)
        scores = evaluate(config(tmp_path, methods=["measured", "linear"], views=[4, 3]))
        assert scores["skeleton"] == "shelf14"
        results = by_method(scores)
        assert list(results) == [("measured", 4), ("linear", 4), ("measured", 3), ("linear", 3)]
        assert [run["cameras"] for run in results["linear", 3]["runs"]] == [[0, 1, 2], [0, 1, 3], [0, 2, 3], [1, 2, 3]]
        # Exact detections are captured exactly, and straight walks filled so; the head's formula is that of the truth.
        assert results["linear", 4]["mean"]["pcp"] == 100
        assert results["linear", 4]["mean"]["mpjpe"]["all"] < 1
        assert results["linear", 4]["mean"]["pck"] == {"recall": 100, "precision": 100}
        assert results["measured", 4]["mean"]["pcp_persons"] == [98, 100]
        assert results["measured", 4]["mean"]["mpjpe"]["denoised"] is None
        assert results["linear", 4]["mean"]["mpjpe"]["measured"] is None

    def test_scores_are_strict_json(self, tmp_path):
        save_clip(seen(), tmp_path)
        scores = evaluate(config(tmp_path, methods=["measured"]))
        assert json.loads(json.dumps(scores, allow_nan=False)) == scores

    def test_a_data_set_is_averaged_over_its_clips(self, tmp_path):
        good, blind = seen(name="a"), seen(name="b")
        nothing = np.full_like(blind.detections.xy, np.nan)
        blind = replace(blind, detections=Detections2D(BODY25, nothing, nothing[..., 0]))
        for clip in (good, blind):
            save_clip(clip, tmp_path / clip.id)
        write_manifest(tmp_path, [{"id": name, "status": "ok"} for name in "ab"])
        (result,) = evaluate(config(tmp_path, methods=["linear"]))["results"]
        assert [run["pcp"] for run in result["runs"]] == [100, 0]
        assert result["mean"]["pcp"] == 50
        assert "pcp_persons" not in result["mean"]
        assert result["mean"]["mpjpe"]["all"] < 1
        assert sum(gap["hidden"] for gap in result["mean"]["gaps"]) == 4

    def test_the_worst_subset_is_named(self, tmp_path):
        """Cameras 0 and 1 see nothing of person 1, so that two views with one of them lack it."""
        clip = seen()
        xy, detected = clip.detections.xy.copy(), clip.detections.score.copy()
        xy[:, :2, 1], detected[:, :2, 1] = np.nan, np.nan
        save_clip(replace(clip, detections=Detections2D(BODY25, xy, detected)), tmp_path)
        (result,) = evaluate(config(tmp_path, methods=["linear"], views=[3]))["results"]
        assert result["worst"]["pcp"] == 50
        assert result["worst"]["cameras"] in ([0, 1, 2], [0, 1, 3])
        assert result["mean"]["pcp"] == 75

    @pytest.mark.parametrize(
        ("changes", "kind", "message"),
        [
            ({"methods": ["magic"]}, KeyError, "no method 'magic'.*linear.*dmae"),
            ({"methods": ["dmae"]}, ValueError, "needs weights"),
            ({"methods": []}, ValueError, "expected some of"),
            ({"views": [5]}, ValueError, "expected numbers from 2 to 4"),
            ({"views": [1]}, ValueError, "expected numbers from 2 to 4"),
        ],
    )
    def test_what_cannot_be_done_is_said(self, tmp_path, changes, kind, message):
        save_clip(seen(), tmp_path)
        with pytest.raises(kind, match=message):
            evaluate(config(tmp_path, **changes))

    def test_a_clip_without_truth_is_refused(self, tmp_path):
        save_clip(replace(seen(), truth=None), tmp_path)
        with pytest.raises(ValueError, match="'seen' has no truth"):
            evaluate(config(tmp_path, methods=["measured"]))

    def test_an_empty_data_set_is_refused(self, tmp_path):
        write_manifest(tmp_path, [{"id": "a", "status": "failed"}])
        with pytest.raises(ValueError, match="no clip of this data set is ok"):
            evaluate(config(tmp_path))


def test_real_shelf_with_five_cameras(data_folder):
    """The project's headline: strict PCP of linear filling and light smoothing; and the body frame does no worse."""
    data = DataConfig(Format.shelf, str(data_folder / "shelf"))
    results = by_method(evaluate(EvaluateConfig(data=data, methods=["measured", "linear", "bodyframe"])))
    assert results["linear", 5]["mean"]["pcp"] >= 98.0
    assert results["bodyframe", 5]["mean"]["pcp"] >= results["linear", 5]["mean"]["pcp"] - 0.2
    assert results["measured", 5]["mean"]["pcp"] < results["linear", 5]["mean"]["pcp"]
    assert results["linear", 5]["mean"]["identity_switches"] == 0


def test_shelf_s_truth_scores_a_hundred_against_itself(data_folder):
    from dmae.formats.shelf import read_shelf

    truth = read_shelf(data_folder / "shelf").truth
    scores = score(truth, truth, truth, (0, 1, 2))
    assert scores["pcp"] == 100
    assert set(scores["pcp_published"].values()) == {100}
    assert (convert(truth, SHELF14).source == Source.ABSENT).any()
