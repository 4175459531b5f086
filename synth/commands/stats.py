"""`synth stats`: describe the contents of a data set on a page with a figure."""

from pathlib import Path

from dmae.parallel import running_on
from dmae.reporting.tables import counted
from synth.commands.config import StatsCommand
from synth.datasets.statistics import PAGE, PICTURE, describe


def default_out(config: StatsCommand) -> Path:
    return Path(config.data) / "statistics"


def run(config: StatsCommand, out: Path) -> None:
    data = [Path(path) for path in (config.data, *config.extra_data)]
    with running_on(config.backend):
        found = describe(data, out, workers=config.workers)
    print(f"{out / PAGE}: {counted(found.counts['clips'], 'clip')}, {counted(found.counts['frames'], 'frame')}")
    print(out / PICTURE)
