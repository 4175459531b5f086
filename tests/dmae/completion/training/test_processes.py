"""Training in two processes gives the losses of one process; half precision gives nearly the same losses."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from safetensors.torch import load_file
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from dmae.completion.network.config import CodesConfig, DecoderConfig, EncoderConfig, ModelConfig
from dmae.completion.training.config import LearningConfig, Precision, TrainConfig
from dmae.completion.training.train import train
from tests.support.circling_people import circling_people, clip_of
from tests.support.training import changed

pytestmark = pytest.mark.slow
SMALL = changed(
    TrainConfig(),
    model=ModelConfig(
        frames=5,
        encoder=EncoderConfig(dim=16, depth=1, heads=2, head_dim=8, mlp=32),
        decoder=DecoderConfig(dim=8),
        codes=CodesConfig(signal=8),
    ),
    skeleton="shelf14",
    steps=24,
    epoch=4,
    batch=7,
    held_back=0.3,
    observed_weight=0.5,
)


@pytest.fixture(scope="module")
def clips():
    rng = np.random.default_rng(0)
    return [clip_of(circling_people(60, 2, rng=rng), f"clip{i}") for i in range(4)]


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


def test_two_processes_give_the_losses_of_one(clips, one, tmp_path):
    """A batch of 7 windows has no equal halves, and these not equally many joints that count."""
    two = train(changed(SMALL, devices=2), clips, tmp_path)
    assert len(losses(one)) == 6
    np.testing.assert_allclose(losses(two), losses(one), rtol=1e-4)
    ours, theirs = load_file(one / "weights.safetensors"), load_file(two / "weights.safetensors")
    assert all(np.allclose(ours[name], theirs[name], atol=2e-4) for name in ours)
    assert record(two)["steps"] == record(one)["steps"] == 24
    assert record(two)["hidden_model_mm"] == pytest.approx(record(one)["hidden_model_mm"], rel=1e-3)


def test_one_process_goes_on_where_two_stopped(clips, one, tmp_path):
    two = changed(SMALL, devices=2)
    train(replace(two, learning=replace(two.learning, steps=24)), clips, tmp_path)
    for name in ("model.json", "weights.safetensors"):
        (tmp_path / name).unlink()
    train(SMALL, clips, tmp_path)
    assert record(tmp_path)["hidden_model_mm"] == pytest.approx(record(one)["hidden_model_mm"], rel=1e-3)


def test_a_loss_that_is_not_finite_ends_all_processes(clips, tmp_path):
    with pytest.raises(ValueError, match="so training stopped and wrote no weights"):
        train(changed(SMALL, devices=2, lr=1e30), clips, tmp_path)
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
