"""Training: resumes to the bit, follows its seed, and refuses a folder of another model."""

import dataclasses
import json
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from dmae.cli import DMAE, compose
from dmae.completion import training_data
from dmae.completion.complete import CLASSES
from dmae.completion.config import (
    AugmentConfig,
    LearningConfig,
    Loss,
    MaskingConfig,
    ModelConfig,
    Precision,
    TrainConfig,
)
from dmae.completion.training import CheckedCheckpoints, Learner, TimeLimit, error_loss, newest_checkpoint, train
from dmae.completion.training_data import PosePair, Recipe, calibration_poses, read_training_set
from dmae.completion.windows import rest_pose
from dmae.data.clip import Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14
from tests.support.circling_people import circling_people, clip_of
from tests.support.clips import full_clip
from tests.support.training import TINY_NETWORK, changed

TINY = changed(
    TrainConfig(),
    model=replace(TINY_NETWORK, dropout=0.1),
    masking=MaskingConfig(longest=20, bursts=5.0),
    skeleton="shelf14",
    steps=10,
    epoch=5,
    batch=8,
    held_back=0.3,
)


@pytest.fixture(scope="module")
def clips():
    rng = np.random.default_rng(0)
    return [clip_of(circling_people(60, 2, rng=rng), f"clip{i}") for i in range(4)]


def weights(folder: Path) -> dict[str, torch.Tensor]:
    return load_file(folder / "weights.safetensors")


def same(first: dict, second: dict) -> bool:
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)


@pytest.fixture(scope="module")
def trained(clips, tmp_path_factory):
    return train(TINY, clips, tmp_path_factory.mktemp("trained"))


def test_training_writes_weights_and_their_record(trained):
    record = json.loads((trained / "model.json").read_text())
    assert record["skeleton"] == "shelf14" and record["steps"] == 10 and record["clips"] == 3
    assert record["model"]["frames"] == 5
    assert len(record["validation_clips"]) == 1
    assert np.shape(record["calibration"]) == (2, CLASSES) and np.min(record["calibration"]) > 0
    assert record["hidden_model_mm"] > 0 and record["hidden_interpolation_mm"] > 0
    assert list((trained / "tensorboard").glob("events*"))


def test_resuming_is_exact(clips, trained, tmp_path, monkeypatch, capsys):
    def shown() -> str:
        said = capsys.readouterr().err
        assert re.search(r"^validation is on 1 clip: ", said, re.MULTILINE)
        return re.findall(r"step 10: loss .*", said)[0]

    train(TINY, clips, tmp_path / "whole")
    whole, step = shown(), Learner.training_step

    def fail_at_7(self, batch, index):
        if self.trainer.global_step == 7:
            raise InterruptedError("power cut")
        return step(self, batch, index)

    monkeypatch.setattr(Learner, "training_step", fail_at_7)
    with pytest.raises(InterruptedError):
        train(TINY, clips, tmp_path)
    assert not (tmp_path / "model.json").exists()
    monkeypatch.undo()
    assert same(weights(train(TINY, clips, tmp_path)), weights(trained))
    assert shown() == whole
    # As if it was killed during calibration, after the last step: averaged weights are what is kept.
    for name in ("model.json", "weights.safetensors"):
        (tmp_path / name).unlink()
    assert same(weights(train(TINY, clips, tmp_path)), weights(trained))


def test_more_steps_for_a_finished_model_are_refused_with_the_way_to_train_on(clips, trained, tmp_path):
    remedy = rf"differs in learning\.steps\. Choose .*; init={trained} trains on from the finished model in it"
    with pytest.raises(ValueError, match=remedy):
        train(changed(TINY, steps=20), clips, trained)
    begun = tmp_path / "begun"
    begun.mkdir()
    (begun / "training.json").write_bytes((trained / "training.json").read_bytes())
    with pytest.raises(ValueError, match=r"or remove this one$"):
        train(changed(TINY, steps=20), clips, begun)


