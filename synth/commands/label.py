"""`synth label`: add contacts, forces and surface points to existing clips, from their body states."""

from pathlib import Path

from dmae.data.store import clip_folders
from dmae.reporting.tables import counted
from synth.commands.config import LabelCommand
from synth.datasets.physical_labels import label
from synth.labels.physical_labels import FILE


def run(config: LabelCommand, out: None) -> None:
    made = label(config.data, config.labels, workers=config.workers)
    there = len(clip_folders(Path(config.data))) - made
    had = f"; {counted(there, 'clip')} had them already" if there else ""
    print(f"{config.data}: {', '.join(config.labels)} added to {counted(made, 'clip')} ({FILE}){had}")


def interrupted(config: LabelCommand, out: None) -> str:
    return "clips are complete, each with its labels or without; the same command labels the others"
