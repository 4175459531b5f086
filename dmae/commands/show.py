"""`dmae show`: any clip as contact sheet, video and Rerun recording."""

from pathlib import Path

from dmae.viewing.show import ShowConfig, show

WRITES = "folder"
EXAMPLES = (
    "dmae show data=runs/completed out=runs/show",
    "dmae show data=openpose data.path=recordings/walk data.fps=30 layers.detections=true",
    "dmae show data=runs/completed/000000 layers.truth=true layers.measured=false rerun=true",
)


def run(config: ShowConfig, out: Path) -> None:
    show(config, out)
