"""The project's own clips, see `dmae.data.store`."""

from pathlib import Path

from dmae.data.clip import Clip
from dmae.data.store import load_clip, save_clip
from dmae.formats.registry import reader, recording_writer


@reader("clip", signs=[["clip.json"], ["manifest.jsonl"]], data_set=True)
def read_clip(path: Path) -> Clip:
    """A clip folder, or a data set of them, as synth generate and dmae capture write."""
    return load_clip(path)


@recording_writer("clip")
def write_clip(clip: Clip, path: Path) -> None:
    """A clip folder, with everything that is known of the clip."""
    save_clip(clip, path)
