"""Read recordings: recognise the format, call its reader, select frames and views."""

from collections.abc import Sequence
from copy import copy
from dataclasses import fields, replace
from fnmatch import fnmatch
from itertools import combinations
from numbers import Integral
from pathlib import Path
from typing import Any, overload

import numpy as np

from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.labels import NOT_DETECTED, DetectionLabels
from dmae.data.skeleton import option_skeleton
from dmae.data.store import MANIFEST, clip_folders
from dmae.files.checks import IMAGES, VIDEOS
from dmae.formats.calibrations import CalibrationSource, LacksSize, calibration_format, is_clip
from dmae.formats.calibrations import recognise as recognise_calibration
from dmae.formats.config import Convention, DataConfig
from dmae.formats.footage import with_images, with_videos
from dmae.formats.poses import pose_paths, read_poses
from dmae.formats.recordings import offsets_of_all, plain, to_clip
from dmae.formats.registry import RecordingReader, reader
from dmae.nearest import nearest

_OPTIONS = {
    "calibration": ("calibration", "size", "unit", "up", "inverse"),
    "detections": ("detections",),
    "fps": ("fps",),
    "skeleton": ("skeleton",),
}
"""The arguments that readers can take, each with the fields of `DataConfig` from which it is made."""


class Clips(Sequence):
    """The clips of a data set, or of a single recording, restricted to the frames and cameras of a configuration.

    A clip is read when it is accessed, by its number or by the name of its folder. `provenance["notes"]` of each clip
    contains notes on missing frames, and on decisions of the reader that can be wrong. Raises FileNotFoundError if the
    recording does not exist, and ValueError if a file is malformed, an option that the files need is missing, or a clip
    lacks one of the cameras or frames.

    Attributes:
        data_set: Whether the path contains one folder per clip, and is not itself a clip.
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
        path = Path(config.path)
        self.folders = clip_folders(path) if self.reader.data_set else [path]
        self.data_set = self.folders != [path]
        self.total = len(self.folders)
        self.names = [folder.name for folder in self.folders]
        self.numbers = range(self.total)

    def __repr__(self) -> str:
        return f"Clips({str(self.config.path)!r}, clips={len(self)})"

    def __len__(self) -> int:
        return len(self.folders)

    def __contains__(self, name: object) -> bool:
        """Return whether a clip has this name."""
        return name in [folder.name for folder in self.folders]

    @overload
    def __getitem__(self, index: int | str) -> Clip: ...

    @overload
    def __getitem__(self, index: slice) -> "Clips": ...

    def __getitem__(self, index: int | str | slice) -> "Clip | Clips":
        if isinstance(index, slice):
            part = copy(self)
            part.numbers, part.folders = self.numbers[index], self.folders[index]
            return part
        config, folder = self.config, self._folder(index)
        arguments = _arguments(config, self.reader, folder)
        try:
            if self.reader.cameras:
                clip = self.reader.function(folder, **arguments)
            else:
                clip = self._with_cameras(folder, **arguments)
            if self.reader.cameras and config.calibration is not None:
                clip = _with_calibration(clip, config, Path(config.calibration))
            clip.check_numbers()
            if config.truth is not None:
                names = [folder.name] if self.data_set else [folder.name, clip.id]
                clip = _with_truth(clip, Path(config.truth), names, alone=self.total == 1)
            if config.videos is not None:
                clip = with_videos(clip, Path(config.videos))
            if config.images is not None:
                clip = with_images(clip, Path(config.images))
            offsets = offsets_of_all("data.offsets", config.offsets, clip.rig.names)
        except ValueError as error:
            if str(folder) in str(error):
                raise
            raise ValueError(f"{folder}: {error}") from None
        except FileNotFoundError as error:
            if folder.exists():
                raise FileNotFoundError(f"{error}{_of_another_format(config)}") from None
            raise FileNotFoundError(f"{folder}: no such file or folder. {error}") from None
        # Folders of a data set have different names; clips that somebody put together may share one.
        if self.data_set and clip.id != folder.name:
            clip = replace(clip, id=folder.name, provenance=clip.provenance | {"recorded_as": clip.id})
        return select_views(select_frames(shift_views(clip, offsets), config.frames), config.cameras)

    def _folder(self, index: int | str) -> Path:
        """Return the folder of a clip, given by its number or its name."""
        if isinstance(index, str):
            names = [folder.name for folder in self.folders]
            if index not in names:
                near = nearest(index, names)
                meant = f"; did you mean {near!r}?" if near else ""
                raise KeyError(f"{self.config.path}: no clip {index!r} among {len(names)}{meant}")
            return self.folders[names.index(index)]
        if isinstance(index, bool) or not isinstance(index, Integral):
            raise TypeError(f"{self.config.path}: expected the number or the name of a clip, found {index!r:.60}")
        if not -len(self) <= index < len(self):
            raise IndexError(f"{self.config.path}: no clip {index}; there are {len(self)}, from 0")
        return self.folders[int(index)]

    def _with_cameras(self, folder: Path, calibration: CalibrationSource, fps: float | None, **others) -> Clip:
        """Return the clip of a reader that returns `NumberedDetections`: add the cameras and the frame rate."""
        given = {"calibration": calibration, **others}
        path = folder if "detections" in self.reader.options else others["detections"] or folder
        found = self.reader.function(path, **{option: given[option] for option in self.reader.options})
        if (rig := found.rig) is None:
            rig = calibration.read(folder, found.size)
            place = folder.parent if folder.is_file() else folder
            if calibration.file is None and not (file := calibration.found(folder)).is_relative_to(place):
                note = f"cameras are from {file}; data.calibration names another file"
                found = replace(found, notes=(*found.notes, note))
        fps = found.fps if fps is None else fps
        if fps is None:
            raise ValueError(f"{folder}: no file states the frame rate; give data.fps=...")
        if self.config.cameras is not None:
            # A camera that is not chosen needs no calibration, where cameras are matched by name.
            chosen, calibrated = {plain(str(each)) for each in self.config.cameras}, {*map(plain, rig.names)}
            views = {name: view for name, view in found.views.items() if plain(name) in chosen | calibrated}
            found = replace(found, views=views or found.views)
        return to_clip(found, rig, fps, folder)


def written_convention(config: DataConfig) -> Convention | None:
    """Return the convention by which the calibration is read; None if the recording itself holds the cameras."""
    if config.calibration is None and not _reader(config).takes("calibration"):
        return None
    if config.calibration is not None and is_clip(Path(config.calibration)):
        return None
    file = Path(config.calibration) if config.calibration else _calibration_source(config).found(Path(config.path))
    format = calibration_format[recognise_calibration(file)]
    return format.convention.changed(config.unit, config.up, config.inverse)


def recognise(path: Path) -> str:
    """Return the name of the format of a recording, recognised by the names of its files.

    Raises:
        FileNotFoundError: the path does not exist.
        ValueError: no format is recognised, or several are.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: expected a clip, a data set or a recording, found no such file or folder")
    if path.is_file() and (is_clip(path.parent) or path.name == MANIFEST):
        raise ValueError(f"{path}: expected a clip or a data set, found a file of one; give its folder, {path.parent}")
    for general in (False, True):
        entries = [entry for entry in reader.values() if entry.general == general]
        found = [entry.name for entry in entries if _is_recognised(path, entry)]
        if general and len(found) > 1:
            # The names of files like cam1.json, cam2.json could be read as frames of one camera called keypoints.
            named = [entry.name for entry in entries if _is_recognised(path, entry, by_folder=True)]
            found = named if len(named) == 1 else found
        if len(found) > 1:
            raise ValueError(f"{path}: expected files of one format, found {', '.join(found)}; name it by data=...")
        if found:
            return found[0]
    if clips := list(path.glob("*/clip.json")):
        # Of what `dmae run` writes, the clip that was written last is the completed one.
        last = max(clips, key=lambda clip: clip.stat().st_mtime).parent
        raise ValueError(
            f"{path}: found a folder of clips, expected a clip or a data set; name one, as {last}; a data set has a "
            f'{MANIFEST} with a line {{"id": "{last.name}", "status": "ok"}} for each'
        )
    for folder in (path, *(sorted(filter(Path.is_dir, path.iterdir())) if path.is_dir() else ())):
        if _holds_videos(folder):
            raise ValueError(
                f"{path}: found videos, or folders of images, expected detections in them; use dmae run "
                f"videos={folder} calibration=... for people in 3D, or dmae detect videos={folder} calibration=... for "
                "detections"
            )
    if _is_image(path) or (path.is_dir() and any(_is_image(file) for file in path.iterdir())):
        raise ValueError(
            f"{path}: found images, expected detections in them; dmae detect photos={path} finds the people of "
            "photographs, in 2D. People in 3D need a folder of images, or a video, of each camera"
        )
    there = ", ".join(sorted(item.name for item in path.iterdir())[:6]) if path.is_dir() else "a file"
    raise ValueError(
        f"{path}: expected a clip, a data set or a recording, found {there or 'an empty folder'}; no format is "
        f"recognised, data=... names one of {', '.join(reader)}"
    )


