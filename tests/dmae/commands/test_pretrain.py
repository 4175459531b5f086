"""`dmae pretrain` simulates sets that share no seed and no subject, and makes a model of them."""

import json
from pathlib import Path

import pytest

from dmae.cli import DMAE, compose
from dmae.commands.config import PretrainCommand
from dmae.commands.pretrain import camera_numbers, command_line, configurations, run
from dmae.formats.calibrations import write_calibration
from tests.support.clips import looking_at_origin
from tests.support.commands import run_command
from tests.support.motion_files import bvh


@pytest.fixture
def mocap(tmp_path) -> Path:
    folder = tmp_path / "mocap"
    folder.mkdir()
    for subject in ("02", "05", "07"):
        bvh(folder / f"{subject}_01.bvh", [{"root": (n / 99, 0, 0)} for n in range(90)])
    return folder


def test_sets_share_no_seed_and_no_subject(mocap, tmp_path):
    made = configurations(PretrainCommand(motion=str(mocap), seed=4), tmp_path)
    assert [each["seed"] for each in made.values()] == [12, 13, 14]
    assert [each["motion"].sets for each in made.values()] == [["train"], ["validation"], ["test"]]
    assert (tmp_path / "takes.tsv").is_file()


def test_a_calibration_and_a_fitted_preset_are_read_from_their_files(tmp_path):
    write_calibration(looking_at_origin(4), tmp_path / "calibration.json", "panoptic")
    preset = tmp_path / "mine.yaml"
    preset.write_text("# @package detector\nname: mine\n")
    config = PretrainCommand(rig=str(tmp_path / "calibration.json"), detector=str(preset))
    assert camera_numbers(config) == [2, 3, 4] and camera_numbers(PretrainCommand()) == [2, 3, 4, 5]
    made = configurations(config, tmp_path)["train"]
    assert made["rig"].path == str(tmp_path / "calibration.json") and made["detector"].name == "mine"
    assert str(tmp_path) not in command_line(config)


def test_presets_of_the_user_are_found_by_name_and_by_file(tmp_path):
    for name, text in (
        ("detector", "defaults: [terrible, _self_]\nname: mine\n"),
        ("rig", "placement: ring\nring: {views: 3}\n"),
    ):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine.yaml").write_text(text)
    rig, detector = str(tmp_path / "rig/mine.yaml"), str(tmp_path / "detector/mine.yaml")
    done = run_command(
        tmp_path, "dmae", "pretrain", f"--config-dir={tmp_path}", "rig=mine", "detector=mine", "--cfg", "job"
    )
    assert f"rig: {rig}" in done.stdout and f"detector: {detector}" in done.stdout
    config = PretrainCommand(rig=rig, detector=detector)
    made = configurations(config, tmp_path)["train"]
    assert made["rig"].ring.views == 3 and made["detector"].timing.unsynchronised == 1
    assert camera_numbers(config) == [2, 3]


def test_what_cannot_be_is_refused(tmp_path):
    for missing in ("rig=nowhere/rig.toml", "detector=nowhere/mine.yaml"):
        name, _, path = missing.partition("=")
        with pytest.raises(FileNotFoundError, match=f"{missing}: no such"):
            configurations(PretrainCommand(**{name: path}), tmp_path)
    (tmp_path / "take.bvh").touch()
    with pytest.raises(ValueError, match=r"take\.bvh: expected a folder of motion files"):
        configurations(PretrainCommand(motion=str(tmp_path / "take.bvh")), tmp_path)
    for rig, views in (("shelf", 5), ("random", 6)):
        with pytest.raises(ValueError, match=rf"views=\[9\]: expected numbers from 2 to {views}, .* rig={rig}"):
            camera_numbers(PretrainCommand(rig=rig, views=[9]))
    with pytest.raises(FileNotFoundError, match="no such folder or list of takes"):
        configurations(PretrainCommand(motion=str(tmp_path / "none")), tmp_path)
    with pytest.raises(ValueError, match="views"):
        PretrainCommand(views=[1])


def test_the_card_repeats_the_numbers_of_cameras():
    assert command_line(PretrainCommand(rig="ring", views=[2, 3])).endswith("rig=ring 'views=[2,3]'")
    assert "views" not in command_line(PretrainCommand())


@pytest.mark.slow
def test_a_model_is_made_and_its_card_written(mocap, tmp_path, capsys):
    config = PretrainCommand(motion=str(mocap), rig="ring", clips=2, seconds=1.0, steps=4, views=[5])
    out = tmp_path / "own"
    run(config, out)
    assert json.loads((out / "model" / "model.json").read_text())["steps"] == 4
    card = (out / "model" / "MODEL_CARD.md").read_text()
    assert "dmae pretrain" in card
    assert "gaussian_process" in card
    said, noise = capsys.readouterr()
    # A page of the terminal, with the loss of each epoch, and no line for each clip.
    assert len(said.splitlines()) <= 40 and len(noise.splitlines()) <= 10
    assert "step 4: loss" in noise and "validation: unmeasured joints" in noise
    assert "your weights, compared with the weights of the package:\ndmae, 5 views: strict PCP" in said
    assert "\ndmae, synthetic gaps: " in said
    before = (out / "model/weights.safetensors").read_bytes()
    run(config, out)
    assert (out / "model/weights.safetensors").read_bytes() == before


def test_options_with_the_names_of_groups_of_presets_are_paths_and_names():
    """Other commands have presets of rigs and motion; Hydra must not look for one here."""
    given = ["motion=mocap", "rig=session/calibration.json", "detector=hrnet_like"]
    config = compose(DMAE.commands["pretrain"], given)
    assert (config.motion, config.rig, config.detector) == ("mocap", "session/calibration.json", "hrnet_like")


def test_a_calibration_is_given_on_the_command_line(tmp_path: Path):
    done = run_command(tmp_path, "dmae", "pretrain", "rig=session/calibration.json", "motion=none", "--cfg", "job")
    assert done.returncode == 0, done.stderr
    assert "rig: session/calibration.json" in done.stdout
