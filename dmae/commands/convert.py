"""`dmae convert`: a recording to another format, or to a clip."""

from pathlib import Path

from dmae.commands.config import ConvertCommand
from dmae.commands.data_sets import ClipSet, check_apart, describe_length, each_clip, settings_of
from dmae.data.clip import Clip
from dmae.formats.reading import Clips
from dmae.formats.writing import write_recording
from dmae.reporting.tables import counted


def run(config: ConvertCommand, out: Path) -> None:
    check_apart(out, Path(config.data.path))
    if config.format != "clip":
        for clip, _, folder in each_clip(config.data, out, "converting"):
            lacking = write_recording(clip, folder, config.format)
            _print(clip, folder)
            if lacking:
                print(f"  read it with {lacking}, which its files do not state")
        return
    clips = Clips(config.data)
    settings = settings_of("dmae convert", config, Path(config.data.path)) if clips.data_set else None
    names, tasks = [folder.name for folder in clips.folders], ((clips, number) for number in range(len(clips)))
    with ClipSet(out, settings) as made:
        for name, converted, _ in made.fill(_read, names, tasks, 1, "converting"):
            if converted is not None:
                _print(converted, out if made.alone else out / name)


def _read(clips: Clips, number: int) -> tuple[Clip, list[str]]:
    return clips[number], []


def _print(clip: Clip, folder: Path) -> None:
    print(f"{folder}: {describe_length(clip)}, {counted(len(clip.rig), 'camera')}, {clip.detections.skeleton.name}")
    for note in clip.provenance.get("notes", ()):
        print(f"  {note}")


def interrupted(config: ConvertCommand, out: Path) -> str:
    return f"{out} may lack clips; remove it if it exists, and give the same command again"
