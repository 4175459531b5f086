"""`synth export`: write a data set in the layout of another program."""

from pathlib import Path

from dmae.parallel import running_on
from dmae.reporting.tables import counted
from synth.commands.config import ExportDataCommand
from synth.datasets.exporters.export import export


def run(config: ExportDataCommand, out: Path) -> None:
    with running_on(config.backend):
        names = ("skeleton", "every", "pictures", "workers", "damaged", "robot", "about")
        options = {name: getattr(config, name) for name in names}
        splits = None if config.splits is None else Path(config.splits)
        summary = export(Path(config.data), out, config.format, splits=splits, **options)
    for split, counts in summary["splits"].items():
        # Without pictures there are no masks, and some layouts count no persons.
        kinds = [key for key in ("picture", "person", "mask") if counts.get("pictures") or counts.get(f"{key}s")]
        shown = ", ".join(counted(counts.get(f"{key}s", 0), key) for key in ("clip", *kinds))
        print(f"{out}: {split}: {shown}")
