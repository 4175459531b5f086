"""Errors by length of gap: holes punched in the truth, and holes of fewer cameras."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.clip import Detections2D, Poses3D
from dmae.data import DataConfig, Format
from dmae.draw import gaps_figure
from dmae.evaluate import EvaluateConfig, Hide, Reference, evaluate
from dmae.hiding import HidingConfig
from dmae.skeleton import BODY25
from dmae.store import save_clip, write_manifest
from dmae.tables import tables

from .examples import walkers
from .scored import by_method, config, seen, strolling


class TestHide:
    def test_errors_of_punched_truth(self, tmp_path):
        """The better method is better in every class of gaps, and measured joints of clean truth are true."""
        save_clip(strolling(), tmp_path)
        scores = evaluate(config(tmp_path, methods=["measured", "hold", "pchip_body"], hide=Hide.clean, smooth=0.0))
        assert scores["skeleton"] == "body25"
        results = by_method(scores)
        assert list(results) == [("measured", 0), ("hold", 0), ("pchip_body", 0)]
        hold, body = (results[name, 0]["mean"] for name in ("hold", "pchip_body"))
        for worse, better in zip(hold["gaps"], body["gaps"], strict=True):
            assert better["filled"] == worse["filled"] == better["hidden"] > 100
            assert better["mpjpe"] < 0.5 * worse["mpjpe"]
        assert body["mpjpe"]["measured"] == 0
        assert 10 < body["shares"]["completed"] < 60

    def test_no_number_of_views_is_told(self, tmp_path):
        save_clip(strolling(), tmp_path)
        scores = evaluate(config(tmp_path, methods=["linear"], hide=Hide.clean))
        assert gaps_figure(scores).axes[0].get_title() == "holes in the truth"
        assert tables(scores)[2].rows[0][:2] == ("linear", "-")

    def test_a_seed_is_a_pattern(self, tmp_path):
        for name in "ab":
            save_clip(strolling(name), tmp_path / name)
        write_manifest(tmp_path, [{"id": name, "status": "ok"} for name in "ab"])
        options = {"methods": ["linear"], "hide": Hide.noisy}
        first, again = (evaluate(config(tmp_path, **options)) for _ in range(2))
        assert first == again
        one, other = first["results"][0]["runs"]
        assert one["gaps"] != other["gaps"]
        assert first != evaluate(config(tmp_path, **options, seed=1))

    def test_noise_makes_what_is_seen_wrong_and_what_is_hidden_worse(self, tmp_path):
        save_clip(strolling(), tmp_path)
        clean, noisy = (
            evaluate(config(tmp_path, methods=["pchip_body"], hide=hide, smooth=0.0))["results"][0]["mean"]
            for hide in (Hide.clean, Hide.noisy)
        )
        assert [gap["hidden"] for gap in noisy["gaps"]] == [gap["hidden"] for gap in clean["gaps"]]
        assert 5 < noisy["mpjpe"]["measured"] < 50
        assert noisy["gaps"][0]["mpjpe"] > clean["gaps"][0]["mpjpe"] + 10

    def test_gaps_are_classed_by_time(self, tmp_path):
        """The same people at four times the rate: as many seconds are hidden in each class, about."""
        hidden = []
        for fps, frames in ((25.0, 500), (100.0, 2000), (5.0, 100)):
            save_clip(strolling(f"at{fps:.0f}", frames=frames, fps=fps), tmp_path / f"{fps:.0f}")
            (result,) = evaluate(config(tmp_path / f"{fps:.0f}", methods=["linear"], hide=Hide.clean))["results"]
            hidden.append([gap["hidden"] / fps for gap in result["mean"]["gaps"]])
        np.testing.assert_allclose(hidden[1][1:], hidden[0][1:], rtol=0.3)
        np.testing.assert_allclose(sum(hidden[2]), sum(hidden[0]), rtol=0.3)

    def test_what_is_hidden_is_configured(self, tmp_path):
        save_clip(strolling(), tmp_path)
        hiding = HidingConfig(longest=3, absence=2, bursts=1.0)
        (result,) = evaluate(config(tmp_path, methods=["linear"], hide=Hide.clean, hiding=hiding))["results"]
        short, *longer = result["mean"]["gaps"]
        assert short["hidden"] > 100
        assert sum(gap["hidden"] for gap in longer) == 0

    def test_of_a_fused_truth_the_skeleton_of_the_detections_counts(self, tmp_path):
        save_clip(seen(frames=50), tmp_path)
        assert evaluate(config(tmp_path, methods=["linear"], hide=Hide.clean))["skeleton"] == "body25"

    def test_people_of_whom_little_is_true_are_scored_on_that(self, tmp_path):
        """One there for one frame, one never, one whose hips nobody knows."""
        clip = strolling()
        xyz = clip.truth.xyz.copy()
        xyz[np.arange(250) != 100, 0] = np.nan
        xyz[:, 1] = np.nan
        xyz[:, 2, BODY25.index("mid_hip", "l_hip", "r_hip")] = np.nan
        save_clip(replace(clip, truth=Poses3D(BODY25, xyz)), tmp_path)
        for hide in (Hide.clean, Hide.noisy):
            for result in evaluate(config(tmp_path, hide=hide))["results"]:
                assert result["method"] == "measured" or all(gap["mpjpe"] < 2000 for gap in result["mean"]["gaps"])

    def test_nothing_is_captured(self, tmp_path):
        save_clip(strolling(), tmp_path)
        for change in ({"views": [2]}, {"reference": Reference.capture}):
            with pytest.raises(ValueError, match="hide=clean hides some of the truth and captures nothing"):
                evaluate(config(tmp_path, methods=["linear"], hide=Hide.clean, **change))


class TestReference:
    def test_what_fewer_cameras_miss_is_compared_with_what_all_measured(self, tmp_path):
        """Camera 0 alone lacks the wrist: without two others it is hidden, and all four know where it was."""
        clip = replace(seen(persons=1, frames=40), truth=None)
        xy, sure = clip.detections.xy.copy(), clip.detections.score.copy()
        exact, _ = clip.rig.project(walkers(40, 1).xyz)
        wrist = BODY25.index("l_wrist")[0]
        xy[8:12, :, 0, wrist], sure[8:12, :, 0, wrist] = exact[8:12, :, 0, wrist], 0.9
        xy[10:20, 0, 0, wrist], sure[10:20, 0, 0, wrist] = np.nan, np.nan
        save_clip(replace(clip, detections=Detections2D(BODY25, xy, sure)), tmp_path)
        results = evaluate(
            config(tmp_path, methods=["hold", "linear"], views=[2], reference=Reference.capture, smooth=0.0)
        )
        assert results["skeleton"] == "body25"
        hold, linear = results["results"]
        # Of the six pairs three have camera 0.
        for result, error in ((hold, 220), (linear, 0)):
            gaps = result["mean"]["gaps"]
            assert [gap["hidden"] for gap in gaps] == [0, 30, 0, 0]
            assert gaps[1]["mpjpe"] == pytest.approx(error, abs=2)

    def test_joints_measured_by_two_cameras_only_are_not_taken_for_true(self, tmp_path):
        clip = seen(persons=1, frames=40)
        xy, sure = clip.detections.xy.copy(), clip.detections.score.copy()
        ear = BODY25.index("l_ear")[0]
        xy[5:30, :2, 0, ear], sure[5:30, :2, 0, ear] = np.nan, np.nan
        save_clip(replace(clip, detections=Detections2D(BODY25, xy, sure)), tmp_path)
        (result,) = evaluate(config(tmp_path, methods=["linear"], views=[2], reference=Reference.capture))["results"]
        assert sum(gap["hidden"] for gap in result["mean"]["gaps"]) == 0

    @pytest.mark.parametrize("views", [[], [4], [3, 4]])
    def test_fewer_cameras_are_asked_for(self, tmp_path, views):
        save_clip(seen(), tmp_path)
        with pytest.raises(ValueError, match=r"expected views=\[3\] or less, found"):
            evaluate(config(tmp_path, methods=["linear"], views=views, reference=Reference.capture))


def test_real_gaps_of_three_cameras_against_what_five_measured(data_folder):
    """Offsets in the body's frame beat straight lines in the world where holes are long, and only there."""
    data = DataConfig(Format.shelf, str(data_folder / "shelf"), cameras=[0, 1, 3, 4])
    options = {"methods": ["linear", "linear_body", "pchip_body"], "views": [3], "reference": Reference.capture}
    results = by_method(evaluate(EvaluateConfig(data=data, **options, smooth=0.0)))
    lines, *body = (results[name, 3]["mean"]["gaps"] for name in options["methods"])
    for gaps in body:
        assert [gap["filled"] for gap in gaps] == [gap["filled"] for gap in lines]
        assert min(gap["filled"] for gap in gaps) > 100
        assert gaps[2]["mpjpe"] < 0.9 * lines[2]["mpjpe"]