def _of_another_format(config: DataConfig) -> str:
    """Return a sentence that names the format of the files, if that is not the one that was given."""
    try:
        found = recognise(Path(config.path)) if config.name else config.name
    except (ValueError, FileNotFoundError):
        return ""
    return "" if found == config.name else f". The files look like data={found}"


def _holds_videos(path: Path) -> bool:
    """Return whether a path is a video, or contains a video or a folder of images."""
    files = [path] if path.is_file() else list(path.iterdir())
    if any(file.suffix.lower() in VIDEOS for file in files):
        return True
    return any(any(map(_is_image, file.iterdir())) for file in files if file.is_dir())


def _is_image(file: Path) -> bool:
    return file.suffix.lower() in IMAGES


def _is_recognised(path: Path, entry: RecordingReader, by_folder: bool = False) -> bool:
    """Whether files of a format are there; with `by_folder`, in a folder of a name that the format states."""
    if path.is_file():
        return fnmatch(path.name, entry.file)
    kept = [signs for signs in entry.signs if not by_folder or not signs[0].startswith("*")]
    return any(all(any(path.glob(pattern)) for pattern in signs) for signs in kept)


def _reader(config: DataConfig) -> RecordingReader:
    return reader.find(recognise(Path(config.path)) if config.name is None else config.name)


