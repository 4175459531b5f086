"""`dmae benchmark`: compare completion and capture on clips that are made here, with frozen checksums."""

from dataclasses import replace
from pathlib import Path

from dmae.evaluation.benchmark.page import CHECKED, benchmark_tables, write_scores
from dmae.evaluation.benchmark.run import benchmark
from dmae.evaluation.config import BenchmarkConfig
from dmae.reporting.tables import print_tables


def run(config: BenchmarkConfig, out: Path) -> None:
    scores = benchmark(replace(config, out=str(out)))
    write_scores(scores, out)
    print_tables([*benchmark_tables(scores).values()])
    print(CHECKED[scores["checksums"]])
    print(out / "scores.json", out / "benchmark.html", sep="\n")


def interrupted(config: BenchmarkConfig, out: Path) -> str:
    data = Path(config.data_folder) if config.data_folder else out / "data"
    whole = len(list(data.glob("given/*/*/[!.]*/clip.json")))
    return f"{whole} clips in {data} are made and captured; the same command continues, and scores them again"
