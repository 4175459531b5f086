"""Weights that come with the package: found by skeleton, readable, and used by default."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

import dmae
from dmae.commands import complete
from dmae.commands.config import CompleteCommand
from dmae.completion import weights
from dmae.completion.complete import CLASSES, completers
from dmae.completion.weights import find_shipped, load_model, model_card, save_model, shipped
from dmae.data.clip import Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, COCO17, HALPE26, SHELF14, Skeleton, fuse
from dmae.data.store import load_clip, save_clip, write_atomic
from dmae.evaluation.config import EvaluateConfig
from dmae.evaluation.evaluate import evaluate
from dmae.formats.reading import DataConfig
from tests.support import scored_clips
from tests.support.circling_people import circling_people, clip_of
from tests.support.completers import FPS, circling, untrained, with_holes


@pytest.fixture
def ours(tmp_path, monkeypatch) -> Path:
    """A package that ships weights for shelf14 alone."""
    monkeypatch.setattr(weights, "SHIPPED", tmp_path / "models")
    monkeypatch.setattr("dmae.completion.complete.SHIPPED", tmp_path / "models")
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


def test_a_model_that_is_trained_anew_into_its_folder_is_loaded_anew(tmp_path):
    poses, model = with_holes(circling(1), 1), untrained().model
    record = {"denoises": False, "calibration": [[1] * CLASSES] * 2}
    found = []
    for shift in (0.0, 0.1):
        with torch.no_grad():
            model.head.bias += shift
        save_model(model, SHELF14, tmp_path / "model", record)
        found.append(dmae.complete(poses, FPS, weights=tmp_path / "model", denoise=False, smooth=0).xyz)
    assert np.nanmax(np.abs(found[1] - found[0])) > 0.01


def test_without_common_joints_the_shipped_skeletons_are_listed(ours, monkeypatch):
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


def test_complete_finds_the_weights_for_each_clip(ours, tmp_path, capsys):
    truth = circling_people(60, 2, rng=np.random.default_rng(0))
    hidden = np.zeros(truth.source.shape, bool)
    hidden[20:30, :, BODY25.index("r_wrist")] = True
    poses = truth.without(hidden)
    save_clip(replace(clip_of(poses, "walk"), poses=poses), tmp_path / "clip")
    complete.run(CompleteCommand(str(tmp_path / "clip")), tmp_path / "out")
    assert "walk: poses are body25, completed with weights for shelf14; not completed: " in capsys.readouterr().out
    done = load_clip(tmp_path / "out").poses
    assert (done.source[hidden] == Source.COMPLETED).all()
    # By default the command rejects and smooths, and denoises where the weights were trained for it.
    completer = completers(ours / "shelf14")(BODY25)
    np.testing.assert_array_equal(done.xyz, completer(poses, FPS).xyz)


def test_evaluate_finds_the_weights_too(ours, tmp_path):
    """By default, with rejection, and online."""
    poses = circling(0, frames=120)
    save_clip(replace(clip_of(poses, "walk"), truth=poses), tmp_path / "clip")
    config = EvaluateConfig(
        DataConfig(path=str(tmp_path / "clip")),
        methods=["dmae", "dmae_reject", "dmae_denoise", "dmae_online"],
        input="true_poses",
    )
    plain, reject, denoise, online = (result["mean"]["hidden"]["mpjpe"] for result in evaluate(config)["results"])
    assert plain != online and max(plain, reject, online) < 150
    assert denoise == reject, "these weights were not trained to denoise, and dmae complete does not either"
    with pytest.raises(ValueError, match="not trained to denoise"):
        dmae.complete(poses, FPS, weights=ours / "shelf14", denoise=True)


@pytest.mark.parametrize("name", shipped())
def test_shipped_weights_are_whole_and_complete_poses(name):
    folder = weights.SHIPPED / name
    assert {path.name for path in folder.iterdir()} == {"MODEL_CARD.md", "model.json", "weights.safetensors"}
    _, skeleton, record = load_model(folder)
    assert skeleton.name == name and record["calibration"]
    card = (folder / "MODEL_CARD.md").read_text()
    assert record["sha256"] in card and weights._TERMS in card
    truth = convert(circling_people(60, 2, rng=np.random.default_rng(1)), skeleton)
    poses = with_holes(truth, 1)
    done = completers(None, denoise=False, reject=False, smooth=0.0)(skeleton)(poses, FPS)
    filled = done.source == Source.COMPLETED
    assert filled.any() and np.linalg.norm(done.xyz - truth.xyz, axis=-1)[filled].mean() < 0.15


def test_shipped_weights_are_small():
    assert sum(path.stat().st_size for path in weights.SHIPPED.rglob("*") if path.is_file()) < 20e6


def test_weights_that_are_not_finite_are_neither_saved_nor_loaded(tmp_path, monkeypatch):
    model = untrained().model
    record = {"denoises": False, "calibration": None}
    with torch.no_grad():
        next(model.parameters()).fill_(torch.nan)
    name = next(name for name, _ in model.named_parameters())
    with pytest.raises(
        ValueError, match=rf"not finite, or beyond 1e\+06, in {name}, of \d+ tensors: nothing was saved"
    ):
        save_model(model, SHELF14, tmp_path / "model", record)
    assert not (tmp_path / "model").exists()
    with monkeypatch.context() as patched:
        patched.setattr(weights, "check_finite", lambda *_: None)
        save_model(model, SHELF14, tmp_path / "model", record)
    with pytest.raises(ValueError, match=rf"1e\+06, in {name}, .*weights\.safetensors is of no use"):
        load_model(tmp_path / "model")


# The model card agrees with the files that it is made from.


@pytest.fixture
def trained(tmp_path):
    """Return the folder of a model that learned from two sets and was validated on a third."""
    folder = tmp_path / "model"
    clips = ["000000", "000001", "runs/000000", "validation 000000", "validation jumps/000003"]
    facts = {"denoises": False, "calibration": None, "steps": 1234, "validation_clips": clips[3:]}
    save_model(untrained().model, SHELF14, folder, facts)
    write_atomic(folder / "training.json", json.dumps({"clips": dict.fromkeys(clips, "")}))
    made = {"data": {"path": "runs/walks"}, "validation_data": ["runs/dances", "runs/jumps"]}
    made |= {"max_minutes": None, "learning": {"batch": 16, "lr": 0.002, "loss": "relative"}, "seed": 0}
    write_atomic(folder / "config.yaml", yaml.safe_dump(made))
    return folder


@pytest.fixture(scope="module")
def scores(tmp_path_factory):
    """Scores as `dmae evaluate` writes them."""
    folder = tmp_path_factory.mktemp("clip")
    save_clip(scored_clips.circling(frames=100), folder)
    return evaluate(scored_clips.config(folder, methods=["linear"], input="perturbed_poses"))


def scored(folder, scores, weights):
    write_atomic(folder / "scores.json", json.dumps(scores))
    asked = {"weights": str(weights), "input": "perturbed_poses", "reference": "truth", "skeleton": None, "smooth": 0.0}
    write_atomic(folder / "config.yaml", yaml.safe_dump(asked))
    return folder


def test_the_card_lists_data_command_and_scores(trained, scores, tmp_path):
    folder = scored(tmp_path / "scores", scores, trained)
    text = dmae.card(trained, command="make weights", scores=[folder])
    for fact in (
        "# D-MAE for shelf14",
        "2 clips of walks",
        "1 clip of runs",
        "1 clip of dances, 1 clip of jumps",
        "1234 steps, batch 16",
        "`make weights`",
        json.loads((trained / "model.json").read_text())["sha256"],
        f"## {scores['recording']}, `input=perturbed_poses smooth=0.0`",
        "| method | views | 1-5 | 6-15 | 16-40 | >40 |",
    ):
        assert fact in text
    assert max(map(len, text.splitlines())) < 200


def test_scores_of_other_weights_are_refused(trained, scores, tmp_path):
    save_model(untrained(residual=False).model, SHELF14, tmp_path / "other", {"denoises": False, "calibration": None})
    folder = scored(tmp_path / "scores", scores, tmp_path / "other")
    with pytest.raises(ValueError, match=r"scores are of other weights, .*other; score .*model with dmae evaluate"):
        model_card(trained, [folder], "make weights")
