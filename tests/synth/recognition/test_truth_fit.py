"""A planted detector is found again from its detections and the truth."""

import json
from dataclasses import replace

import numpy as np
import pytest

import synth
from dmae.data.clip import Clip
from dmae.data.labels import OcclusionLabels, Visibility
from dmae.data.resources import read_preset
from dmae.data.rng import Stream, generator
from dmae.data.store import save_clip
from synth.commands.config import FitDetectorCommand
from synth.commands.fit_detector import run
from synth.detector.config import DetectorConfig, ErrorReference
from synth.detector.errors_of_joints import Misses
from synth.detector.parts import PartConfig, PartsConfig
from synth.detector.simulated_detector import detect
from synth.detector.statistics import measure
from synth.recognition.truth_fit import distances, fit_to_truth
from tests.support.circling_people import circling_people
from tests.support.clips import looking_at_origin

PLANTED = replace(
    DetectorConfig(),
    parts=PartsConfig(
        *[
            PartConfig(
                noise=0.012,
                tail=4,
                score=[18, 3],
                miss=[0.0] * 4,
                hidden_noise=0.04,
                hidden_tail=2,
                hidden_score=[4, 4],
                covered_noise=0.08,
                covered_tail=3,
                covered_score=[3, 9],
            )
        ]
        * 14
    ),
    misses=Misses(person=0.01, hidden_person=0.99, lost_from=0.6, steepness=8.0),
)
START = replace(DetectorConfig(), parts=PartsConfig(*[PartConfig(noise=0.005, score=[30, 2], miss=[0.05] * 4)] * 14))


def clip(number: int) -> Clip:
    """Three people. An object hides the joints behind a bar that moves down the image. Of the other joints, one in
    five is hidden by the person's own body."""
    rng = np.random.default_rng(number)
    truth, rig = circling_people(60, 3, rng=rng), looking_at_origin(3)
    xy, _ = rig.project(truth.xyz)
    bar = np.linspace(200, 450, 60)[:, None, None, None]
    visibility = np.where(np.abs(xy[..., 1] - bar) < 45, Visibility.HIDDEN_BY_OBJECT, Visibility.VISIBLE)
    turn = (np.arange(xy.shape[-2]) + np.arange(60)[:, None, None, None]) % 5 == 0
    visibility[turn & (visibility == Visibility.VISIBLE)] = Visibility.HIDDEN_BY_SELF
    visibility[~rig.inside(xy)] = Visibility.OUTSIDE_IMAGE
    hidden = visibility == Visibility.HIDDEN_BY_OBJECT
    labels = OcclusionLabels(visibility, np.where(hidden, 0, -1), np.where(hidden, 0.5, np.nan), objects=("bar",))
    found = detect(truth, labels, rig, 25.0, PLANTED, rng=generator(9, number, Stream.DETECTOR))
    return Clip(str(number), 25.0, rig, found.detections, truth=truth, occlusion=labels)


@pytest.mark.slow
def test_a_planted_detector_is_found_again():
    clips = [clip(number) for number in range(3)]
    fitted = fit_to_truth(clips, START, rounds=5, seed=1)
    wrist, ankle = fitted.config.parts.wrist, fitted.config.parts.ankle
    for part in (wrist, ankle):
        assert part.noise == pytest.approx(0.012, rel=0.35)
        assert part.hidden_noise == pytest.approx(0.04, rel=0.5)
        assert part.covered_noise == pytest.approx(0.08, rel=0.5)
        for (a, b), mean in ((part.hidden_score, 0.5), (part.covered_score, 0.25)):
            assert a / (a + b) == pytest.approx(mean, abs=0.06)
        assert (part.miss[0], part.miss[3]) == (0, 0)
    assert 0.4 <= fitted.config.misses.lost_from <= 0.8
    assert fitted.config.inversions.body < 0.01
    rows = {row.what: row for row in distances([clip(7), clip(8)], fitted.config, seed=2)}
    assert rows["distribution of error"].distance < 0.08
    assert not any(row.exceeded for what, row in rows.items() if what.startswith("missed: "))


def test_clips_without_truth_are_refused():
    with pytest.raises(ValueError, match="truth=annotated fits to clips with truth"):
        fit_to_truth([replace(clip(0), truth=None, occlusion=None)], START, rounds=1)


def test_a_recording_and_its_simulation_are_measured_against_the_same_reference(tmp_path):
    """Two cameras can be measured against an annotation, and not against each other."""
    real, *sim = (clip(number).select(views=[0, 1]) for number in range(2))
    real = replace(real, occlusion=None)
    assert synth.fit_detector(real, sim, start=START, truth="annotated", rounds=1).statistics.error.size
    save_clip(real, tmp_path / "real")
    save_clip(sim[0], tmp_path / "sim")
    command = FitDetectorCommand(str(tmp_path / "real"), truth=ErrorReference.annotated, clips=str(tmp_path / "sim"))
    run(replace(command, detector=START, rounds=1), tmp_path / "out")
    assert (tmp_path / "out/detector/fitted.yaml").is_file()


def test_errors_are_measured_by_the_true_cameras():
    """What a calibration has wrong is no error of the detector."""
    exact = clip(0)
    wrong = replace(exact.rig, K=exact.rig.K * ((1.03, 1, 1), (1, 1.03, 1), (1, 1, 1)))
    found = [
        measure(each, ErrorReference.annotated).error for each in (exact, replace(exact, rig=wrong, true_rig=exact.rig))
    ]
    np.testing.assert_array_equal(*found)


@pytest.mark.slow
def test_distances_on_held_back_clips_are_written_beside_those_of_the_real_detector(tmp_path, capsys):
    for number in range(3):
        save_clip(clip(number), tmp_path / str(number))
    out = tmp_path / "out"
    command = FitDetectorCommand(
        detections=str(tmp_path / "0"),
        extra_data=[str(tmp_path / "1")],
        held_back=[str(tmp_path / "2")],
        truth=ErrorReference.annotated,
        detector=START,
        rounds=1,
        name="planted",
    )
    run(command, out)
    written = json.loads((out / "distances.json").read_text())
    assert list(written) == ["fitted", "held_back", "real"]
    by_name = [{row["what"]: row for row in written[which]} for which in written]
    error = [rows["distribution of error"] for rows in by_name]
    assert error[0]["real"] == error[2]["real"]
    assert error[1]["real"] == error[2]["simulated"]
    # The planted detector is nearer to itself than a preset after one round.
    assert error[2]["distance"] < min(error[0]["distance"], error[1]["distance"])
    printed = capsys.readouterr().out
    assert "Held-back clips." in printed
    assert "The real detector" in printed
    assert read_preset(DetectorConfig, "detector", str(out / "detector/planted.yaml")).name == "planted"


def test_held_back_clips_need_truth(tmp_path):
    with pytest.raises(ValueError, match="extra_data and held_back need truth=annotated"):
        run(FitDetectorCommand(detections=str(tmp_path), held_back=[str(tmp_path)]), tmp_path / "out")
