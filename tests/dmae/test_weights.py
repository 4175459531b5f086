"""Weights that come with the package: found by skeleton, sound, and what is used when none are named."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae import weights
from dmae.calibrate import CLASSES
from dmae.clip import Source
from dmae.commands import CompleteCommand, run_complete
from dmae.complete import completers
from dmae.data import DataConfig
from dmae.evaluate import EvaluateConfig, evaluate
from dmae.hiding import HidingConfig
from dmae.mapping import convert
from dmae.skeleton import BODY25, COCO17, HALPE26, SHELF14, Skeleton, fuse
from dmae.store import load_clip, save_clip
from dmae.weights import find_shipped, load_model, save_model, shipped

from .completing import FPS, strolling, untrained, with_holes
from .strollers import clip_of, strollers


@pytest.fixture
def ours(tmp_path, monkeypatch) -> Path:
    """A package that ships weights for shelf14 alone."""
    monkeypatch.setattr(weights, "SHIPPED", tmp_path / "models")
    save_model(
        untrained().model, SHELF14, tmp_path / "models/shelf14", {"denoises": False, "calibration": [[1] * CLASSES] * 2}
    )
    return tmp_path / "models"


def test_weights_are_found_by_skeleton_or_else_by_most_common_joints(ours):
    assert shipped() == ["shelf14"]
    assert find_shipped(BODY25) == ours / "shelf14"
    for name in ("body25", "coco17"):
        (ours / name).mkdir()
        (ours / name / "model.json").write_text("{}")
    assert [find_shipped(skeleton).name for skeleton in (SHELF14, BODY25, COCO17)] == ["shelf14", "body25", "coco17"]
    assert find_shipped(HALPE26).name == "body25"


def test_without_any_in_common_what_there_is_is_listed(ours, monkeypatch):
    (ours / "body25").mkdir()
    (ours / "body25" / "model.json").write_text("{}")
    for skeleton in (Skeleton("lizard", ("tail",), (-1,)), fuse(BODY25, SHELF14)):
        with pytest.raises(
            ValueError, match=r"come with this package, which has those for body25, shelf14.*weights=\.\."
        ):
            find_shipped(skeleton)
    monkeypatch.setattr(weights, "SHIPPED", ours / "nowhere")
    with pytest.raises(ValueError, match="which has those for no skeleton"):
        find_shipped(BODY25)


def test_completing_takes_the_weights_for_each_clip(ours, tmp_path, capsys):
    truth = strollers(60, 2, rng=np.random.default_rng(0))
    hidden = np.zeros(truth.source.shape, bool)
    hidden[20:30, :, BODY25.index("r_wrist")] = True
    poses = truth.without(hidden)
    save_clip(replace(clip_of(poses, "walk"), poses=poses), tmp_path / "clip")
    run_complete(CompleteCommand(str(tmp_path / "clip")), tmp_path / "out")
    assert "walk: poses are body25, completed with weights for shelf14; not completed: " in capsys.readouterr().out
    done = load_clip(tmp_path / "out").poses
    assert (done.source[hidden] == Source.COMPLETED).all()
    np.testing.assert_array_equal(done.xyz, completers(ours / "shelf14")(BODY25)(poses, FPS).xyz)


def test_evaluation_takes_them_too(ours, tmp_path):
    """As they are, with rejection, and while frames come."""
    poses = strolling(0, frames=120)
    save_clip(replace(clip_of(poses, "walk"), truth=poses), tmp_path / "clip")
    config = EvaluateConfig(
        DataConfig(path=str(tmp_path / "clip")),
        methods=["dmae", "dmae_reject", "dmae_online"],
        hide="clean",
        hiding=HidingConfig(bursts=6.0),
    )
    plain, reject, online = (result["mean"]["hidden"]["mpjpe"] for result in evaluate(config)["results"])
    assert plain != online and max(plain, reject, online) < 150
    with pytest.raises(ValueError, match="not trained to denoise"):
        evaluate(replace(config, methods=["dmae_denoise"]))


@pytest.mark.parametrize("name", shipped())
def test_what_is_shipped_is_whole_and_completes(name):
    folder = weights.SHIPPED / name
    assert {path.name for path in folder.iterdir()} == {"MODEL_CARD.md", "model.json", "weights.safetensors"}
    _, skeleton, record = load_model(folder)
    assert skeleton.name == name and record["calibration"]
    assert record["sha256"] in (folder / "MODEL_CARD.md").read_text()
    truth = convert(strollers(60, 2, rng=np.random.default_rng(1)), skeleton)
    poses = with_holes(truth, 1)
    done = completers(None)(skeleton)(poses, FPS)
    filled = done.source == Source.COMPLETED
    assert filled.any() and np.linalg.norm(done.xyz - truth.xyz, axis=-1)[filled].mean() < 0.15


def test_what_is_shipped_is_small():
    assert sum(path.stat().st_size for path in weights.SHIPPED.rglob("*") if path.is_file()) < 20e6
