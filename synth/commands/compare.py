"""`synth compare`: compare the detections of a recording with those of its simulation."""

import sys
from dataclasses import dataclass, field, replace
from pathlib import Path

from dmae.formats.reading import DataConfig, load
from dmae.parallel import Backend, running_on
from dmae.reporting.tables import print_tables
from synth.detector.comparison import Limits, compare, table, write_page
from synth.detector.statistics import measure, measure_all, read_recording

WRITES = "folder"
EXAMPLES = (
    "synth compare real=$DMAE_DATA/shelf sim=runs/twin out=runs/compare",
    "synth compare real=recording sim=runs/data frames=[0,500] limits.miss=0.05 workers=2",
)


@dataclass(frozen=True)
class CompareCommand:
    """Compare the detections of a recording and of its simulation. Exits with status 1 if a limit is exceeded."""

    real: str = "???"
    """Folder of the recording: a clip, which `dmae convert` makes from any format, or Shelf's text files."""
    sim: str = "???"
    """Folder of the simulated clips."""
    frames: list[int] | None = None
    """First frame of the recording, and the one after the last; by default all."""
    limits: Limits = field(default_factory=Limits)
    workers: int = 1
    """Processes; -1 for one per core."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""
    out: str = "runs/compare"
    """Folder of the page, `compare.html`."""


def run(config: CompareCommand, out: Path) -> None:
    """Print the comparison and write its page. Exit with status 1 if a limit is exceeded.

    Raises:
        ValueError: no person can be measured in the recording or in the simulation, or their skeletons differ.
    """
    real = measure(read_recording(Path(config.real), config.frames))
    clips = load(DataConfig("clip", config.sim))
    with running_on(config.backend):
        sim = replace(measure_all(clips, len(clips), config.workers), name=Path(config.sim).name)
    rows = compare(real, sim, config.limits)
    print_tables([table(rows)])
    write_page(out / "compare.html", real, sim, rows)
    print(out / "compare.html")
    exceeded = [row.what for row in rows if row.exceeded]
    if exceeded:
        sys.exit(f"{len(exceeded)} limits are exceeded: {', '.join(exceeded)}")
