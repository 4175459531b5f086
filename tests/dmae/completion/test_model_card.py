"""The model card agrees with the files that it is made from."""

import json

import pytest
import yaml

from dmae.commands import card as command
from dmae.commands.card import CardCommand
from dmae.completion.model_card import model_card
from dmae.completion.weights import save_model
from dmae.data.skeleton import SHELF14
from dmae.data.store import save_clip
from dmae.evaluation.evaluate import evaluate
from dmae.files.contents import write_atomic
from tests.support.completers import untrained
from tests.support.scored_clips import circling, config


@pytest.fixture
def trained(tmp_path):
    """Return the folder of a model that learned from two sets and was validated on a third."""
    folder = tmp_path / "model"
    clips = ["000000", "000001", "runs/000000", "validation 000000", "unseen jumps/000003"]
    facts = {"denoises": False, "calibration": None, "steps": 1234, "validation_clips": clips[3:]}
    save_model(untrained().model, SHELF14, folder, facts)
    write_atomic(folder / "training.json", json.dumps({"clips": dict.fromkeys(clips, "")}))
    made = {"data": {"path": "runs/walks"}, "validation_data": ["runs/dances", "runs/jumps"]}
    made |= {"max_minutes": None, "learning": {"batch": 16, "lr": 0.002, "loss": "euclidean"}, "seed": 0}
    write_atomic(folder / "config.yaml", yaml.safe_dump(made))
    return folder


@pytest.fixture(scope="module")
def scores(tmp_path_factory):
    """Scores as `dmae evaluate` writes them."""
    folder = tmp_path_factory.mktemp("clip")
    save_clip(circling(frames=100), folder)
    return evaluate(config(folder, methods=["linear"], input="perturbed_poses"))


def scored(folder, scores, weights):
    write_atomic(folder / "scores.json", json.dumps(scores))
    asked = {"weights": str(weights), "input": "perturbed_poses", "reference": "truth", "skeleton": None, "smooth": 0.0}
    write_atomic(folder / "config.yaml", yaml.safe_dump(asked))
    return folder


def test_the_card_lists_data_command_and_scores(trained, scores, tmp_path, capsys):
    folder = scored(tmp_path / "scores", scores, trained)
    command.run(CardCommand(str(trained), [str(folder)], "make weights"), None)
    assert "MODEL_CARD.md" in capsys.readouterr().out
    card = (trained / "MODEL_CARD.md").read_text()
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
        assert fact in card
    assert max(map(len, card.splitlines())) < 200


def test_scores_of_other_weights_are_refused(trained, scores, tmp_path):
    save_model(untrained(residual=False).model, SHELF14, tmp_path / "other", {"denoises": False, "calibration": None})
    folder = scored(tmp_path / "scores", scores, tmp_path / "other")
    with pytest.raises(ValueError, match=r"scores are of other weights, .*other; score .*model with dmae evaluate"):
        model_card(trained, [folder], "make weights")
