import json
from dataclasses import replace

import numpy as np
import pytest

from dmae.commands import evaluate as command
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import BODY25
from dmae.data.store import save_clip, write_manifest
from dmae.evaluation.config import EvaluateConfig
from dmae.evaluation.evaluate import evaluate
from dmae.evaluation.scores import figure_score, run_table
from dmae.formats.own import export_npz
from dmae.formats.reading import Clips, DataConfig
from tests.support.animals import dog_clip
from tests.support.scored_clips import by_method, config, seen
from tests.support.untrained_methods import UNTRAINED


def of_poses(poses):
    """A method without the frame rate."""
    return poses


@pytest.mark.parametrize(
    "options", [{"methods": ["measured"], "views": [4, 3]}, {"methods": None}, {"poses": "poses.npz"}]
)
def test_a_clip_is_read_once(tmp_path, monkeypatch, options):
    """Reading takes longer than scoring where a folder holds a file for each frame."""
    save_clip(seen(), tmp_path / "clip")
    export_npz(seen().truth, seen().fps, tmp_path / "poses.npz")
    monkeypatch.chdir(tmp_path)
    reads, read = [], Clips.__getitem__

    def counted(clips, index):
        found = read(clips, index)
        reads.extend([found] if isinstance(found, Clip) else [])
        return found

    monkeypatch.setattr(Clips, "__getitem__", counted)
    evaluate(config(tmp_path / "clip", **options))
    assert len(reads) == 1


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
        assert results["measured", 4]["mean"]["shares"]["denoised"] == 0
        # Exact poses are not smoothed: measured joints stay measured.
        assert results["linear", 4]["mean"]["shares"]["denoised"] == 0
        assert results["linear", 4]["mean"]["mpjpe"]["measured"] < 1

    def test_sums_over_time_give_the_scores_and_their_intervals(self, tmp_path):
        shaken = np.random.default_rng(0).normal(0, 3, (2, 150, 4, 2, 25, 2))
        for number, name in enumerate("ab"):
            clip = seen(frames=150, name=name)
            xy = clip.detections.xy + shaken[number]
            save_clip(replace(clip, detections=replace(clip.detections, xy=xy)), tmp_path / name)
        write_manifest(tmp_path, [{"id": name, "status": "ok"} for name in "ab"])
        for result in evaluate(config(tmp_path, methods=["linear"], views=[4, 3]))["results"]:
            means = {"pcp": result["mean"]["pcp"], "mpjpe": result["mean"]["mpjpe"]["all"]}
            for figure, mean in (means | {"hidden": result["mean"]["hidden"]["mpjpe"]}).items():
                found = figure_score(run_table(result["runs"]), figure)
                assert found.value == pytest.approx(mean, abs=0.02)
                assert [*found.interval] == result["intervals"][figure]
                assert found.interval[0] <= mean <= found.interval[1]

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

    def test_the_worst_subset_is_named(self, tmp_path, capsys):
        """Cameras 0 and 1 see nothing of person 1, so that two views with one of them lack it.

        A second session lists its cameras in another order.
        """
        clip = seen()
        xy, detected = clip.detections.xy.copy(), clip.detections.score.copy()
        xy[:, :2, 1], detected[:, :2, 1] = np.nan, np.nan
        clip = replace(clip, detections=Detections2D(BODY25, xy, detected))
        save_clip(clip, tmp_path / "a")
        save_clip(clip.select(views=[2, 3, 0, 1]), tmp_path / "b")
        write_manifest(tmp_path, [{"id": name, "status": "ok"} for name in "ab"])
        command.run(config(tmp_path, methods=["linear"], views=[3]), tmp_path)
        (result,) = json.loads((tmp_path / "scores.json").read_text())["results"]
        named = [f"cam{camera}" for camera in result["worst"]["cameras"]]
        assert f"linear, 3 views: worst with {', '.join(named)}\n" in capsys.readouterr().out
        assert result["worst"]["pcp"] == 50
        assert result["worst"]["cameras"] in ([0, 1, 2], [0, 1, 3])
        assert result["mean"]["pcp"] == 75

    def test_poses_are_compared_on_the_skeleton_asked_for(self, tmp_path):
        save_clip(seen(), tmp_path)
        scores = evaluate(config(tmp_path, methods=["linear"], skeleton="body25"))
        assert scores["skeleton"] == "body25"
        assert scores["results"][0]["mean"]["mpjpe"]["all"] < 1
        with pytest.raises(KeyError, match="stickman"):
            evaluate(config(tmp_path, methods=["linear"], skeleton="stickman"))

    @pytest.mark.parametrize(
        ("changes", "kind", "message"),
        [
            ({"methods": ["paper"]}, ValueError, r"methods=\[dmae\] weights=paper capture=paper scores it"),
            ({"methods": ["magic"]}, ValueError, "no completion method 'magic'.*dmae.*linear"),
            (
                {"methods": ["dmae"], "weights": "nowhere"},
                FileNotFoundError,
                "nowhere: expected a folder that `dmae train`",
            ),
            ({"methods": []}, ValueError, "expected some of"),
            (
                {"methods": [f"{__name__}:of_poses"]},
                ValueError,
                "method .*:of_poses: expected a function of poses and their frames per second",
            ),
            ({"views": [5]}, ValueError, "expected numbers from 2 to 4"),
            ({"views": [1]}, ValueError, "expected numbers from 2 to 4"),
            ({"skeleton": "body25", "input": "true_poses"}, ValueError, "skeleton=body25: with input"),
        ],
    )
    def test_impossible_options_are_refused(self, tmp_path, changes, kind, message):
        save_clip(seen(), tmp_path)
        with pytest.raises(kind, match=message):
            evaluate(config(tmp_path, **changes))

    def test_a_clip_without_truth_is_refused(self, tmp_path):
        save_clip(replace(seen(), truth=None), tmp_path)
        with pytest.raises(ValueError, match="'seen' has no truth"):
            evaluate(config(tmp_path, methods=["measured"]))

    def test_frames_without_any_truth_are_refused(self, tmp_path):
        clip = seen()
        nowhere = replace(clip.truth, xyz=np.full_like(clip.truth.xyz, np.nan), source=np.zeros_like(clip.truth.source))
        save_clip(replace(clip, truth=nowhere), tmp_path)
        with pytest.raises(ValueError, match=r"no true joint in its \d+ frames, .* data.frames=.* or frames="):
            evaluate(config(tmp_path, methods=["measured"]))

    def test_infinite_truth_is_refused(self, tmp_path):
        clip = seen()
        xyz = clip.truth.xyz.copy()
        xyz[3, 0, 5] = np.inf
        with pytest.raises(ValueError, match=r"truth\.xyz, m: .* found inf"):
            save_clip(replace(clip, truth=Poses3D(clip.truth.skeleton, xyz)), tmp_path)

    def test_an_empty_data_set_is_refused(self, tmp_path):
        write_manifest(tmp_path, [{"id": "a", "status": "failed"}])
        with pytest.raises(ValueError, match="no clip of this data set is ok"):
            evaluate(config(tmp_path))


