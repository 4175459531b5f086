"""`synth stats`: describe the contents of a data set on a page with a figure."""

from dataclasses import dataclass, field
from pathlib import Path

from dmae.parallel import Backend, running_on
from dmae.reporting.tables import counted
from synth.datasets.statistics import PAGE, PICTURE, describe

WRITES = "folder"
EXAMPLES = ("synth stats data=runs/data", "synth stats data=runs/hug extra_data=[runs/fight,runs/dance] out=runs/card")


@dataclass(frozen=True)
class StatsCommand:
    """Describe a data set: occlusion by joint and cause, contacts, people, distances, angles, motion."""

    data: str = "???"
    """Folder of a data set, or of a clip."""
    extra_data: list[str] = field(default_factory=list)
    """More data sets that the same page describes."""
    workers: int = 1
    """Processes; -1 for one per core."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""
    out: str | None = None
    """Folder of the page, its figure and the numbers; by default `statistics` in the data set."""


def default_out(config: StatsCommand) -> Path:
    return Path(config.data) / "statistics"


def run(config: StatsCommand, out: Path) -> None:
    data = [Path(path) for path in (config.data, *config.extra_data)]
    with running_on(config.backend):
        found = describe(data, out, workers=config.workers)
    print(f"{out / PAGE}: {counted(found.counts['clips'], 'clip')}, {counted(found.counts['frames'], 'frame')}")
    print(out / PICTURE)
