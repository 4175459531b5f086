"""Presets of detectors are read as they were written."""

from dataclasses import replace

import pytest

import synth
from dmae.data.resources import read_preset
from synth.detector.config import DetectorConfig
from synth.detector.fitting import preset_yaml
from synth.detector.parts import PartConfig, PartsConfig
from tests.support.detectors import changed


@pytest.mark.parametrize("value", [2e-05, 1.5e-07, 0.5])
def test_small_numbers_stay_numbers(tmp_path, value: float):
    part = PartConfig(noise=value, score=[value, 3.0], miss=[0.0, value, 1.0, 1.0])
    config = changed(replace(DetectorConfig(), parts=PartsConfig(wrist=part)), {"ghosts.count": value})
    path = tmp_path / "mine.yaml"
    path.write_text(preset_yaml(config, "mine", ["a comment"]))
    assert read_preset(DetectorConfig, "detector", str(path)) == replace(config, name="mine")


def test_a_file_that_names_a_function_is_refused_in_python_as_well(tmp_path):
    (tmp_path / "mine.yaml").write_text("custom: ['os:system']\n")
    with pytest.raises(ValueError, match=r"mine\.yaml: detector\.custom\[0\]: a preset cannot name a function"):
        synth.detector_errors(tmp_path, simulated=[str(tmp_path / "mine.yaml")])