def _arguments(config: DataConfig, entry: RecordingReader, path: Path) -> dict:
    """Return the arguments that a reader takes, by name; ValueError if the configuration has others."""
    refusable = {name for option, names in _OPTIONS.items() if not entry.takes(option) for name in names}
    if config.calibration is not None:
        # Another calibration can replace the cameras of any recording.
        refusable -= set(_OPTIONS["calibration"])
    given = [field.name for field in fields(config) if getattr(config, field.name) is not None]
    refused = [name for name in given if name in refusable]
    if refused:
        options = ", ".join(f"data.{name}" for name in refused)
        another = ""
        if set(refused) <= set(_OPTIONS["calibration"]):
            another = ", or give another calibration, which they describe, as data.calibration=..."
        raise ValueError(f"{path}: data={entry.name} says that itself; leave out {options}{another}")
    values = {
        "calibration": _calibration_source(config),
        "detections": None if config.detections is None else Path(config.detections),
        "fps": config.fps,
        "skeleton": None if config.skeleton is None else option_skeleton("data.skeleton", config.skeleton),
    }
    return {option: value for option, value in values.items() if entry.takes(option)}


def _calibration_source(config: DataConfig) -> CalibrationSource:
    size: Any = tuple(config.size) if config.size else None
    return CalibrationSource(config.calibration, size, config.unit, config.up, config.inverse)


