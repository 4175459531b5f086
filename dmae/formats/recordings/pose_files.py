"""Read pose files, of this package or of other programs, in any format with a pose reader."""

import re
from dataclasses import dataclass
from fnmatch import fnmatch
from pathlib import Path

from dmae.data.clip import Poses3D
from dmae.data.store import MANIFEST, clip_folders
from dmae.formats.registry import PoseReader, pose_reader

_PERSON = re.compile(r"_P\d+$")
"""End of the names of files that contain one of several persons."""


@dataclass(frozen=True)
class PoseFile:
    """The content of a pose file or of a folder of poses.

    Attributes:
        poses: (F, P, J, 3) m, world.
        fps: Frames per second; None if the file does not state it.
        clip: Id of the clip of these poses; None if the file does not state it.
    """

    poses: Poses3D
    fps: float | None = None
    clip: str | None = None


def read_poses(path: Path) -> PoseFile:
    """Read the poses of one clip. The format is recognised by the name of the file, or by the files in the folder.

    Raises:
        FileNotFoundError: the path does not exist.
        ValueError: no format is recognised, or the file is malformed.
    """
    path = Path(path)
    found = _reader(path)
    if found is None and not path.exists():
        raise FileNotFoundError(f"{path}: expected poses, found no such file or folder")
    if found is None:
        raise ValueError(f"{path}: expected poses, {_expected()}; found none of them")
    try:
        return found.function(path)
    except KeyError as error:
        raise ValueError(error.args[0]) from None


def pose_paths(path: Path) -> dict[str, Path] | None:
    """Return the paths of the poses of several clips, by clip id: `<id>.npz`, `<id>.trc`, `<id>/` and so on.

    Args:
        path: A folder of pose files, or a data set of clips.

    Returns:
        Paths by clip id; None if the path contains the poses of only one clip.

    Raises:
        FileNotFoundError: the path does not exist, or the folder contains no poses.
        ValueError: a clip has poses in two files.
    """
    path = Path(path)
    if _reader(path) is not None:
        return None
    if not path.exists():
        raise FileNotFoundError(f"{path}: expected poses, found no such file or folder")
    if (path / MANIFEST).is_file():
        return {folder.name: folder for folder in clip_folders(path)}
    found: dict[str, Path] = {}
    for item in sorted(path.iterdir()) if path.is_dir() else []:
        if _reader(item) is None:
            continue
        name = item.name
        if item.is_file():
            # Each person of a clip can have its own file. These files are read together.
            name = _PERSON.sub("", item.stem)
            item = item.with_stem(name)
        if found.setdefault(name, item) != item:
            raise ValueError(f"{path}: expected poses of clip {name!r} once, found {found[name].name} and {item.name}")
    if not found:
        raise FileNotFoundError(f"{path}: expected poses, {_expected()}, a file or folder for each clip; found none")
    return found


def _reader(path: Path) -> PoseReader | None:
    if path.is_dir():
        return next((each for each in pose_reader.values() if any(any(path.glob(sign)) for sign in each.signs)), None)
    there = path.is_file() or any(path.parent.glob(f"{path.stem}_P*{path.suffix}"))
    return next((each for each in pose_reader.values() if there and fnmatch(path.name, each.file)), None)


def _expected() -> str:
    """Return a list of the pose formats as text, for messages."""
    return " or ".join(each.file or f"a folder of {each.signs[0]}" for each in pose_reader.values())
