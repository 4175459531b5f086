"""`dmae card`: a model card in the folder of trained weights."""

from dataclasses import dataclass, field
from pathlib import Path

from dmae.completion.weights import model_card
from dmae.files.contents import write_atomic

WRITES = None
EXAMPLES = ('dmae card weights=runs/model scores=[runs/scores] command="make weights"',)


@dataclass(frozen=True)
class CardCommand:
    """Describe trained weights: training data and scores. Writes `MODEL_CARD.md` to their folder."""

    weights: str = "???"
    """Folder that `dmae train` wrote; the card is written there."""
    scores: list[str] = field(default_factory=list)
    """Folders that `dmae evaluate` wrote with these weights."""
    command: str = "???"
    """Command line that makes these weights, data included."""


def run(config: CardCommand, out: None) -> None:
    folder = Path(config.weights)
    path = folder / "MODEL_CARD.md"
    write_atomic(path, model_card(folder, [Path(scores) for scores in config.scores], config.command))
    print(path)
