"""`dmae card`: a model card in the folder of trained weights."""

from pathlib import Path

from dmae.commands.config import CardCommand
from dmae.completion.weights import model_card
from dmae.files.contents import write_atomic


def run(config: CardCommand, out: None) -> None:
    folder = Path(config.weights)
    path = folder / "MODEL_CARD.md"
    write_atomic(path, model_card(folder, [Path(scores) for scores in config.scores], config.command))
    print(path)
