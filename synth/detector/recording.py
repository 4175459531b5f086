"""Read the recording of a real detector."""

from collections.abc import Sequence
from pathlib import Path

from dmae.data.clip import Clip
from dmae.formats.reading import DataConfig, load


def read_recording(path: Path, frames: Sequence[int] | None = None) -> Clip:
    """Read one recording, a clip or Shelf's text files. With `frames`, only the frames [first, end) are returned.

    Raises:
        FileNotFoundError: there is no such recording.
        ValueError: the recording has several clips, or does not have these frames.
    """
    kind = "shelf" if (path / "detection").is_dir() else "clip"
    try:
        clips = load(DataConfig(kind, str(path)))
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{error}; dmae convert makes clips of other recordings") from None
    if len(clips) != 1:
        raise ValueError(f"{path}: expected one recording, found {len(clips)} clips")
    clip = clips[0]
    if frames is None:
        return clip
    if len(frames) != 2 or not 0 <= frames[0] < frames[1] <= len(clip):
        raise ValueError(f"frames={list(frames)}: expected [first, end] within the {len(clip)} frames of {path}")
    return clip.select(frames=slice(*frames))
