"""`dmae stress`: what breaks the methods, and at which level."""

from pathlib import Path

from dmae.evaluation.stress.config import StressConfig
from dmae.evaluation.stress.matrix import compute, prepare
from dmae.evaluation.stress.page import write_result
from dmae.evaluation.stress.words import breaking_tables, summary
from dmae.formats.reading import load
from dmae.reporting.tables import print_tables

WRITES = "folder"
EXAMPLES = (
    "dmae stress data=runs/test out=runs/stress workers=2",
    "dmae stress data=runs/test axes=[objects,jitter] levels.jitter=[1,2,4] methods=[linear,dmae] out=runs/stress",
    "dmae stress data=shelf data.path=$DMAE_DATA/shelf size=full workers=-1 out=runs/stress_shelf",
)


def run(config: StressConfig, out: Path) -> None:
    matrix = prepare(load(config.data), config, out / "cache")
    for note in matrix.plan.notes:
        print(note)
    print(matrix.forecast, flush=True)
    result = compute(matrix)
    write_result(result, out)
    print("\n".join(summary(result)))
    print_tables(breaking_tables(result)[:1])
    print(f"{out / 'stress.json'}\n{out / 'stress.html'}")


def interrupted(config: StressConfig, out: Path) -> str:
    kept = len(list((out / "cache").glob("*/*.json")))
    return f"{kept} results in {out / 'cache'} are kept; the same command computes the others"
