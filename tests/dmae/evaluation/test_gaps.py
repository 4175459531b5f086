"""Errors by length of gap: synthetic gaps in the truth, and the gaps of fewer cameras."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Detections2D, Poses3D
from dmae.data.skeleton import BODY25
from dmae.data.store import save_clip, write_manifest
from dmae.evaluation.config import EvaluateConfig, Input, ReferencePoses
from dmae.evaluation.evaluate import evaluate
from dmae.formats.reading import DataConfig
from dmae.metrics.score_tables import score_tables
from dmae.reporting.figures import gaps_figure
from tests.support.clips import walkers
from tests.support.scored_clips import by_method, circling, config, seen


class TestSyntheticGaps:
    def test_errors_of_true_poses(self, tmp_path):
        """The better method is better in every class of gaps, and measured joints of true poses are exact."""
        save_clip(circling(), tmp_path)
        scores = evaluate(
            config(tmp_path, methods=["measured", "hold", "pchip_body"], input=Input.true_poses, smooth=0.0)
        )
        assert scores["skeleton"] == "body25"
        results = by_method(scores)
        assert list(results) == [("measured", 0), ("hold", 0), ("pchip_body", 0)]
        hold, body = (results[name, 0]["mean"] for name in ("hold", "pchip_body"))
        for worse, better in zip(hold["gaps"], body["gaps"], strict=True):
            assert better["filled"] == worse["filled"] == better["hidden"] > 100
            assert better["mpjpe"] < 0.5 * worse["mpjpe"]
        assert body["mpjpe"]["measured"] == 0
        assert 10 < body["shares"]["completed"] < 60

    def test_no_number_of_views_is_given(self, tmp_path):
        save_clip(circling(), tmp_path)
        scores = evaluate(config(tmp_path, methods=["linear"], input=Input.true_poses))
        assert gaps_figure(scores).axes[0].get_title() == "synthetic gaps"
        assert score_tables(scores)[3].rows[0][:2] == ("linear", "-")

    def test_gaps_depend_on_seed_and_clip(self, tmp_path):
        for name in "ab":
            save_clip(circling(name), tmp_path / name)
        write_manifest(tmp_path, [{"id": name, "status": "ok"} for name in "ab"])
        options = {"methods": ["linear"], "input": Input.perturbed_poses}
        first, again = (evaluate(config(tmp_path, **options)) for _ in range(2))
        assert first == again
        one, other = first["results"][0]["runs"]
        assert one["gaps"] != other["gaps"]
        assert first != evaluate(config(tmp_path, **options, seed=1))

    def test_perturbation_moves_measured_joints_and_makes_completed_ones_worse(self, tmp_path):
        save_clip(circling(), tmp_path)
        exact, perturbed = (
            evaluate(config(tmp_path, methods=["pchip_body"], input=poses, smooth=0.0))["results"][0]["mean"]
            for poses in (Input.true_poses, Input.perturbed_poses)
        )
        assert [gap["hidden"] for gap in perturbed["gaps"]] == [gap["hidden"] for gap in exact["gaps"]]
        assert 5 < perturbed["mpjpe"]["measured"] < 50
        assert perturbed["gaps"][0]["mpjpe"] > exact["gaps"][0]["mpjpe"] + 10

    def test_gaps_are_classed_by_time(self, tmp_path):
        """The same people at four times the rate: as many seconds are hidden in each class, about."""
        hidden = []
        for fps, frames in ((25.0, 500), (100.0, 2000), (5.0, 100)):
            save_clip(circling(f"at{fps:.0f}", frames=frames, fps=fps), tmp_path / f"{fps:.0f}")
            (result,) = evaluate(config(tmp_path / f"{fps:.0f}", methods=["linear"], input=Input.true_poses))["results"]
            hidden.append([gap["hidden"] / fps for gap in result["mean"]["gaps"]])
        np.testing.assert_allclose(hidden[1][1:], hidden[0][1:], rtol=0.3)
        np.testing.assert_allclose(sum(hidden[2]), sum(hidden[0]), rtol=0.3)

    def test_a_fused_truth_is_compared_on_the_skeleton_of_the_detections(self, tmp_path):
        save_clip(seen(frames=50), tmp_path)
        assert evaluate(config(tmp_path, methods=["linear"], input=Input.true_poses))["skeleton"] == "body25"

    def test_persons_with_little_truth_are_scored_on_that(self, tmp_path):
        """One person present in one frame, one in none, one without known hips."""
        clip = circling()
        xyz = clip.truth.xyz.copy()
        xyz[np.arange(250) != 100, 0] = np.nan
        xyz[:, 1] = np.nan
        xyz[:, 2, BODY25.index("mid_hip", "l_hip", "r_hip")] = np.nan
        save_clip(replace(clip, truth=Poses3D(BODY25, xyz)), tmp_path)
        for poses in (Input.true_poses, Input.perturbed_poses):
            for result in evaluate(config(tmp_path, input=poses))["results"]:
                assert result["method"] == "measured" or all(gap["mpjpe"] < 2000 for gap in result["mean"]["gaps"])

    def test_options_of_capture_are_refused(self, tmp_path):
        save_clip(circling(), tmp_path)
        for change in ({"views": [2]}, {"reference": ReferencePoses.capture}):
            with pytest.raises(ValueError, match="input=true_poses: nothing is captured"):
                evaluate(config(tmp_path, methods=["linear"], input=Input.true_poses, **change))


class TestReference:
    def test_joints_that_fewer_cameras_miss_are_compared_with_what_all_measured(self, tmp_path):
        """Only camera 0 misses the wrist: pairs with it lack the wrist, all four cameras measure it."""
        clip = replace(seen(persons=1, frames=40), truth=None)
        xy, sure = clip.detections.xy.copy(), clip.detections.score.copy()
        exact, _ = clip.rig.project(walkers(40, 1).xyz)
        wrist = BODY25.index("l_wrist")[0]
        xy[8:12, :, 0, wrist], sure[8:12, :, 0, wrist] = exact[8:12, :, 0, wrist], 0.9
        xy[10:20, 0, 0, wrist], sure[10:20, 0, 0, wrist] = np.nan, np.nan
        save_clip(replace(clip, detections=Detections2D(BODY25, xy, sure)), tmp_path)
        results = evaluate(
            config(tmp_path, methods=["hold", "linear"], views=[2], reference=ReferencePoses.capture, smooth=0.0)
        )
        assert results["skeleton"] == "body25"
        hold, linear = results["results"]
        # Of the six pairs three have camera 0.
        for result, error in ((hold, 220), (linear, 0)):
            gaps = result["mean"]["gaps"]
            assert [gap["hidden"] for gap in gaps] == [0, 30, 0, 0]
            assert gaps[1]["mpjpe"] == pytest.approx(error, abs=2)

    def test_joints_measured_by_two_cameras_only_are_not_true(self, tmp_path):
        clip = seen(persons=1, frames=40)
        xy, sure = clip.detections.xy.copy(), clip.detections.score.copy()
        ear = BODY25.index("l_ear")[0]
        xy[5:30, :2, 0, ear], sure[5:30, :2, 0, ear] = np.nan, np.nan
        save_clip(replace(clip, detections=Detections2D(BODY25, xy, sure)), tmp_path)
        (result,) = evaluate(config(tmp_path, methods=["linear"], views=[2], reference=ReferencePoses.capture))[
            "results"
        ]
        assert sum(gap["hidden"] for gap in result["mean"]["gaps"]) == 0

    @pytest.mark.parametrize("views", [[], [4], [3, 4]])
    def test_reference_capture_needs_fewer_views_than_cameras(self, tmp_path, views):
        save_clip(seen(), tmp_path)
        with pytest.raises(ValueError, match=r"expected views=\[3\] or less, found"):
            evaluate(config(tmp_path, methods=["linear"], views=views, reference=ReferencePoses.capture))


@pytest.mark.slow
def test_body_frame_beats_straight_lines_in_long_real_gaps(data_folder):
    """Offsets in the body's frame beat straight lines in the world in long gaps."""
    data = DataConfig("shelf", str(data_folder / "shelf"), cameras=[0, 1, 3, 4])
    options = {"methods": ["linear", "linear_body", "pchip_body"], "views": [3], "reference": ReferencePoses.capture}
    results = by_method(evaluate(EvaluateConfig(data=data, **options, smooth=0.0)))
    lines, *body = (results[name, 3]["mean"]["gaps"] for name in options["methods"])
    for gaps in body:
        assert [gap["filled"] for gap in gaps] == [gap["filled"] for gap in lines]
        assert min(gap["filled"] for gap in gaps) > 100
        assert gaps[2]["mpjpe"] < 0.9 * lines[2]["mpjpe"]
