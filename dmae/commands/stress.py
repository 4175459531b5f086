"""`dmae stress`: what breaks the methods, and at which level."""

from pathlib import Path

from dmae.evaluation.config import StressConfig
from dmae.evaluation.stress.matrix import CACHE, compute, prepare, time_of
from dmae.evaluation.stress.page import breaking_tables, summary, write_result
from dmae.formats.reading import Clips
from dmae.progress import duration
from dmae.reporting.tables import print_tables


def run(config: StressConfig, out: Path) -> None:
    clips = Clips(config.data)
    matrix = prepare(clips, config, out / CACHE)
    for note in matrix.plan.notes:
        print(note)
    if config.dry_run:
        print(f"{matrix.forecast}: about {duration(time_of(matrix))}")
        return
    print(matrix.forecast, flush=True)
    result = compute(matrix)
    write_result(result, out)
    print("\n".join(summary(result)))
    print_tables(breaking_tables(result)[:1])
    print(f"{out / 'stress.json'}\n{out / 'stress.html'}")


def interrupted(config: StressConfig, out: Path) -> str:
    kept = len((out / CACHE).read_text().splitlines()) if (out / CACHE).is_file() else 0
    return f"{kept} results in {out / CACHE} are kept; the same command computes the others"
