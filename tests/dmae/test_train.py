"""Training: it learns, resumes to the bit, and refuses to mix two models."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from dmae.calibrate import CLASSES
from dmae.clip import Poses3D
from dmae.examples import AugmentConfig, Recipe, Recording, as_measured
from dmae.hiding import HidingConfig
from dmae.learner import Learner, Loss, TrainConfig, penalty
from dmae.mapping import convert
from dmae.model import ModelConfig
from dmae.skeleton import BODY25, SHELF14
from dmae.train import train
from dmae.windows import rest_pose

from .strollers import clip_of, strollers

pytestmark = pytest.mark.usefixtures("one_thread")

TINY = TrainConfig(
    model=ModelConfig(
        frames=5, dim=16, depth=1, heads=2, head_dim=8, mlp=32, decoder_dim=8, signal_codes=8, dropout=0.1
    ),
    hiding=HidingConfig(longest=20, bursts=5.0),
    skeleton="shelf14",
    steps=10,
    epoch=5,
    batch=8,
    validation=0.3,
)


@pytest.fixture(scope="module")
def clips():
    rng = np.random.default_rng(0)
    return [clip_of(strollers(60, 2, rng=rng), f"clip{i}") for i in range(4)]


def weights(folder: Path) -> dict[str, torch.Tensor]:
    return load_file(folder / "weights.safetensors")


def same(first: dict, second: dict) -> bool:
    return first.keys() == second.keys() and all(torch.equal(first[name], second[name]) for name in first)


@pytest.fixture(scope="module")
def trained(clips, tmp_path_factory):
    return train(TINY, clips, tmp_path_factory.mktemp("trained"))


def test_training_leaves_weights_that_say_what_they_are(trained):
    record = json.loads((trained / "model.json").read_text())
    assert record["skeleton"] == "shelf14" and record["steps"] == 10 and record["clips"] == 3
    assert record["model"]["frames"] == 5
    assert len(record["validation_clips"]) == 1
    assert np.shape(record["calibration"]) == (2, CLASSES) and np.min(record["calibration"]) > 0
    assert record["hidden_model_mm"] > 0 and record["hidden_interpolation_mm"] > 0
    assert list((trained / "tensorboard").glob("events*"))


def test_resuming_is_exact(clips, trained, tmp_path, monkeypatch):
    step = Learner.training_step

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


def test_the_seed_decides(clips, trained, tmp_path):
    assert same(weights(train(TINY, clips, tmp_path / "again")), weights(trained))
    assert not same(weights(train(replace(TINY, seed=1), clips, tmp_path / "other")), weights(trained))


def test_a_finished_model_is_left_alone_and_another_configuration_refused(clips, trained):
    before = (trained / "weights.safetensors").stat().st_mtime_ns
    train(TINY, clips, trained)
    assert (trained / "weights.safetensors").stat().st_mtime_ns == before
    with pytest.raises(ValueError, match=r"otherwise: training\.json differs in lr, model"):
        train(replace(TINY, lr=1.0, model=replace(TINY.model, depth=2)), clips, trained)
    with pytest.raises(ValueError, match="clips"):
        train(TINY, clips[:3], trained)


def test_training_stops_when_its_time_is_up(clips, tmp_path):
    record = json.loads(
        (train(replace(TINY, steps=10**6, max_minutes=0.03), clips, tmp_path) / "model.json").read_text()
    )
    assert 0 < record["steps"] < 10**4


@pytest.mark.parametrize(
    "change",
    [{"loss": Loss.mse, "model": replace(TINY.model, residual=False, turn_to_front=False)}, {"shown_weight": 0.3}],
    ids=["paper", "denoise"],
)
def test_other_recipes_train(clips, tmp_path, change):
    config = replace(TINY, steps=2, augment=AugmentConfig(noise=0.02), **change)
    record = json.loads((train(config, clips, tmp_path) / "model.json").read_text())
    assert np.isfinite(record["hidden_model_mm"])
    assert record["denoises"] == (config.shown_weight > 0)


def test_a_single_clip_trains_without_validation(clips, tmp_path):
    record = json.loads((train(replace(TINY, steps=2), clips[:1], tmp_path) / "model.json").read_text())
    assert record["validation_clips"] == [] and "hidden_model_mm" not in record
    assert record["calibration"] is None


def test_clips_of_unseen_motion_are_validated_and_calibrated_on(clips, tmp_path):
    record = json.loads((train(TINY, clips[:3], tmp_path, clips[3:]) / "model.json").read_text())
    assert record["clips"] == 3 and record["validation_clips"] == ["unseen clip3"]
    assert np.shape(record["calibration"]) == (2, CLASSES)
    with pytest.raises(ValueError, match="differs in clips"):
        train(TINY, clips[:3], tmp_path)


def test_calibration_is_by_what_was_captured_and_by_true_poses_with_holes(clips):
    truth = convert(clips[0].truth, SHELF14)
    captured = truth.without(np.arange(14) == 2)
    recipe = Recipe(TINY.model, rest_pose(truth.xyz, SHELF14))
    (first, _), *others = as_measured([Recording(truth, captured)], recipe, seed=0)
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


def test_errors_that_are_expected_to_be_large_cost_less():
    squared, sure, unsure = torch.tensor([0.01, 0.04]), torch.tensor(0.001).log(), torch.tensor(1.0).log()
    assert torch.equal(penalty(Loss.mse, squared, sure), squared)
    torch.testing.assert_close(penalty(Loss.euclidean, squared, unsure), squared.sqrt())
    once, twice = penalty(Loss.relative, squared, sure)
    assert float(twice / once) == pytest.approx(2, rel=1e-3)
    assert (penalty(Loss.relative, squared, sure) > 100 * penalty(Loss.relative, squared, unsure)).all()