def _with_calibration(clip: Clip, config: DataConfig, calibration: Path) -> Clip:
    """Return a clip with the cameras of another calibration, by name, and without its poses, which were captured with
    the old ones; ValueError if a camera is missing, or its images have another size."""
    source = _calibration_source(config)
    try:
        rig = source.read(calibration)
    except LacksSize:
        if (clip.rig.size != clip.rig.size[0]).any():
            raise
        rig = replace(source, size=tuple(clip.rig.size[0].tolist())).read(calibration)
    missing = [name for name in clip.rig.names if name not in rig.names]
    if missing:
        raise ValueError(
            f"data.calibration={config.calibration}: expected the cameras of clip {clip.id!r}, "
            f"{', '.join(clip.rig.names)}; found {', '.join(rig.names)}"
        )
    rig = rig[[rig.names.index(name) for name in clip.rig.names]]
    for name, wanted, found in zip(rig.names, clip.rig.size.tolist(), rig.size.tolist(), strict=True):
        if wanted != found:
            raise ValueError(
                f"data.calibration={config.calibration}: camera {name!r}: expected a calibration of images of "
                f"{wanted[0]} x {wanted[1]} px, as its joints are given in these; found {found[0]} x {found[1]}"
            )
    notes = [*clip.provenance.get("notes", ()), f"cameras are from data.calibration={config.calibration}"]
    # A simulated clip keeps the cameras that filmed it, for its labels and images.
    filmed = clip.actual_rig if clip.occlusion is not None else None
    return replace(clip, rig=rig, true_rig=filmed, poses=None, provenance=clip.provenance | {"notes": notes})


def _with_truth(clip: Clip, path: Path, names: list[str], *, alone: bool) -> Clip:
    """Return a clip with true poses from a file, if it is `alone`, or from the one in a folder that has its name.

    A file that numbers its frames is placed by them, and can lack some. Raises ValueError if the frames do not fit.
    """
    files = pose_paths(path)
    if files is None and not alone:
        raise ValueError(
            f"data.truth={path}: expected a folder with poses of each clip, as {names[0]}.npz, found one file"
        )
    file = path if files is None else next((files[name] for name in names if name in files), None)
    if file is None:
        wanted = " or ".join(dict.fromkeys(names))
        raise ValueError(f"data.truth={path}: expected poses of clip {wanted}, found {', '.join(files or ())[:90]}")
    found = read_poses(file)
    if found.fps is not None and not np.isclose(found.fps, clip.fps, rtol=1e-3):
        raise ValueError(
            f"data.truth={path}: expected {clip.fps:g} frames a second as of the clip, found {found.fps:g}"
        )
    truth, start = found.poses, clip.provenance.get("first_frame", 0)
    if found.first is not None:
        numbers = np.arange(found.first, found.first + len(truth.xyz)) - start
        inside = (numbers >= 0) & (numbers < len(clip))
        xyz = np.full((len(clip), *truth.xyz.shape[1:]), np.nan, np.float32)
        xyz[numbers[inside]] = truth.xyz[inside]
        if not inside.any():
            raise ValueError(
                f"data.truth={path}: expected some of the frames {start} to {start + len(clip) - 1} of the clip, found "
                f"{found.first} to {found.first + len(truth.xyz) - 1}"
            )
        truth = Poses3D(truth.skeleton, xyz)
    elif len(truth.xyz) != len(clip):
        raise ValueError(f"data.truth={path}: expected the {len(clip)} frames of the clip, found {len(truth.xyz)}")
    notes = [*clip.provenance.get("notes", ()), f"truth is from data.truth={path}"]
    # Labels of occlusion and of detections describe the truth that is replaced.
    return replace(
        clip,
        truth=Poses3D(truth.skeleton, truth.xyz, cov=truth.cov),
        occlusion=None,
        detection_labels=None,
        provenance=clip.provenance | {"notes": notes},
    )