def test_another_seed_gives_other_weights(clips, trained, tmp_path):
    assert not same(weights(train(changed(TINY, seed=1), clips, tmp_path)), weights(trained))


def test_a_finished_model_is_left_alone_and_another_configuration_refused(clips, trained, capsys):
    before = (trained / "weights.safetensors").stat().st_mtime_ns
    train(TINY, clips, trained)
    assert f"{trained}: this training is finished, at step 10; init={trained} trains on" in capsys.readouterr().err
    assert (trained / "weights.safetensors").stat().st_mtime_ns == before
    with pytest.raises(ValueError, match=r"training\.json differs in learning\.lr, model\.encoder\.depth"):
        train(
            changed(TINY, lr=1.0, model=replace(TINY.model, encoder=replace(TINY.model.encoder, depth=2))),
            clips,
            trained,
        )
    with pytest.raises(ValueError, match="clips"):
        train(TINY, clips[:3], trained)


def test_training_stops_when_its_time_is_up(clips, tmp_path):
    record = json.loads(
        (train(changed(TINY, steps=10**6, max_minutes=0.03), clips, tmp_path) / "model.json").read_text()
    )
    assert 0 < record["steps"] < 10**4


@pytest.mark.parametrize(
    "change",
    [{"loss": Loss.mse, "model": replace(TINY.model, residual=False, align_heading=False)}, {"observed_weight": 0.3}],
    ids=["paper", "denoise"],
)
def test_other_recipes_train(clips, tmp_path, change):
    config = changed(TINY, steps=2, augment=AugmentConfig(noise=0.02), **change)
    record = json.loads((train(config, clips, tmp_path) / "model.json").read_text())
    assert np.isfinite(record["hidden_model_mm"])
    assert record["denoises"] == (config.learning.observed_weight > 0)


def test_a_training_that_ends_within_an_epoch_says_what_it_reached(clips, tmp_path, capsys):
    for steps, whole in ((2, 0), (10, 2), (7, 1)):
        train(changed(TINY, steps=steps), clips, tmp_path / str(steps))
        said = [line for line in capsys.readouterr().err.splitlines() if "validation: unmeasured joints" in line]
        assert len(said) == whole + (steps % 5 > 0) and said[-1].startswith(f"step {steps}: loss")


def test_a_training_that_time_ends_says_once_what_it_reached(clips, tmp_path, capsys):
    train(replace(changed(TINY, steps=100000, epoch=20), max_minutes=0.02), clips, tmp_path)
    said = [line.split(":")[0] for line in capsys.readouterr().err.splitlines() if line.startswith("step ")]
    assert said and len(said) == len(set(said))


def test_examples_are_made_for_the_steps_that_are_taken(clips, tmp_path, monkeypatch):
    made, masked_rows = [], training_data.masked_rows
    monkeypatch.setattr(
        training_data, "masked_rows", lambda *given, **more: made.append(masked_rows(*given, **more)) or made[-1]
    )
    train(changed(TINY, steps=2, epoch=200), clips, tmp_path)
    assert len(made) < 5


def test_reading_says_how_many_clips_and_cameras_there_are(capsys, monkeypatch):
    monkeypatch.setattr("dmae.progress.LINE_EVERY", 0.005)
    seen, config = full_clip(3, 3), changed(TINY, views=[3, 2])
    read_training_set([replace(seen, id="a"), replace(seen, id="b")], [], [], SHELF14, config)
    said = capsys.readouterr().err
    assert "reading clips: 1 of 2" in said and "capturing b: 3 of 4" in said


def test_weights_of_the_default_network_do_not_start_the_papers(clips, tmp_path):
    config = compose(DMAE.commands["train"], ["model=paper", "init=shipped", "data=clip", "data.path=none"])
    with pytest.raises(ValueError, match="give init=paper"):
        train(config, clips, tmp_path)


