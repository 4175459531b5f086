"""`synth export`: write a data set in the layout of another program."""

from pathlib import Path

from dmae.parallel import running_on
from dmae.reporting.tables import counted
from synth.commands.config import ExportDataCommand
from synth.datasets.exporters.export import export


def run(config: ExportDataCommand, out: Path) -> None:
    with running_on(config.backend):
        summary = export(
            Path(config.data),
            out,
            config.format,
            splits=None if config.splits is None else Path(config.splits),
            skeleton=config.skeleton,
            every=config.every,
            pictures=config.pictures,
            workers=config.workers,
            damaged=config.damaged,
            robot=config.robot,
            about=config.about,
        )
    for split, counts in summary["splits"].items():
        shown = ", ".join(counted(counts.get(f"{key}s", 0), key) for key in ("clip", "picture", "person", "mask"))
        print(f"{out}: {split}: {shown}")
