"""Read recordings: recognise the format, call its reader, select frames and views."""

from collections.abc import Sequence
from copy import copy
from dataclasses import fields
from fnmatch import fnmatch
from pathlib import Path

from dmae.data.clip import Clip
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.data.store import clip_folders
from dmae.files.names import PICTURES, VIDEOS
from dmae.formats.calibrations.conventions import Convention
from dmae.formats.calibrations.files import CalibrationSource, convention_of
from dmae.formats.pictures.camera_pictures import with_pictures
from dmae.formats.pictures.camera_videos import with_videos
from dmae.formats.recordings.data_config import DataConfig
from dmae.formats.recordings.selection import offsets_of_all, select_frames, select_views, shift_views
from dmae.formats.registry import RecordingReader, reader

_OPTIONS = {
    "calibration": ("calibration", "size", "unit", "up", "inverse"),
    "detections": ("detections",),
    "fps": ("fps",),
    "skeleton": ("skeleton",),
}
"""The arguments that readers can take, each with the fields of `DataConfig` from which it is made."""


class Clips(Sequence):
    """The clips of a data set, or of a single recording. A clip is read when it is accessed.

    Attributes:
        numbers: Numbers of these clips in their data set.
        folders: Folders of these clips.
        total: Number of clips in the data set.
        names: Names of the folders of all clips in the data set.
    """

    def __init__(self, config: DataConfig):
        if config.videos is not None and config.images is not None:
            raise ValueError("data.videos and data.images: expected one of them, as both are backgrounds")
        self.config = config
        self.reader = _reader(config)
        self.folders = _folders(config, self.reader)
        self.total = len(self.folders)
        self.names = [folder.name for folder in self.folders]
        self.numbers = range(self.total)

    def part(self, numbers: range) -> "Clips":
        """Return only the clips of the data set with these numbers."""
        part = copy(self)
        part.numbers, part.folders = numbers, [self.folders[number - self.numbers.start] for number in numbers]
        return part

    def __len__(self) -> int:
        return len(self.folders)

    def __getitem__(self, index: int) -> Clip:
        config, folder = self.config, self.folders[index]
        arguments = _arguments(config, self.reader, folder)
        try:
            clip = self.reader.function(folder, **arguments)
            clip.check_numbers()
            if config.videos is not None:
                clip = with_videos(clip, Path(config.videos))
            if config.images is not None:
                clip = with_pictures(clip, Path(config.images))
            offsets = offsets_of_all(config.offsets, clip.rig.names)
        except ValueError as error:
            if str(folder) in str(error):
                raise
            raise ValueError(f"{folder}: {error}") from None
        except FileNotFoundError as error:
            if folder.exists():
                raise
            raise FileNotFoundError(f"{folder}: no such file or folder. {error}") from None
        return select_views(select_frames(shift_views(clip, offsets), config.frames), config.cameras)


def load(config: DataConfig) -> Clips:
    """Return the clips that a configuration names, restricted to its frames and cameras.

    `provenance["notes"]` of each clip contains notes on missing frames, and on decisions of the reader that can be
    wrong.

    Raises:
        FileNotFoundError: the recording does not exist.
        ValueError: a file is malformed, an option that the files need is missing, or a clip lacks one of the cameras
            or frames. It is raised when the clip is read.
    """
    return Clips(config)


def is_data_set(config: DataConfig) -> bool:
    """Return whether the path contains one folder per clip, and is not itself a clip."""
    return _folders(config, _reader(config)) != [Path(config.path)]


def written_convention(config: DataConfig) -> Convention | None:
    """Return the convention by which the calibration is read; None if the format takes no calibration."""
    if "calibration" not in _reader(config).options:
        return None
    path = Path(config.calibration or config.path)
    return convention_of(path, unit=config.unit, up=config.up, inverse=config.inverse)


def recognise(path: Path) -> str:
    """Return the name of the format of a recording, recognised by the names of its files.

    Raises:
        FileNotFoundError: the path does not exist.
        ValueError: no format is recognised, or several are.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: expected a clip, a data set or a recording, found no such file or folder")
    for general in (False, True):
        entries = [entry for entry in reader.values() if entry.general == general]
        found = [entry.name for entry in entries if _is_recognised(path, entry)]
        if len(found) > 1:
            raise ValueError(f"{path}: expected files of one format, found {', '.join(found)}; name it by data=...")
        if found:
            return found[0]
    if _holds_videos(path):
        raise ValueError(
            f"{path}: found videos, or folders of pictures, expected detections in them; use dmae run videos={path} "
            f"calibration=... for people in 3D, or dmae detect videos={path} calibration=... for detections"
        )
    if _is_picture(path) or (path.is_dir() and any(_is_picture(file) for file in path.iterdir())):
        raise ValueError(
            f"{path}: found pictures, expected detections in them; dmae detect photos={path} finds the people of "
            "photographs, in 2D. People in 3D need a folder of pictures, or a video, of each camera"
        )
    there = ", ".join(sorted(item.name for item in path.iterdir())[:6]) if path.is_dir() else "a file"
    raise ValueError(
        f"{path}: expected a clip, a data set or a recording, found {there or 'an empty folder'}; no format is "
        f"recognised, data=... names one of {', '.join(reader)}"
    )


def _holds_videos(path: Path) -> bool:
    """Return whether a path is a video, or contains a video or a folder of images."""
    files = [path] if path.is_file() else list(path.iterdir())
    if any(file.suffix.lower() in VIDEOS for file in files):
        return True
    return any(any(map(_is_picture, file.iterdir())) for file in files if file.is_dir())


def _is_picture(file: Path) -> bool:
    return file.suffix.lower() in PICTURES


def _is_recognised(path: Path, entry: RecordingReader) -> bool:
    if path.is_file():
        return fnmatch(path.name, entry.file)
    return any(all(any(path.glob(pattern)) for pattern in signs) for signs in entry.signs)


def _reader(config: DataConfig) -> RecordingReader:
    return reader.find(recognise(Path(config.path)) if config.name is None else config.name)


def _folders(config: DataConfig, entry: RecordingReader) -> list[Path]:
    path = Path(config.path)
    return clip_folders(path) if entry.data_set else [path]


def _arguments(config: DataConfig, entry: RecordingReader, path: Path) -> dict:
    """Return the arguments that a reader takes, by name.

    Raises:
        ValueError: the configuration has options that the reader does not take.
    """
    refusable = {name for option, names in _OPTIONS.items() if option not in entry.options for name in names}
    given = [field.name for field in fields(config) if getattr(config, field.name) is not None]
    refused = [name for name in given if name in refusable]
    if refused:
        options = ", ".join(f"data.{name}" for name in refused)
        raise ValueError(f"{path}: data={entry.name} says that itself; leave out {options}")
    size = tuple(config.size) if config.size else None
    values = {
        "calibration": CalibrationSource(config.calibration, size, config.unit, config.up, config.inverse),
        "detections": None if config.detections is None else Path(config.detections),
        "fps": config.fps,
        "skeleton": None if config.skeleton is None else _skeleton(config.skeleton),
    }
    return {option: values[option] for option in entry.options}


def _skeleton(name: str) -> Skeleton:
    try:
        return get_skeleton(name)
    except KeyError as error:
        raise ValueError(f"data.skeleton={name}: {error.args[0]}") from None
