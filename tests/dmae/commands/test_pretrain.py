"""`dmae pretrain`: every step is a command that its program takes, and the whole makes a model."""

import importlib
import json
from pathlib import Path

import pytest

from dmae.cli import DMAE, compose
from dmae.commands.config import PretrainCommand
from dmae.commands.pretrain import _steps
from tests.support.commands import run_command
from tests.support.motion_files import bvh


@pytest.fixture
def mocap(tmp_path) -> Path:
    folder = tmp_path / "mocap"
    folder.mkdir()
    for subject in ("02", "05", "07"):
        bvh(folder / f"{subject}_01.bvh", [{"root": (n / 99, 0, 0)} for n in range(90)])
    return folder


@pytest.mark.parametrize(
    "options", [{}, {"motion": "mocap"}, {"motion": "mocap/takes.tsv", "rig": "ring", "views": [2, 4]}]
)
def test_every_step_is_a_command_line_that_its_program_takes(mocap, monkeypatch, options):
    monkeypatch.chdir(mocap.parent)
    (mocap / "takes.tsv").write_text("file\tsubject\tset\n")
    steps = _steps(PretrainCommand(**options), Path("runs/own"))
    for name in ("train", "test", "train_captured", "validation", "validation_captured"):
        Path("runs/own", name).mkdir(parents=True)
    programs = {name: getattr(importlib.import_module(f"{name}.cli"), name.upper()) for name in ("dmae", "synth")}
    for program, command, *words in steps:
        compose(programs[program].commands[command], words)
    done = [command for _, command, *_ in steps]
    takes = ["split"] if options.get("motion") == "mocap" else []
    captures = ["capture", "capture"]
    assert done == [*takes, "generate", "generate", "generate", *captures, "train", "evaluate", "evaluate", "card"]


def test_sets_share_no_seed_and_no_subject(mocap):
    steps = _steps(PretrainCommand(motion=str(mocap), seed=4), Path("runs/own"))
    generated = [step for step in steps if step[1] == "generate"]
    assert len({word for step in generated for word in step if word.startswith("seed=")}) == 3
    sets = [word for step in generated for word in step if word.startswith("motion.sets=")]
    assert sets == ["motion.sets=[train]", "motion.sets=[validation]", "motion.sets=[test]"]


def test_a_calibration_is_read_from_its_file(tmp_path):
    (tmp_path / "calibration.json").write_text("{}")
    steps = _steps(PretrainCommand(rig=str(tmp_path / "calibration.json")), Path("runs/own"))
    assert f"rig.path={tmp_path / 'calibration.json'}" in steps[0]


def test_a_fitted_preset_is_named_by_its_file(tmp_path):
    (tmp_path / "detector").mkdir()
    preset = tmp_path / "detector/mine.yaml"
    preset.write_text("# @package detector")
    steps = _steps(PretrainCommand(detector=str(preset)), Path("runs/own"))
    assert {f"--config-dir={tmp_path}", "detector=mine"} <= set(steps[0])
    assert not any(str(tmp_path) in word for word in steps[-1])
    with pytest.raises(ValueError, match="expected a file in a folder `detector`"):
        _steps(PretrainCommand(detector=str(preset.rename(tmp_path / "mine.yaml"))), Path("runs/own"))


def test_what_cannot_be_is_refused(tmp_path):
    for missing in ("rig=nowhere/rig.toml", "detector=nowhere/mine.yaml"):
        name, _, path = missing.partition("=")
        with pytest.raises(FileNotFoundError, match=f"{missing}: no such"):
            _steps(PretrainCommand(**{name: path}), Path("runs/own"))
    with pytest.raises(FileNotFoundError, match="no such folder or list of takes"):
        _steps(PretrainCommand(motion=str(tmp_path / "none")), Path("runs/own"))
    with pytest.raises(ValueError, match="expected a path without quotes"):
        _steps(PretrainCommand(rig="a,b"), Path("runs/own"))
    with pytest.raises(ValueError, match="views"):
        PretrainCommand(views=[1])


@pytest.mark.slow
def test_a_model_is_made_and_its_card_written(mocap, tmp_path):
    config = PretrainCommand(motion=str(mocap), rig="ring", clips=2, seconds=1.0, steps=4, views=[3])
    out = tmp_path / "own"
    for program, *words in _steps(config, out):
        done = run_command(tmp_path, program, *words)
        assert done.returncode == 0, f"{program} {words}: {done.stderr}"
    assert json.loads((out / "model" / "model.json").read_text())["steps"] == 4
    card = (out / "model" / "MODEL_CARD.md").read_text()
    assert "dmae pretrain" in card
    assert "gaussian_process" in card


def test_options_with_the_names_of_groups_of_presets_are_paths_and_names():
    """Other commands have presets of rigs and motion; Hydra must not look for one here."""
    given = ["motion=mocap", "rig=session/calibration.json", "detector=hrnet_like"]
    config = compose(DMAE.commands["pretrain"], given)
    assert (config.motion, config.rig, config.detector) == ("mocap", "session/calibration.json", "hrnet_like")


def test_a_calibration_is_given_on_the_command_line(tmp_path: Path):
    done = run_command(tmp_path, "dmae", "pretrain", "rig=session/calibration.json", "motion=none", "--cfg", "job")
    assert done.returncode == 0, done.stderr
    assert "rig: session/calibration.json" in done.stdout