def shift_views(clip: Clip, offsets: list[int] | None) -> Clip:
    """Return the clip with the detections of each camera moved later by `offsets` (V,) frames, absent where unknown.

    Images cannot be moved, so they are removed, and so are poses, which were captured before; a note says it. Raises
    ValueError if there is not one offset per camera.
    """
    if offsets is None or not any(offsets):
        return clip
    if len(offsets) != len(clip.rig):
        raise ValueError(
            f"data.offsets={list(offsets)}: expected a number of frames for each camera of clip {clip.id!r}, found "
            f"{len(offsets)} for the {len(clip.rig)} cameras {', '.join(clip.rig.names)}"
        )

    def shifted(array: np.ndarray, absent) -> np.ndarray:
        late = np.full_like(array, absent)
        for view, offset in enumerate(offsets):
            start, end = max(offset, 0), max(len(array) + min(offset, 0), 0)
            late[start:end, view] = array[max(-offset, 0) : max(len(array) - max(offset, 0), 0), view]
        return late

    found, labels = clip.detections, clip.detection_labels
    if labels is not None:
        arrays = {name: getattr(labels, name) for name in NOT_DETECTED}
        known = {name: array for name, array in arrays.items() if array is not None}
        labels = DetectionLabels(**{name: shifted(array, NOT_DETECTED[name]) for name, array in known.items()})
    provenance = clip.provenance | {"offsets": list(offsets)}
    if clip.poses is not None:
        note = "poses are left out: they were captured with other offsets between cameras"
        provenance["notes"] = [*clip.provenance.get("notes", ()), note]
    return replace(
        clip,
        detections=Detections2D(found.skeleton, shifted(found.xy, np.nan), shifted(found.score, np.nan)),
        detection_labels=labels,
        poses=None,
        images=None,
        provenance=provenance,
    )


def select_frames(clip: Clip, frames: list[int] | None) -> Clip:
    """Return the clip with only the frames [first, end), or all for None; ValueError if it lacks some."""
    if frames is None:
        return clip
    if len(frames) != 2 or not 0 <= frames[0] < frames[1] <= len(clip):
        raise ValueError(
            f"data.frames={list(frames)}: expected [first, end] within the {len(clip)} frames of clip {clip.id!r}"
        )
    first = clip.provenance.get("first_frame", 0) + frames[0]
    selected = clip.select(frames=slice(*frames))
    return replace(selected, provenance=selected.provenance | {"first_frame": first, "frames": list(frames)})


def select_views(clip: Clip, cameras: Sequence[int | str] | None) -> Clip:
    """Return the clip with only some cameras, given by name, as a note says; None selects all.

    A whole number is the camera whose name is that number, as `2` or `02`; it never counts cameras. Raises ValueError
    if a camera is missing or given twice.
    """
    if cameras is None:
        return clip
    names = clip.rig.names
    index = camera_indices(clip, cameras, "data.cameras")
    chosen = [names[each] for each in index]
    note = f"data.cameras: {len(chosen)} of {len(names)} cameras: {', '.join(chosen)}"
    notes = [*clip.provenance.get("notes", ()), note]
    selected = clip.select(views=index)
    return replace(selected, provenance=selected.provenance | {"notes": notes})


def camera_indices(clip: Clip, cameras: Sequence[int | str], option: str) -> list[int]:
    """Return the indices of cameras that an option gives by name, in its order. Raises as `select_views`."""
    names = clip.rig.names
    index_of: dict[int | str, int] = {int(name): index for index, name in enumerate(names) if name.isdecimal()}
    index_of |= {name: index for index, name in enumerate(names)}
    index = [index_of.get(str(camera), index_of.get(camera)) for camera in cameras]
    found = [each for each in index if each is not None]
    if not found or len(set(found)) != len(index):
        raise ValueError(
            f"{option}=[{','.join(map(str, cameras))}]: expected names of cameras of clip {clip.id!r}, each once; "
            f"it has {', '.join(names)}"
        )
    return found


def camera_subsets(clip: Clip, sizes: Sequence[int], option: str = "views") -> list[list[int]]:
    """Return all subsets of a clip's cameras with these sizes, of at least two; without sizes, the set of all cameras.

    Raises ValueError, with the name of the option, if there are not enough cameras, or a size is less than two.
    """
    views = len(clip.rig)
    sizes = list(dict.fromkeys(sizes)) or [views]
    if not all(2 <= size <= views for size in sizes):
        raise ValueError(f"{option}={sizes}: expected numbers from 2 to {views}, the cameras of clip {clip.id!r}")
    return [list(cameras) for size in sizes for cameras in combinations(range(views), size)]
