"""Recordings side by side, and detectors fitted to them, on simulated clips whose detector is known."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from dmae.store import save_clip
from synth.compare import CompareConfig, compare, measure_all, pool, read_recording, run_compare
from synth.failures import measure
from synth.fit import distance, fit, redetect
from synth.generate import GenerateConfig, generate_clip
from synth.mistakes import DetectorConfig, PartConfig, PartsConfig
from synth.preset import FitDetectorConfig, run_fit_detector
from synth.spec import SceneConfig

from .detecting import preset
from .test_rigs import config as rig_config


def worse(config: DetectorConfig) -> DetectorConfig:
    """Twice the noise, more misses, more ghosts, as sure of itself."""
    parts = {
        kind: replace(part, noise=2 * part.noise, miss=[min(1.6 * share + 0.06, 0.95) for share in part.miss])
        for kind, part in vars(config.parts).items()
    }
    return replace(config, parts=PartsConfig(**parts), ghosts=2 * config.ghosts)


@pytest.fixture(scope="module")
def clips():
    """Two clips of two people in five views, as OpenPose sees them."""
    config = GenerateConfig(
        scene=SceneConfig(persons=[2, 2], seconds=4.0, radius=1.2),
        rig=rig_config("shelf"),
        detector=preset("shelf_openpose"),
    )
    return [generate_clip(config, index) for index in range(2)]


@pytest.fixture(scope="module")
def measured(clips):
    return measure_all(clips, len(clips))


def test_a_recording_is_like_itself(measured):
    rows = compare(measured, measured, CompareConfig())
    assert not any(row.exceeded for row in rows)
    assert all(row.off == 0 or np.isnan(row.off) for row in rows)


def test_another_detector_is_told_by_what_it_does(clips, measured):
    other = measure_all([redetect(clip, worse(preset("shelf_openpose")), seed=1) for clip in clips], len(clips))
    exceeded = {row.what for row in compare(measured, other, CompareConfig()) if row.exceeded}
    assert {"distribution of error", "missed: elbow", "missed: knee"} <= exceeded
    assert any(what.startswith("median error at confidence") for what in exceeded)


def test_recordings_of_other_cameras_are_compared_but_for_their_views(clips, measured):
    fewer = measure_all([clip.select(views=[0, 2, 3, 4]) for clip in clips], len(clips))
    rows = {row.what for row in compare(measured, fewer, CompareConfig())}
    views = {what for what in (row.what for row in compare(measured, measured, CompareConfig())) if what not in rows}
    assert {"views that detect: wrist", "missed in view 0"} <= views
    assert {"missed: wrist", "missed on the far side: wrist"} <= rows


def test_pooling_counts_samples_and_weighs_shares(clips):
    parts = [measure(clip) for clip in clips]
    both = pool(parts, [1, 3])
    assert len(both.error) == sum(len(part.error) for part in parts)
    np.testing.assert_allclose(both.missed, (parts[0].missed + 3 * parts[1].missed) / 4)
    with pytest.raises(ValueError, match="cannot be measured as one"):
        pool([parts[0], measure(clips[1].select(views=[0, 1, 2]))], [1, 1])


def test_a_page_is_written_and_the_exit_status_tells(clips, tmp_path, capsys):
    save_clip(clips[0], tmp_path / "real")
    save_clip(clips[0], tmp_path / "same")
    save_clip(redetect(clips[0], worse(preset("shelf_openpose")), seed=1), tmp_path / "other")
    config = CompareConfig(real=str(tmp_path / "real"), sim=str(tmp_path / "same"))
    run_compare(config, tmp_path / "out")
    assert "distribution of error" in capsys.readouterr().out
    assert (tmp_path / "out" / "compare.html").stat().st_size > 50_000
    with pytest.raises(SystemExit, match=r"distances are exceeded: .*distribution of error"):
        run_compare(replace(config, sim=str(tmp_path / "other")), tmp_path / "out")


def test_stretches_of_a_recording(clips, tmp_path):
    save_clip(clips[0], tmp_path)
    assert len(read_recording(tmp_path, frames=[10, 40])) == 30
    with pytest.raises(ValueError, match=r"frames=\[10, 1000\]: expected \[first, end\] within the 100 frames"):
        read_recording(tmp_path, frames=[10, 1000])


@pytest.mark.slow
def test_a_fit_finds_the_detector_back(clips, measured):
    """Begun from a detector twice as bad, on clips that it shares with the recording but whose luck it does not."""
    found = fit(measured, clips, worse(preset("shelf_openpose")), rounds=5, seed=7)
    before = measure_all([redetect(clip, worse(preset("shelf_openpose")), seed=7) for clip in clips], len(clips))
    assert distance(measured, found.failures) < distance(measured, before) / 2
    exceeded = [
        sum(row.exceeded for row in compare(measured, other, CompareConfig())) for other in (before, found.failures)
    ]
    assert exceeded[1] < exceeded[0]


def test_too_little_leaves_parameters_as_they_are(clips):
    short = clips[0].select(frames=slice(0, 8))
    found = fit(measure(short), [short], preset("shelf_openpose"), rounds=1)
    assert "parts.ear" in found.undetermined
    assert "are needed" in found.undetermined["parts.ear"]
    assert found.config.parts.ear == preset("shelf_openpose").parts.ear


def test_a_preset_is_written_and_read_back(clips, tmp_path, capsys):
    save_clip(clips[0], tmp_path / "real")
    save_clip(clips[1], tmp_path / "sim" / "000001")
    (tmp_path / "sim" / "manifest.jsonl").write_text('{"id": "000001", "status": "ok", "seed": 0}\n')
    config = FitDetectorConfig(
        detections=str(tmp_path / "real"),
        clips=str(tmp_path / "sim"),
        detector=preset("shelf_openpose"),
        rounds=1,
        name="mine",
    )
    run_fit_detector(config, tmp_path / "out")
    assert str(tmp_path / "out" / "detector" / "mine.yaml") in capsys.readouterr().out
    values = yaml.safe_load((tmp_path / "out" / "detector" / "mine.yaml").read_text())
    parts = {kind: PartConfig(**part) for kind, part in values.pop("parts").items()}
    assert DetectorConfig(parts=PartsConfig(**parts), **values).name == "mine"
    assert (tmp_path / "out" / "compare.html").is_file()


def test_a_detector_is_fitted_on_simulated_clips(clips, measured):
    with pytest.raises(ValueError, match="it has no visibility"):
        fit(measured, [replace(clips[0], visibility=None, hidden_by=None)], preset("shelf_openpose"))
