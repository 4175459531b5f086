"""The project's own clips, see `dmae.data.store`."""

from pathlib import Path

from dmae.data.clip import Clip
from dmae.data.store import load_clip, save_clip
from dmae.formats.recordings.pose_files import PoseFile
from dmae.formats.registry import pose_reader, reader, recording_writer


@reader("clip", signs=[["clip.json"], ["manifest.jsonl"]], data_set=True)
def read_clip(path: Path) -> Clip:
    """A clip folder or a data set of clips, which synth generate and dmae capture write."""
    return load_clip(path)


@pose_reader("clip", signs=["clip.json"])
def read_clip_poses(path: Path) -> PoseFile:
    """The captured or completed poses of a clip folder."""
    clip = load_clip(path)
    if clip.poses is None:
        raise ValueError(f"{path}: clip {clip.id!r} has no poses; run dmae capture on it first")
    return PoseFile(clip.poses, clip.fps, clip.id)


@recording_writer("clip")
def write_clip(clip: Clip, path: Path) -> None:
    """A clip folder, with all data of the clip."""
    save_clip(clip, path)
