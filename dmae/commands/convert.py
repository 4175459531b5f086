"""`dmae convert`: a recording to another format, or to a clip."""

from contextlib import nullcontext
from pathlib import Path

from dmae.commands.config import ConvertCommand
from dmae.commands.data_sets import ClipSet, each_clip, settings_of
from dmae.formats.reading import Clips
from dmae.formats.writing import write_recording
from dmae.reporting.tables import counted


def run(config: ConvertCommand, out: Path) -> None:
    several = Clips(config.data).data_set and config.format == "clip"
    made = ClipSet(out, settings_of("dmae convert", config, Path(config.data.path))) if several else None
    with made or nullcontext():
        for clip, name, folder in each_clip(config.data, out, "converting"):
            if made:
                made.write(clip, name)
            lacking = None if made else write_recording(clip, folder, config.format)
            size = f"{counted(len(clip), 'frame')}, {counted(len(clip.rig), 'camera')}"
            print(f"{folder}: {size}, {clip.detections.skeleton.name}")
            for note in clip.provenance.get("notes", ()):
                print(f"  {note}")
            if lacking:
                print(f"  read it with {lacking}, which its files do not state")


def interrupted(config: ConvertCommand, out: Path) -> str:
    return f"{out} may lack files; remove it, and give the same command again"
