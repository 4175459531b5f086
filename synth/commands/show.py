"""`synth show`: draw a simulated clip in its room as a contact sheet, a video and a Rerun recording."""

from pathlib import Path

from dmae.viewing.config import ShowConfig
from dmae.viewing.show import show
from synth.viewing.rooms import draw_rooms

WRITES = "folder"
EXAMPLES = (
    "synth show data=runs/data/000000 out=runs/show",
    "synth show data=runs/data/000000 frames=8 views=[0,2] width=640 rerun=true",
)


def run(config: ShowConfig, out: Path) -> None:
    show(config, out, draw_rooms)
