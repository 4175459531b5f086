"""`dmae convert`: a recording to another format, or to a clip."""

from pathlib import Path

from dmae.commands.config import ConvertCommand
from dmae.commands.data_sets import ClipSet, check_apart, each_clip, settings_of
from dmae.formats.reading import Clips
from dmae.formats.writing import write_recording
from dmae.reporting.tables import counted


def run(config: ConvertCommand, out: Path) -> None:
    check_apart(out, Path(config.data.path))
    own = config.format == "clip"
    several = own and Clips(config.data).data_set
    with ClipSet(out, settings_of("dmae convert", config, Path(config.data.path)) if several else None) as made:
        for clip, name, folder in each_clip(config.data, out, "converting"):
            lacking = None
            if own:
                made.write(clip, name)
            else:
                lacking = write_recording(clip, folder, config.format)
            size = f"{counted(len(clip), 'frame')}, {counted(len(clip.rig), 'camera')}"
            print(f"{folder}: {size}, {clip.detections.skeleton.name}")
            for note in clip.provenance.get("notes", ()):
                print(f"  {note}")
            if lacking:
                print(f"  read it with {lacking}, which its files do not state")


def interrupted(config: ConvertCommand, out: Path) -> str:
    return f"{out} may lack files; remove it, and give the same command again"
