"""`synth show`: draw a simulated clip in its room as a contact sheet, a video and a Rerun recording."""

from pathlib import Path

from dmae.commands import show
from dmae.viewing.config import ShowConfig
from synth.rendering.rooms import draw_rooms


def run(config: ShowConfig, out: Path) -> None:
    show.run(config, out, draw_rooms)
