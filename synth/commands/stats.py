"""`synth stats`: describe the contents of a data set on a page with a figure."""

from pathlib import Path

from dmae.reporting.tables import counted
from synth.commands.config import StatsCommand
from synth.datasets.statistics import PAGE, PICTURE, stats


def default_out(config: StatsCommand) -> Path:
    return Path(config.data) / "statistics"


def run(config: StatsCommand, out: Path) -> None:
    counts = stats(config.data, out, extra_data=config.extra_data, workers=config.workers)["counts"]
    print(f"{out / PAGE}: {counted(counts['clips'], 'clip')}, {counted(counts['frames'], 'frame')}")
    print(out / PICTURE)