def test_a_single_clip_trains_without_validation(clips, tmp_path, capsys):
    record = json.loads((train(changed(TINY, steps=2, epoch=1), clips[:1], tmp_path) / "model.json").read_text())
    assert record["validation_clips"] == [] and "hidden_model_mm" not in record
    assert record["calibration"] is None
    said = [line for line in capsys.readouterr().err.splitlines() if line.startswith("step ")]
    loss = r"step \d: loss -?[\d.]+"
    assert re.fullmatch(f"{loss}; no clip is held back for validation; .*\n{loss}", "\n".join(said))


def test_validation_clips_are_validated_and_calibrated_on(clips, tmp_path):
    record = json.loads((train(TINY, clips[:3], tmp_path, clips[3:]) / "model.json").read_text())
    assert record["clips"] == 3 and record["validation_clips"] == ["validation clip3"]
    assert np.shape(record["calibration"]) == (2, CLASSES)
    with pytest.raises(ValueError, match=r"another configuration: training\.json differs in clips"):
        train(TINY, clips[:3], tmp_path)


def test_captures_with_other_rays_are_another_training(clips, tmp_path):
    """Rays are inputs of the network."""
    config = changed(TINY, steps=2, epoch=1)
    poses = convert(clips[0].truth, SHELF14).without(np.arange(14) == 2)
    seen = replace(poses, rays=np.where(np.arange(14)[:, None, None] == 2, np.ones((2, 3)), poses.rays))
    train(config, [replace(clips[0], poses=seen)], tmp_path)
    train(config, [replace(clips[0], poses=seen)], tmp_path)
    with pytest.raises(ValueError, match=r"another configuration: training\.json differs in clips"):
        train(config, [replace(clips[0], poses=poses)], tmp_path)


def test_calibration_uses_captured_poses_and_true_poses_with_masks(clips):
    truth = convert(clips[0].truth, SHELF14)
    captured = truth.without(np.arange(14) == 2)
    recipe = Recipe(TINY.model, rest_pose(truth.xyz, SHELF14))
    (first, _), *others = calibration_poses([PosePair(truth, captured)], recipe, seed=0)
    assert first is captured and len(others) > 1
    hidden = [~measured.measured for measured, _ in others]
    assert all(some.any() for some in hidden) and (hidden[0] != hidden[1]).any()
    for measured, known in others:
        np.testing.assert_array_equal(measured.xyz[measured.measured], known.xyz[measured.measured])


def test_clips_without_truth_or_without_people_are_named(clips, tmp_path):
    with pytest.raises(ValueError, match="'clip0' has no truth"):
        train(TINY, [replace(clips[0], truth=None)], tmp_path)
    nobody = Poses3D(BODY25, np.full((60, 1, 25, 3), np.nan))
    with pytest.raises(ValueError, match="nothing to learn from"):
        train(TINY, [replace(clips[0], truth=nobody)], tmp_path)
    with pytest.raises(ValueError, match="two clips are called 'clip0'"):
        train(TINY, [clips[0], clips[0]], tmp_path)


def test_extra_data_without_people_cannot_be_replayed(clips, tmp_path):
    nobody = replace(clips[0], id="nobody", truth=clips[0].truth.without(np.ones(1, bool)))
    with pytest.raises(ValueError, match="nothing to replay, no clip has a person in it"):
        train(changed(replace(TINY, extra_data=["empty"]), replay=0.5), clips, tmp_path, extra_clips=[nobody])


def test_errors_that_are_expected_to_be_large_have_less_weight():
    squared, sure, unsure = torch.tensor([0.01, 0.04]), torch.tensor(0.001).log(), torch.tensor(1.0).log()
    assert torch.equal(error_loss(Loss.mse, squared, sure), 100 * squared)
    once, twice = error_loss(Loss.relative, squared, sure)
    assert float(twice / once) == pytest.approx(2, rel=1e-3)
    assert (error_loss(Loss.relative, squared, sure) > 100 * error_loss(Loss.relative, squared, unsure)).all()


def test_a_loss_that_is_not_finite_ends_training_without_weights(clips, tmp_path):
    config = changed(TINY, lr=1e9)
    with pytest.raises(ValueError, match=r"step \d: the loss is (nan|inf).*smaller learning\.lr than 1e\+09"):
        train(config, clips, tmp_path)
    assert not (tmp_path / "weights.safetensors").exists() and not (tmp_path / "model.json").exists()


