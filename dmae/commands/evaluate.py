"""`dmae evaluate`: score methods over clips and camera subsets."""

from pathlib import Path

from dmae.data.json_text import json_text
from dmae.data.store import write_atomic
from dmae.evaluation.evaluate import EvaluateConfig, evaluate
from dmae.metrics.tables import score_tables
from dmae.reporting.tables import print_tables

WRITES = "folder"
EXAMPLES = (
    "dmae evaluate data=runs/test methods=[measured,linear,dmae] out=runs/scores",
    "dmae evaluate data=shelf data.path=$DMAE_DATA/shelf views=[5,4,3] out=runs/scores_shelf",
)


def run(config: EvaluateConfig, out: Path) -> None:
    scores = evaluate(config)
    path = out / "scores.json"
    write_atomic(path, json_text(scores))
    print_tables(score_tables(scores))
    print(path)
