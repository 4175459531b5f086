"""`dmae benchmark`: compare completion and capture on clips that are made here, with frozen checksums."""

import json
from dataclasses import replace
from pathlib import Path

from dmae.data.store import write_atomic
from dmae.evaluation.benchmark.run import BenchmarkConfig, benchmark
from dmae.evaluation.benchmark.tables import CHECKED, benchmark_tables, write_page
from dmae.reporting.tables import print_tables

WRITES = "folder"
EXAMPLES = (
    "dmae benchmark methods=[linear,dmae,my_module:fill] workers=2 out=runs/benchmark",
    "dmae benchmark size=full methods=[my_module:fill] against=runs/benchmark out=runs/mine data_folder=runs/benchmark/data",
)


def run(config: BenchmarkConfig, out: Path) -> None:
    scores = benchmark(replace(config, out=str(out)))
    write_atomic(out / "scores.json", json.dumps(scores))
    write_page(scores, out / "benchmark.html")
    print_tables(benchmark_tables(scores))
    print(CHECKED[scores["checksums"]])
    print(out / "scores.json", out / "benchmark.html", sep="\n")


def interrupted(config: BenchmarkConfig, out: Path) -> str:
    data = Path(config.data_folder) if config.data_folder else out / "data"
    whole = len(list(data.glob("given/*/*/[!.]*/clip.json")))
    return f"{whole} clips in {data} are made and captured; the same command goes on from there, and scores them again"
