"""Comparison of recordings, and detectors fitted to them, on simulated clips of a known detector."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

import synth
from dmae.data.conversion import convert_detections
from dmae.data.skeleton import get_skeleton
from dmae.data.store import save_clip
from dmae.data.typed import decode
from synth.commands import compare as compare_command
from synth.commands import fit_detector as fit_command
from synth.commands.config import CompareCommand, FitDetectorCommand
from synth.datasets.clip import generate_clip
from synth.datasets.config import GenerateConfig
from synth.detector.comparison import compare
from synth.detector.config import DetectorConfig, Limits
from synth.detector.fitting import distance, fit, redetect
from synth.detector.parts import PartConfig, PartsConfig
from synth.detector.statistics import measure, measure_all, pool, read_recording
from synth.scene.config import SceneConfig
from tests.support.detectors import changed, preset
from tests.support.rigs import config as rig_config

pytestmark = pytest.mark.slow


def worse(config: DetectorConfig) -> DetectorConfig:
    """Return a detector of twice the noise, more misses and more ghosts, and the same confidence."""
    parts = {
        kind: replace(part, noise=2 * part.noise, miss=[min(1.6 * share + 0.06, 0.95) for share in part.miss])
        for kind, part in vars(config.parts).items()
    }
    return changed(replace(config, parts=PartsConfig(**parts)), {"ghosts.count": 2 * config.ghosts.count})


@pytest.fixture(scope="module")
def clips():
    """Return two clips of two people in five views, with the detections of OpenPose."""
    config = GenerateConfig(
        scene=SceneConfig(persons=[2, 2], seconds=4.0, radius=1.2),
        rig=rig_config("shelf"),
        detector=preset("shelf_openpose"),
    )
    return [generate_clip(config, index) for index in range(2)]


@pytest.fixture(scope="module")
def parts(clips):
    """Return the statistics of each clip."""
    return [measure(clip) for clip in clips]


@pytest.fixture(scope="module")
def measured(clips, parts):
    """Return the statistics of both clips."""
    return pool(parts, [len(clip) for clip in clips])


@pytest.fixture(scope="module")
def fewer(clips):
    """Return the statistics of the second clip in three of its views."""
    return measure(clips[1].select(views=[0, 1, 2]))


@pytest.fixture(scope="module")
def fitted(clips, measured):
    """Return a fit that starts at a detector twice as bad, on the clips of the recording with another seed of the
    detector; and the statistics of the detector that it starts at.
    """
    simulated = []

    def noted(*given):
        simulated.append(measure_all(*given))
        return simulated[-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("synth.detector.fitting.measure_all", noted)
        found = fit(measured, clips, worse(preset("shelf_openpose")), rounds=2, seed=7)
    return found, simulated[0]


def test_a_recording_equals_itself(measured):
    rows = compare(measured, measured, Limits())
    assert not any(row.exceeded for row in rows)
    assert all(row.distance == 0 or np.isnan(row.distance) for row in rows)


def test_another_detector_exceeds_the_limits(fitted, measured):
    _, other = fitted
    exceeded = {row.what for row in compare(measured, other, Limits()) if row.exceeded}
    assert {"distribution of error", "missed: elbow", "missed: knee"} <= exceeded
    assert any(what.startswith("median error at confidence") for what in exceeded)


def test_neighbours_of_few_missed_joints_have_no_limit(measured):
    few = replace(measured, miss_seconds=measured.miss_seconds[:99])
    rows = [row for row in compare(few, measured, Limits()) if row.what.startswith("missed together")]
    assert [row.allowed for row in rows] == [None] * 4
    rows = [row for row in compare(measured, measured, Limits()) if row.what.startswith("missed together")]
    assert [row.allowed for row in rows] == [Limits().joint_miss] * 4


def test_recordings_of_other_cameras_are_compared_without_their_views(fewer, measured):
    rows = {row.what for row in compare(measured, fewer, Limits())}
    views = {what for what in (row.what for row in compare(measured, measured, Limits())) if what not in rows}
    assert {"views that detect: wrist", "missed in view 0"} <= views
    assert {"missed: wrist", "missed on the far side: wrist"} <= rows


def test_pooling_concatenates_samples_and_averages_fractions(clips, parts):
    both = pool(parts, [1, 3])
    assert len(both.error) == sum(len(part.error) for part in parts)
    np.testing.assert_allclose(both.missed, (parts[0].missed + 3 * parts[1].missed) / 4)
    with pytest.raises(ValueError, match="cannot be measured as one"):
        pool([parts[0], replace(parts[1], kinds=parts[1].kinds[:-1])], [1, 1])


def test_shares_of_different_numbers_of_cameras_are_pooled_over_cameras(fewer, parts):
    both = pool([parts[0], fewer], [1, 1])
    np.testing.assert_allclose(both.ghosts, [(parts[0].ghosts.mean() + fewer.ghosts.mean()) / 2])
    assert len(both.error) == len(parts[0].error) + len(fewer.error)
    assert both.views.size == 0


@pytest.mark.slow
def test_a_page_is_written_and_the_exit_status_says_if_limits_are_exceeded(clips, tmp_path, capsys):
    clip = clips[0].select(frames=slice(0, 30))
    save_clip(clip, tmp_path / "real")
    save_clip(clip, tmp_path / "same")
    save_clip(redetect(clip, worse(preset("shelf_openpose")), seed=1), tmp_path / "other")
    config = CompareCommand(real=str(tmp_path / "real"), sim=str(tmp_path / "same"))
    compare_command.run(config, tmp_path / "out")
    assert "distribution of error" in capsys.readouterr().out
    assert (tmp_path / "out" / "compare.html").stat().st_size > 50_000
    with pytest.raises(SystemExit, match=r"limits are exceeded: .*distribution of error"):
        compare_command.run(replace(config, sim=str(tmp_path / "other")), tmp_path / "out")


def test_frames_of_a_recording(clips, tmp_path):
    save_clip(clips[0], tmp_path)
    assert len(read_recording(tmp_path, frames=[10, 40])) == 30
    with pytest.raises(ValueError, match=r"frames=\[10, 1000\]: expected \[first, end\] within the 100 frames"):
        read_recording(tmp_path, frames=[10, 1000])


@pytest.mark.slow
def test_a_fit_recovers_the_detector(fitted, measured):
    found, before = fitted
    assert distance(measured, found.statistics) < distance(measured, before) / 2
    exceeded = [sum(row.exceeded for row in compare(measured, other, Limits())) for other in (before, found.statistics)]
    assert exceeded[1] < exceeded[0]


@pytest.mark.parametrize(("skeleton", "lacking"), [("body25b", set()), ("coco17", {"big_toe", "small_toe", "heel"})])
def test_a_detector_of_another_skeleton_is_fitted_on_the_joints_it_has(clips, skeleton, lacking):
    real = clips[0].select(frames=slice(0, 50))
    other = replace(real, detections=convert_detections(real.detections, get_skeleton(skeleton)), detection_labels=None)
    start = worse(preset("shelf_openpose"))
    found = synth.fit_detector(other, [clips[1]], start=start, rounds=2)
    assert {name for name in found.undetermined if name.startswith("parts.")} == {f"parts.{kind}" for kind in lacking}
    for kind in lacking:
        assert getattr(found.config.parts, kind) == getattr(start.parts, kind)
    assert found.config.parts.wrist.noise < start.parts.wrist.noise
    compared = {row.what for row in synth.compare(other, [clips[1]]) if row.what.startswith(("missed: ", "views that"))}
    kinds = {row.what for row in synth.compare(real, [clips[1]]) if row.what.startswith(("missed: ", "views that"))}
    assert compared == {what for what in kinds if what.partition(": ")[2] not in lacking}


def test_parameters_without_enough_joints_are_kept(clips):
    short = clips[0].select(frames=slice(0, 8))
    found = fit(measure(short), [short], preset("shelf_openpose"), rounds=1)
    assert "parts.ear" in found.undetermined
    assert "are needed" in found.undetermined["parts.ear"]
    assert found.config.parts.ear == preset("shelf_openpose").parts.ear


def test_confidence_of_ghosts_is_kept_where_the_simulation_has_none(clips, measured, monkeypatch):
    none = replace(measured, ghosts=0 * measured.ghosts, ghost_joints=np.nan, ghost_score=np.nan)
    monkeypatch.setattr("synth.detector.fitting.measure_all", lambda *_: none)
    found = fit(measured, clips, preset("shelf_openpose"), rounds=2)
    assert np.nansum(measured.ghosts) > 0 and "ghosts.score" not in found.undetermined
    assert found.config.ghosts == preset("shelf_openpose").ghosts


def test_a_preset_is_written_and_read_back(clips, tmp_path, capsys):
    real, other = (clip.select(frames=slice(0, 50)) for clip in clips)
    save_clip(real, tmp_path / "real")
    save_clip(other, tmp_path / "sim" / "000001")
    (tmp_path / "sim" / "manifest.jsonl").write_text('{"id": "000001", "status": "ok", "seed": 0}\n')
    config = FitDetectorCommand(
        detections=str(tmp_path / "real"),
        clips=str(tmp_path / "sim"),
        detector=preset("shelf_openpose"),
        rounds=1,
        name="mine",
    )
    fit_command.run(config, tmp_path / "out")
    assert str(tmp_path / "out" / "detector" / "mine.yaml") in capsys.readouterr().out
    values = yaml.safe_load((tmp_path / "out" / "detector" / "mine.yaml").read_text())
    written = decode(DetectorConfig, values)
    assert written.name == "mine"
    assert written.parts.ear != PartConfig()
    assert written.misses.limb_correlation > 0
    assert (tmp_path / "out" / "compare.html").is_file()


def test_a_detector_is_fitted_on_simulated_clips(clips, measured):
    with pytest.raises(ValueError, match="it has no visibility"):
        fit(measured, [replace(clips[0], occlusion=None)], preset("shelf_openpose"))
