"""Recordings by configuration: which, where, and through which of their cameras."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from itertools import combinations
from pathlib import Path

import numpy as np

from dmae.clip import OF_DETECTIONS, Clip, Detections2D
from dmae.conventions import Convention, Unit, Up
from dmae.formats import easymocap, panoptic
from dmae.formats.calibration import convention_of, read_calibration
from dmae.formats.coco import read_coco
from dmae.formats.openpose import read_openpose, tell_apart
from dmae.formats.pose2sim import read_pose2sim
from dmae.formats.recording import Recording, to_clip
from dmae.formats.released import read_released
from dmae.formats.shelf import read_shelf
from dmae.skeleton import BODY25, PANOPTIC19, SHELF14, Skeleton, get_skeleton
from dmae.store import clip_folders, load_clip


class Format(StrEnum):
    """What a recording is stored as."""

    clip = "clip"
    shelf = "shelf"
    openpose = "openpose"
    pose2sim = "pose2sim"
    easymocap = "easymocap"
    panoptic = "panoptic"
    coco = "coco"
    released = "released"


@dataclass(frozen=True)
class DataConfig:
    """Where clips come from."""

    name: Format = Format.clip
    path: str = "???"
    """Folder of the recording, of a clip, or of a data set of clips."""
    cameras: list[int] | None = None
    """Use these views only, counted from 0; by default all."""
    frames: list[int] | None = None
    """First frame that is used, and the one after the last; by default all."""
    calibration: str | None = None
    """Calibration file, or folder of them; by default the one found in `path`."""
    detections: str | None = None
    """Folder of the detections, of COCO a file of them too; by default what is found in `path`."""
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
    """By how many frames each camera of the files started late: its frame k is frame k + offset of the clip. In the
    order of the calibration."""


class Clips(Sequence):
    """The clips of a data set, each read when it is asked for."""

    def __init__(self, config: DataConfig):
        self.config = config
        path = Path(config.path)
        self.folders = clip_folders(path) if config.name == Format.clip else [path]

    def __len__(self) -> int:
        return len(self.folders)

    def __getitem__(self, index: int) -> Clip:
        clip = _READERS[self.config.name](self.config, self.folders[index])
        return _restrict(_cut(_shift(clip, self.config.offsets), self.config.frames), self.config.cameras)


def load(config: DataConfig) -> Clips:
    """The clips that a configuration names, restricted to its frames and cameras.

    Of what was absent or had to be guessed in reading a clip, its `provenance["notes"]` tell.

    Raises:
        FileNotFoundError: nothing of the kind is there.
        ValueError: a file is malformed, an option that the files make necessary is missing, or a clip lacks one
            of the cameras or frames; raised when the clip is read.
    """
    return Clips(config)


def is_data_set(config: DataConfig) -> bool:
    """Whether the path holds clips in folders of their own, rather than being one itself."""
    return config.name == Format.clip and clip_folders(Path(config.path)) != [Path(config.path)]


def written_convention(config: DataConfig) -> Convention | None:
    """How the files are taken to write their calibration; None where `unit`, `up` and `inverse` are no options."""
    if config.name in (Format.clip, Format.shelf, Format.released):
        return None
    path = Path(config.calibration or config.path)
    return convention_of(path, unit=config.unit, up=config.up, inverse=config.inverse)


def _read_whole(read: Callable[[Path], Clip]) -> Callable[[DataConfig, Path], Clip]:
    """A reader of files that say everything."""

    def reader(config: DataConfig, path: Path) -> Clip:
        _refuse(config, path, "calibration", "detections", "fps", "size", "skeleton", "unit", "up", "inverse")
        return read(path)

    return reader


def _refuse(config: DataConfig, path: Path, *options: str) -> None:
    given = [f"data.{option}" for option in options if getattr(config, option) is not None]
    if given:
        raise ValueError(f"{path}: data={config.name} says that itself; leave out {', '.join(given)}")


def _read_openpose(config: DataConfig, path: Path) -> Clip:
    return _clip(config, path, read_openpose(Path(config.detections or path), _skeleton(config)))


def _read_pose2sim(config: DataConfig, path: Path) -> Clip:
    detections = Path(config.detections) if config.detections else None
    return _clip(config, path, read_pose2sim(path, detections, _skeleton(config)))


def _read_easymocap(config: DataConfig, path: Path) -> Clip:
    detections = Path(config.detections or path)
    recording = _or_name("detections", easymocap.read_detections, detections, _skeleton(config) or BODY25)
    if config.skeleton is None:
        skeleton, notes = tell_apart(recording.views)
        recording = replace(recording, skeleton=skeleton, notes=(*recording.notes, *notes))
    return _clip(config, path, recording)


def _read_coco(config: DataConfig, path: Path) -> Clip:
    return _clip(config, path, read_coco(Path(config.detections or path), _skeleton(config)))


def _read_panoptic(config: DataConfig, path: Path) -> Clip:
    """Panoptic publishes cameras and poses; detections are OpenPose's."""
    recording = read_openpose(Path(config.detections or path), _skeleton(config))
    convention = panoptic.CONVENTION
    convention = replace(convention, unit=config.unit or convention.unit, up=config.up or convention.up)
    try:
        poses = panoptic.read_poses(path, convention)
    except FileNotFoundError:
        return _clip(config, path, recording)
    recording = replace(recording, fps=poses.fps, notes=(*recording.notes, *poses.notes))
    return _clip(config, path, recording, poses.xyz)


