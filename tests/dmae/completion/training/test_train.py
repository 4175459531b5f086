"""Training: resumes to the bit, follows its seed, and refuses a folder of another model."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from dmae.completion.network.config import CodesConfig, DecoderConfig, EncoderConfig, ModelConfig
from dmae.completion.normalisation import rest_pose
from dmae.completion.training.augmentation import AugmentConfig
from dmae.completion.training.batches import calibration_poses
from dmae.completion.training.config import Loss, TrainConfig
from dmae.completion.training.examples import Recipe
from dmae.completion.training.learner import Learner, error_loss
from dmae.completion.training.masking import MaskingConfig
from dmae.completion.training.pose_pairs import PosePair
from dmae.completion.training.train import train
from dmae.completion.uncertainty import CLASSES
from dmae.data.clip import Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14
from tests.support.circling_people import circling_people, clip_of
from tests.support.training import changed

TINY = changed(
    TrainConfig(),
    model=ModelConfig(
        frames=5,
        encoder=EncoderConfig(dim=16, depth=1, heads=2, head_dim=8, mlp=32),
        decoder=DecoderConfig(dim=8),
        codes=CodesConfig(signal=8),
        dropout=0.1,
    ),
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
    assert not same(weights(train(changed(TINY, seed=1), clips, tmp_path / "other")), weights(trained))


def test_a_finished_model_is_left_alone_and_another_configuration_refused(clips, trained):
    before = (trained / "weights.safetensors").stat().st_mtime_ns
    train(TINY, clips, trained)
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


def test_a_single_clip_trains_without_validation(clips, tmp_path):
    record = json.loads((train(changed(TINY, steps=2), clips[:1], tmp_path) / "model.json").read_text())
    assert record["validation_clips"] == [] and "hidden_model_mm" not in record
    assert record["calibration"] is None


def test_validation_clips_are_validated_and_calibrated_on(clips, tmp_path):
    record = json.loads((train(TINY, clips[:3], tmp_path, clips[3:]) / "model.json").read_text())
    assert record["clips"] == 3 and record["validation_clips"] == ["validation clip3"]
    assert np.shape(record["calibration"]) == (2, CLASSES)
    with pytest.raises(ValueError, match=r"another configuration: training\.json differs in clips"):
        train(TINY, clips[:3], tmp_path)


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


def test_errors_that_are_expected_to_be_large_have_less_weight():
    squared, sure, unsure = torch.tensor([0.01, 0.04]), torch.tensor(0.001).log(), torch.tensor(1.0).log()
    assert torch.equal(error_loss(Loss.mse, squared, sure), squared)
    torch.testing.assert_close(error_loss(Loss.euclidean, squared, unsure), squared.sqrt())
    once, twice = error_loss(Loss.relative, squared, sure)
    assert float(twice / once) == pytest.approx(2, rel=1e-3)
    assert (error_loss(Loss.relative, squared, sure) > 100 * error_loss(Loss.relative, squared, unsure)).all()


def test_a_loss_that_is_not_finite_ends_training_without_weights(clips, tmp_path):
    config = changed(TINY, lr=1e30)
    with pytest.raises(ValueError, match=r"step \d: the loss is (nan|inf).*smaller learning\.lr than 1e\+30"):
        train(config, clips, tmp_path)
    assert not (tmp_path / "weights.safetensors").exists() and not (tmp_path / "model.json").exists()
    batch = load_file(tmp_path / "not_finite.safetensors")
    assert batch["truth"].shape == batch["windows.x"].shape


def test_infinite_coordinates_are_not_learned_from(clips, tmp_path):
    xyz = clips[0].truth.xyz.copy()
    xyz[3, 0, 2] = np.inf
    broken = replace(clips[0], truth=replace(clips[0].truth, xyz=xyz))
    with pytest.raises(ValueError, match="clip 'clip0': truth has infinite coordinates"):
        train(TINY, [broken, *clips[1:]], tmp_path)