def test_infinite_coordinates_are_not_learned_from(clips, tmp_path):
    xyz = clips[0].truth.xyz.copy()
    xyz[3, 0, 2] = np.inf
    broken = replace(clips[0], truth=replace(clips[0].truth, xyz=xyz))
    with pytest.raises(ValueError, match="clip 'clip0': truth has infinite coordinates"):
        train(TINY, [broken, *clips[1:]], tmp_path)


# Options of training: impossible values are refused.


@pytest.mark.parametrize("config", [TrainConfig, ModelConfig])
def test_no_level_has_more_than_a_dozen_options(config):
    def levels(kind):
        parts = dataclasses.fields(kind)
        yield kind, len(parts)
        for part in parts:
            if part.default_factory is not dataclasses.MISSING and dataclasses.is_dataclass(part.default_factory):
                yield from levels(part.default_factory)

    crowded = {kind.__name__: count for kind, count in levels(config) if count > 12}
    assert not {name for name in crowded if name not in ("CaptureConfig", "DataConfig")}


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"steps": 0}, "learning.steps: expected at least 1"),
        ({"average": 1.0}, r"learning.average: expected a decay in \[0, 1\)"),
        ({"held_back": 1.0}, r"examples.held_back: expected a share in \[0, 1\)"),
        ({"replay": 2.0}, "examples.replay=2.0: expected a share"),
        ({"replay": 0.5}, r"examples.replay=0.5: expected extra_data=\[...\]"),
    ],
)
def test_impossible_values_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        changed(TrainConfig(), **wrong)


# A time limit of training includes the steps that follow training.


def test_without_minutes_there_is_no_end():
    limit = TimeLimit(None)
    limit.reserve((lambda: time.sleep(10), 100))
    assert not limit.limited and limit.training() == limit.until() == float("inf")
    assert list(limit.while_left(range(3))) == [0, 1, 2]


def test_time_is_kept_for_what_follows_by_trying_it():
    limit = TimeLimit(1.0)
    limit.reserve((lambda: time.sleep(0.02), 100))
    assert 2 <= limit.closing < 10
    assert 45 < limit.training() < 58
    limit.reserve((lambda: time.sleep(0.02), 10**6))
    assert limit.closing == 0.35 * 60


def test_time_counts_from_the_beginning_of_the_command_and_of_earlier_runs():
    limit = TimeLimit(1.0, time.monotonic() - 50)
    assert 9 < limit.training() < 10.1
    assert TimeLimit(1.0).training(done=55) <= 5


def test_when_time_is_up_one_item_is_left():
    limit = TimeLimit(1.0, time.monotonic() - 100)
    assert list(limit.while_left(range(3))) == [0]


# Checkpoints: damage is found, the one before is used, and training continues to the same weights.


@pytest.fixture
def folder(tmp_path):
    for step in (5, 10):
        CheckedCheckpoints().save_checkpoint({"step": step, "x": torch.arange(9)}, tmp_path / "checkpoint.ckpt")
    return tmp_path


def flip(path, at=-200):
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)


def test_the_newest_is_read_as_it_was_written(folder):
    read = CheckedCheckpoints().load_checkpoint(newest_checkpoint(folder))
    assert read["step"] == 10 and torch.equal(read["x"], torch.arange(9))


@pytest.mark.parametrize("at", [0, 30, 100, -1])
def test_of_a_damaged_one_the_one_before_is_used(folder, at, capsys):
    flip(folder / "checkpoint.ckpt", at)
    with pytest.raises(ValueError, match=r"checkpoint\.ckpt: does not match its checksum"):
        CheckedCheckpoints().load_checkpoint(folder / "checkpoint.ckpt")
    assert CheckedCheckpoints().load_checkpoint(newest_checkpoint(folder))["step"] == 5
    assert "training continues from checkpoint_before.ckpt" in capsys.readouterr().err