def _read_released(config: DataConfig, path: Path) -> Clip:
    _refuse(config, path, "calibration", "detections", "size", "skeleton", "unit", "up", "inverse")
    rig, recording, truth = read_released(path)
    return to_clip(recording, rig, _fps(config, path, recording), path, truth, SHELF14)


_READERS: dict[Format, Callable[[DataConfig, Path], Clip]] = {
    Format.clip: _read_whole(load_clip),
    Format.shelf: _read_whole(read_shelf),
    Format.openpose: _read_openpose,
    Format.pose2sim: _read_pose2sim,
    Format.easymocap: _read_easymocap,
    Format.panoptic: _read_panoptic,
    Format.coco: _read_coco,
    Format.released: _read_released,
}


def _clip(config: DataConfig, path: Path, recording: Recording, truth: dict[int, np.ndarray] | None = None) -> Clip:
    """Detections with the calibration and frame rate that belong to them, and truth on Panoptic's joints."""
    size = tuple(config.size) if config.size else recording.size
    rig = _or_name(
        "calibration",
        read_calibration,
        Path(config.calibration or (path.parent if path.is_file() else path)),
        size=size,
        unit=config.unit,
        up=config.up,
        inverse=config.inverse,
    )
    return to_clip(recording, rig, _fps(config, path, recording), path, truth, PANOPTIC19)


def _fps(config: DataConfig, path: Path, recording: Recording) -> float:
    fps = config.fps or recording.fps
    if fps is None:
        raise ValueError(f"{path}: no file says the frame rate; give data.fps=...")
    return fps


def _skeleton(config: DataConfig) -> Skeleton | None:
    try:
        return None if config.skeleton is None else get_skeleton(config.skeleton)
    except KeyError as error:
        raise ValueError(f"data.skeleton={config.skeleton}: {error.args[0]}") from None


def _or_name(option: str, read: Callable, *args, **kwargs):
    """Reading what can be named by an option, should it not be found."""
    try:
        return read(*args, **kwargs)
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{error}; name it by data.{option}=...") from None


def _shift(clip: Clip, offsets: list[int] | None) -> Clip:
    """The clip with the detections of each camera moved later, what is shifted in from outside absent.

    Images, which stay where they are, are left out.
    """
    if offsets is None or not any(offsets):
        return clip
    if len(offsets) != len(clip.rig):
        raise ValueError(
            f"data.offsets={list(offsets)}: expected a number of frames for each camera of clip {clip.id!r}, "
            f"{', '.join(clip.rig.names)}"
        )

    def moved(array: np.ndarray, nothing) -> np.ndarray:
        late = np.full_like(array, nothing)
        for view, offset in enumerate(offsets):
            start, end = max(offset, 0), max(len(array) + min(offset, 0), 0)
            late[start:end, view] = array[max(-offset, 0) : max(len(array) - max(offset, 0), 0), view]
        return late

    found = clip.detections
    known = {name: getattr(clip, name) for name in OF_DETECTIONS if getattr(clip, name) is not None}
    return replace(
        clip,
        detections=Detections2D(found.skeleton, moved(found.xy, np.nan), moved(found.score, np.nan)),
        **{name: moved(array, OF_DETECTIONS[name][-1]) for name, array in known.items()},
        images=None,
        provenance=clip.provenance | {"offsets": list(offsets)},
    )


def _cut(clip: Clip, frames: list[int] | None) -> Clip:
    if frames is None:
        return clip
    if len(frames) != 2 or not 0 <= frames[0] < frames[1] <= len(clip):
        raise ValueError(
            f"data.frames={list(frames)}: expected [first, end] within the {len(clip)} frames of clip {clip.id!r}"
        )
    first = clip.provenance.get("first_frame", 0) + frames[0]
    cut = clip.select(frames=slice(*frames))
    return replace(cut, provenance=clip.provenance | {"first_frame": first, "frames": list(frames)})


def subsets(clip: Clip, sizes: Sequence[int]) -> list[list[int]]:
    """All choices of so many of a clip's cameras, for each size; without sizes, all cameras.

    Raises:
        ValueError: there are not so many cameras, or fewer than two are asked for.
    """
    views = len(clip.rig)
    sizes = list(dict.fromkeys(sizes)) or [views]
    if not all(2 <= size <= views for size in sizes):
        raise ValueError(f"views={sizes}: expected numbers from 2 to {views}, the cameras of clip {clip.id!r}")
    return [list(cameras) for size in sizes for cameras in combinations(range(views), size)]


def _restrict(clip: Clip, cameras: list[int] | None) -> Clip:
    if cameras is None:
        return clip
    unknown = [camera for camera in cameras if not 0 <= camera < len(clip.rig)]
    if unknown or not cameras or len(set(cameras)) != len(cameras):
        there = ", ".join(f"{i} ({name})" for i, name in enumerate(clip.rig.names))
        raise ValueError(f"data.cameras={cameras}: expected different cameras of clip {clip.id!r}, which has {there}")
    return clip.select(views=list(cameras))
