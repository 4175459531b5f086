"""`dmae show`: any clip as contact sheet, video and Rerun recording."""

from pathlib import Path

from dmae.viewing.config import ShowConfig
from dmae.viewing.show import show


def run(config: ShowConfig, out: Path) -> None:
    show(config, out)
