"""`synth export`: write a data set in the layout of another program."""

from dataclasses import dataclass, field
from pathlib import Path

from dmae.parallel import Backend, running_on
from dmae.reporting.tables import counted
from synth.datasets.exporters.export import export
from synth.datasets.exporters.selection import PictureFormat, exporter

WRITES = "folder"
EXAMPLES = (
    "synth export data=runs/data format=coco out=runs/coco",
    "synth export data=runs/data format=yolo splits=runs/splits.json every=5 workers=4 out=runs/yolo",
    "synth export data=runs/data format=huggingface skeleton=body25 pictures=png out=runs/hub",
)


@dataclass(frozen=True)
class ExportDataCommand:
    """Write a data set in the layout of another program: images and annotations."""

    data: str = "???"
    """Folder of a data set, or of a clip."""
    format: str = field(default="coco", metadata={"choices": exporter})
    """Layout."""
    splits: str | None = None
    """JSON file that `synth split` wrote; by default all clips are in the split train."""
    skeleton: str | None = None
    """Skeleton of the joints; by default coco17, for panoptic always panoptic19."""
    every: int = 1
    """Number of frames from one image to the next; 1 for all."""
    pictures: PictureFormat = PictureFormat.jpg
    """File format of images."""
    workers: int = 1
    """Processes; -1 for one per core."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""
    damaged: bool = False
    """Export even if files are missing or damaged."""
    out: str = "???"
    """Folder to write, whole or not at all; it must be empty or not exist."""


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
        )
    for split, counts in summary["splits"].items():
        shown = ", ".join(counted(counts.get(f"{key}s", 0), key) for key in ("clip", "picture", "person", "mask"))
        print(f"{out}: {split}: {shown}")