@pytest.mark.parametrize("fps", [5.0, 240.0])
def test_clips_at_any_rate_are_scored_by_every_baseline(tmp_path, fps):
    save_clip(replace(seen(frames=40), fps=fps), tmp_path)
    results = by_method(evaluate(config(tmp_path, methods=list(UNTRAINED))))
    assert {method for method, _ in results} == set(UNTRAINED)
    assert results["linear", 4]["mean"]["pcp"] == 100


def test_methods_are_compared_on_joints_that_all_of_them_filled(tmp_path):
    """A wrist measured in the first second only: baselines hold it for half a second more."""
    clip = seen(persons=1, frames=75)
    xy, sure = clip.detections.xy.copy(), clip.detections.score.copy()
    wrist = BODY25.index("l_wrist")[0]
    xy[25:, :, 0, wrist], sure[25:, :, 0, wrist] = np.nan, np.nan
    save_clip(replace(clip, detections=Detections2D(BODY25, xy, sure)), tmp_path)
    results = by_method(evaluate(config(tmp_path, methods=["measured", "hold", "linear"])))
    long = results["hold", 4]["mean"]["gaps"][3]
    assert (long["hidden"], long["filled"]) == (50, 12)
    assert results["measured", 4]["mean"]["gaps"][3]["filled"] == 0


def test_bodies_that_no_weights_know_are_scored_by_default_without_a_network(tmp_path, capsys):
    save_clip(dog_clip(40), tmp_path / "dog")
    command.run(config(tmp_path / "dog"), tmp_path)
    scores = json.loads((tmp_path / "scores.json").read_text())
    assert [each["method"] for each in scores["results"]] == ["measured", "linear", "gaussian_process"]
    assert "dmae_denoise is not scored: its weights know people, and nothing of dog19" in capsys.readouterr().out
    with pytest.raises(ValueError, match="the weights of this package know people"):
        evaluate(config(tmp_path / "dog", methods=["dmae_denoise"]))


def test_real_shelf_with_five_cameras(data_folder):
    """The project's headline: strict PCP of linear filling and light smoothing; and the body frame does no worse."""
    data = DataConfig("shelf", str(data_folder / "shelf"))
    results = by_method(evaluate(EvaluateConfig(data=data, methods=["measured", "linear", "pchip_body"])))
    assert results["linear", 5]["mean"]["pcp"] >= 98.0
    assert results["pchip_body", 5]["mean"]["pcp"] >= results["linear", 5]["mean"]["pcp"] - 0.2
    assert results["measured", 5]["mean"]["pcp"] < results["linear", 5]["mean"]["pcp"]
    assert results["linear", 5]["mean"]["identity_switches"] == 0