def test_where_all_are_damaged_what_to_do_is_said(folder):
    flip(folder / "checkpoint_before.ckpt")
    (folder / "checkpoint.ckpt").write_bytes((folder / "checkpoint.ckpt").read_bytes()[:100])
    with pytest.raises(ValueError, match=r"Remove checkpoint\.ckpt and checkpoint_before\.ckpt from"):
        newest_checkpoint(folder)


def test_before_the_first_there_is_none(tmp_path):
    assert newest_checkpoint(tmp_path) is None


# Training in two processes gives the losses of one process; half precision gives nearly the same losses.

pytestmark = pytest.mark.slow
SMALL = changed(
    TrainConfig(),
    model=TINY_NETWORK,
    skeleton="shelf14",
    steps=24,
    epoch=4,
    batch=7,
    held_back=0.3,
    observed_weight=0.5,
)


@pytest.fixture(scope="module")
def one(clips, tmp_path_factory) -> Path:
    return train(SMALL, clips, tmp_path_factory.mktemp("one"))


def losses(folder: Path, name: str = "train_loss") -> np.ndarray:
    """Return the losses that training logged."""
    logs = [EventAccumulator(str(file)).Reload() for file in (folder / "tensorboard").glob("events*")]
    (found,) = (log.Scalars(name) for log in logs if name in log.Tags()["scalars"])
    return np.array([event.value for event in found])


def record(folder: Path) -> dict:
    return json.loads((folder / "model.json").read_text())


def test_two_processes_give_the_losses_of_one_which_goes_on_where_they_stopped(clips, one, tmp_path, capfd):
    """A batch of 7 windows has no equal halves, and these not equally many joints that count."""
    two = train(changed(SMALL, devices=2), clips, tmp_path)
    said = capfd.readouterr()
    printed = [line for line in (said.out + said.err).splitlines() if not line.startswith("training, %")]
    assert printed[0] == "validation is on 1 clip: clip2"  # Said by one of them
    assert printed[1:] and all(line.startswith("step ") and "loss nan" not in line for line in printed[1:]), printed
    assert len(losses(one)) == 6
    np.testing.assert_allclose(losses(two), losses(one), rtol=1e-4)
    ours, theirs = load_file(one / "weights.safetensors"), load_file(two / "weights.safetensors")
    assert all(np.allclose(ours[name], theirs[name], atol=2e-4) for name in ours)
    assert record(two)["steps"] == record(one)["steps"] == 24
    assert record(two)["hidden_model_mm"] == pytest.approx(record(one)["hidden_model_mm"], rel=1e-3)
    for name in ("model.json", "weights.safetensors"):
        (two / name).unlink()
    train(SMALL, clips, two)
    assert record(two)["hidden_model_mm"] == pytest.approx(record(one)["hidden_model_mm"], rel=1e-3)


def test_a_loss_that_is_not_finite_ends_all_processes(clips, tmp_path):
    with pytest.raises(ValueError, match="so training stopped and wrote no weights"):
        train(changed(SMALL, devices=2, lr=1e9), clips, tmp_path)
    assert not (tmp_path / "weights.safetensors").exists()


def test_half_precision_learns_as_well(clips, one, tmp_path):
    half = train(changed(SMALL, precision=Precision.bf16), clips, tmp_path)
    assert not np.array_equal(losses(half), losses(one))
    np.testing.assert_allclose(losses(half), losses(one), rtol=0.05)
    assert record(half)["hidden_model_mm"] == pytest.approx(record(one)["hidden_model_mm"], rel=0.05)
    assert all(tensor.dtype.itemsize == 4 for tensor in load_file(half / "weights.safetensors").values())
    with pytest.raises(ValueError, match=r"differs in learning\.precision"):
        train(SMALL, clips, tmp_path)


def test_more_processes_than_windows_are_refused():
    with pytest.raises(ValueError, match=r"learning\.devices=3"):
        LearningConfig(batch=2, devices=3)
