"""Recordings by configuration: which, where, and through which of their cameras."""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from dmae.clip import Clip
from dmae.conventions import Unit, Up
from dmae.formats.shelf import read_shelf
from dmae.store import clip_folders, load_clip


class Format(StrEnum):
    """What a recording is stored as."""

    clip = "clip"
    shelf = "shelf"


@dataclass(frozen=True)
class DataConfig:
    """Where clips come from."""

    name: Format = Format.clip
    path: str = "???"
    """Folder of the recording, of a clip, or of a data set of clips."""
    cameras: list[int] | None = None
    """Use these views only, counted from 0; by default all."""
    calibration: str | None = None
    """Calibration file, or folder of them; by default the one found in `path`."""
    detections: str | None = None
    """Folder of the detections; by default the one found in `path`."""
    fps: float | None = None
    """Frames per second, where the files do not say."""
    size: list[int] | None = None
    """Image width and height, px, where the files do not say."""
    skeleton: str | None = None
    """Skeleton of the detections, where the files do not say or say wrong."""
    unit: Unit | None = None
    """Lengths of the calibration; by default what its format prescribes. So are `up` and `inverse`."""
    up: Up | None = None
    inverse: bool | None = None
    """Whether extrinsics are world_from_cam."""
    offsets: list[int] | None = None
    """By how many frames each camera of the files started late: its frame k is frame k + offset of the clip."""


class Clips(Sequence):
    """The clips of a data set, each read when it is asked for."""

    def __init__(self, config: DataConfig):
        self.config = config
        path = Path(config.path)
        self.folders = [path] if config.name == Format.shelf else clip_folders(path)

    def __len__(self) -> int:
        return len(self.folders)

    def __getitem__(self, index: int) -> Clip:
        read = read_shelf if self.config.name == Format.shelf else load_clip
        return _restrict(read(self.folders[index]), self.config.cameras)


def load(config: DataConfig) -> Clips:
    """The clips that a configuration names, restricted to its cameras.

    Raises:
        FileNotFoundError: nothing of the kind is there.
        ValueError: a file is malformed, or a clip lacks one of the cameras; raised when the clip is read.
    """
    return Clips(config)


def is_data_set(config: DataConfig) -> bool:
    """Whether the path holds clips in folders of their own, rather than being one itself."""
    return config.name == Format.clip and clip_folders(Path(config.path)) != [Path(config.path)]


def _restrict(clip: Clip, cameras: list[int] | None) -> Clip:
    if cameras is None:
        return clip
    unknown = [camera for camera in cameras if not 0 <= camera < len(clip.rig)]
    if unknown or not cameras or len(set(cameras)) != len(cameras):
        there = ", ".join(f"{i} ({name})" for i, name in enumerate(clip.rig.names))
        raise ValueError(f"data.cameras={cameras}: expected different cameras of clip {clip.id!r}, which has {there}")
    return clip.select(views=list(cameras))
