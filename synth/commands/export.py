"""`synth export`: write a data set in the layout of another program."""

from pathlib import Path

from dmae.reporting.tables import counted
from synth.commands.config import ExportDataCommand
from synth.datasets.exporters.export import export


def run(config: ExportDataCommand, out: Path) -> None:
    names = ("splits", "skeleton", "every", "workers", "damaged", "robot", "about")
    options = {name: getattr(config, name) for name in names}
    summary = export(config.data, out, config.format, images=config.images.name, **options)
    for split, counts in summary["splits"].items():
        # Without images there are no masks, and some layouts count no persons.
        kinds = [key for key in ("image", "person", "mask") if counts.get("images") or counts.get(f"{key}s")]
        shown = ", ".join(counted(counts.get(f"{key}s", 0), key) for key in ("clip", *kinds))
        print(f"{out}: {split}: {shown}")
