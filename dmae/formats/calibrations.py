"""Calibration files of any format: found, recognised, read and written.

A format is a function with the decorator `calibration_format`, in the module of its program. It takes a path, and an
image size for cameras without one, and returns a `CameraRig` in the convention of the file. The first line of its
docstring describes the file and names the programs that write it; error messages show this line. Listing the formats
imports their modules, because the settings of a format contain functions.

Readers raise FileNotFoundError if there is no file, and ValueError, which names camera and key, if it is malformed or
states no image size. Writers raise ValueError if the format cannot store a lens or the name of a camera.
"""

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.store import load_clip
from dmae.files.contents import read_text
from dmae.files.structured import read_json, read_toml
from dmae.formats.config import OURS, Convention, LengthUnit, UpDirection
from dmae.registry import Entry, Registry


@dataclass(frozen=True, kw_only=True)
class CalibrationFormat(Entry):
    """A calibration format."""

    syntax: str  # "json", "toml", "yaml", "xml", or several of these
    # Function that takes the content of a JSON or TOML file, or the keys of a YAML or XML file, and returns whether it
    # has this format
    matches: Callable[[object], bool] = lambda content: True
    convention: Convention = OURS  # Convention of the format for lengths, world axes and extrinsics
    files: tuple[str, ...]  # Patterns of its files, relative to the folder of a recording
    files_above: tuple[str, ...] = ()  # Patterns of its files, relative to each of the two folders above the recording
    # A file can hold one camera, and then stands for all files of its folder. Others have such names too, so its files
    # are known by their content
    by_camera: bool = False
    # Function that takes cameras in the convention of the file, and a path to write; None if the format is only read
    write: Callable[[CameraRig, Path], None] | None = None


calibration_format = Registry("calibration_format", CalibrationFormat, __package__)


# CameraRig accepts the same rounding of published rotations. The error raised here names the key.
_ROUNDING = 1e-3
_LARGEST = 1e10  # Largest absolute value of any number: ten thousand kilometres in millimetres


class ParsedCamera(NamedTuple):
    """One camera in the convention of its file, with its pose as [R | t]."""

    name: str
    K: np.ndarray
    dist: np.ndarray
    R: np.ndarray
    t: np.ndarray
    size: np.ndarray | None
    """Width and height, px; None if the file does not state them."""
    fisheye: bool = False


@dataclass(frozen=True)
class CameraTable:
    """The values of one camera in a calibration file, by key. Methods raise ValueError with file, camera and key."""

    path: Path | str
    camera: str
    values: dict

    def __post_init__(self):
        if not isinstance(self.values, dict):
            raise ValueError(
                f"{self.path}: camera {self.camera!r}: expected a table of its values, found {self.values!r:.60}"
            )

    def error(self, key: str, expected: str, found) -> ValueError:
        return ValueError(f"{self.path}: camera {self.camera!r}: expected {key} {expected}, found {found}")

    def numbers(self, key: str, *counts: int) -> np.ndarray:
        """Return the finite numbers of a key as a flat array. Their count must be one of `counts`."""
        wanted = f"of {' or '.join(map(str, counts))} numbers"
        if key not in self.values:
            raise self.error(key, wanted, f"no such key among {sorted(map(str, self.values))}")
        found = self.values[key]
        try:
            array = np.ravel(np.asarray(found))
        except ValueError:
            raise self.error(key, wanted, f"{found!r:.60}") from None
        if array.dtype.kind not in "iuf" or array.size not in counts:
            raise self.error(key, wanted, f"{found!r:.60}")
        if not np.isfinite(array).all():
            raise self.error(key, "of finite numbers", f"{found!r:.60}")
        if (np.abs(array.astype(np.float64)) > _LARGEST).any():
            raise self.error(key, f"of numbers up to {_LARGEST:g}", f"{found!r:.60}")
        return array.astype(np.float64)

    def intrinsics(self, key: str) -> np.ndarray:
        """Return a camera matrix (3, 3), px."""
        K = self.numbers(key, 9).reshape(3, 3)
        if not np.allclose(K[2], (0, 0, 1)) or not np.isclose(K[1, 0], 0):
            raise self.error(key, "to be a camera matrix (fx s cx, 0 fy cy, 0 0 1)", K.tolist())
        self.check_focal(key, K[0, 0], K[1, 1])
        return K

    def check_focal(self, key: str, *lengths: float) -> None:
        if min(lengths) <= 0:
            raise self.error(key, "of positive focal lengths", ", ".join(f"{length:g}" for length in lengths))

    def rotation(self, key: str, matrix: np.ndarray | None = None) -> np.ndarray:
        """Return the checked rotation matrix (3, 3) of a key, or `matrix`, a part of a larger array of this key."""
        R = self.numbers(key, 9).reshape(3, 3) if matrix is None else matrix
        # The file can contain numbers that overflow.
        with np.errstate(all="ignore"):
            error, determinant = np.abs(R @ R.T - np.eye(3)).max(), np.linalg.det(R)
        if not (error <= _ROUNDING and determinant > 0):
            found = f"a matrix with R R^T off by {error:.1e} and determinant {determinant:+.3f}"
            raise self.error(key, "to be a right-handed rotation", found)
        return R

    def rodrigues(self, key: str) -> np.ndarray:
        """Return the rotation matrix (3, 3) of a Rodrigues vector, rad."""
        return Rotation.from_rotvec(self.numbers(key, 3)).as_matrix()

    def lens(self, key: str) -> tuple[np.ndarray, bool]:
        """Return OpenCV's distortion coefficients, and whether the lens is a fisheye, by the key `fisheye`."""
        fisheye = self.values.get("fisheye", False)
        if not isinstance(fisheye, bool):
            raise self.error("fisheye", "to be true or false", repr(fisheye))
        return self.numbers(key, *((4,) if fisheye else (4, 5, 8))), fisheye

    def size(self, *keys: str) -> np.ndarray:
        """Return image width and height, px, from one key or from two."""
        size = np.concatenate([self.numbers(key, 2 // len(keys)) for key in keys])
        if not ((size >= 1) & (size < 1e6) & (size == np.round(size))).all():
            raise self.error(", ".join(keys), "to be a positive whole width and height", size.tolist())
        return size.astype(np.int64)


def camera_tables(path: Path, cameras: object) -> Iterator[CameraTable]:
    """Yield the cameras of an object of cameras by name; ValueError, with the file, if it is none."""
    if not isinstance(cameras, dict):
        raise ValueError(f"{path}: expected an object of cameras, found {cameras!r:.60}")
    yield from (CameraTable(path, name, values) for name, values in cameras.items())


class LacksSize(ValueError):
    """Raised when a calibration file states no image size and none is given; names the option that gives it, if any."""

    def __init__(self, what: str, option: str | None = None):
        without = "write the cameras as Pose2Sim does, with size = [width, height]"
        super().__init__(f"{what}; {f'give it as {option}=[width,height], px' if option else without}")
        self.what = what


def make_rig(path: Path | str, cameras: Iterable[ParsedCamera], size: tuple[int, int] | None) -> CameraRig:
    """Return the rig of the cameras in a file, in its units and axes; `size` (px) is for those without image size.

    Raises LacksSize if a size is unknown, and ValueError if there are no cameras, two have one name, or `size`
    contradicts the file.
    """
    cameras = list(cameras)
    if not cameras:
        raise ValueError(f"{path}: expected cameras, found none")
    names = [camera.name for camera in cameras]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"{path}: expected cameras of different names, found {', '.join(map(repr, twice))} twice")
    for camera in cameras:
        if camera.size is None and size is None:
            raise LacksSize(f"{path}: camera {camera.name!r}: the file holds no image size")
        if camera.size is not None and size is not None and tuple(camera.size) != tuple(size):
            raise ValueError(
                f"{path}: camera {camera.name!r}: the file states images of {camera.size[0]} x {camera.size[1]} px, "
                f"which contradicts the {size[0]} x {size[1]} px of the recording, or of size="
            )
    longest = max(len(camera.dist) for camera in cameras)
    cam_from_world = np.tile(np.eye(4), (len(cameras), 1, 1))
    cam_from_world[:, :3, :3] = [camera.R for camera in cameras]
    cam_from_world[:, :3, 3] = [camera.t for camera in cameras]
    try:
        return CameraRig(
            tuple(names),
            np.array([camera.K for camera in cameras]),
            np.array([np.pad(camera.dist, (0, max(longest, 5) - len(camera.dist))) for camera in cameras]),
            cam_from_world,
            np.array([size if camera.size is None else camera.size for camera in cameras]),
            np.array([camera.fisheye for camera in cameras]),
        )
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def require(format: str, rig: CameraRig, *, coefficients: int, fisheye: bool = False) -> None:
    """Raise ValueError if a format cannot store a lens: more OpenCV coefficients, or a fisheye."""
    for view, name in enumerate(rig.names):
        lost = None
        if rig.fisheye[view] and not fisheye:
            lost = "a fisheye lens"
        elif not rig.fisheye[view] and rig.dist[view, coefficients:].any():
            lost = f"distortion beyond {coefficients} coefficients, {rig.dist[view, coefficients:].tolist()}"
        if lost:
            raise ValueError(f"camera {name!r}: {format} cannot hold {lost}; choose another format or undistort first")


def orthonormal(rig: CameraRig) -> tuple[np.ndarray, np.ndarray]:
    """Return the exact rotations (V, 3, 3) nearest to a rig's, maybe rounded, ones, and translations (V, 3) m."""
    R = Rotation.from_matrix(rig.cam_from_world[:, :3, :3]).as_matrix()
    return R, -np.einsum("vij,vj->vi", R, rig.centers)


@dataclass(frozen=True)
class CalibrationSource:
    """Path of the calibration of a recording, and values that its file does not state."""

    file: str | None = None  # Calibration file, or folder that contains it; None to search for it in the recording
    size: tuple[int, int] | None = None  # Image width and height, px; None if the file states it
    unit: LengthUnit | None = None  # Unit of lengths; None for the unit of the format
    up: UpDirection | None = None  # Axis that points up; None for the axis of the format
    inverse: bool | None = None  # Whether extrinsics are world_from_cam; None for the convention of the format

    def read(self, recording: Path, size: tuple[int, int] | None = None) -> CameraRig:
        """Return the cameras of a recording, a folder to search or a file in it; errors as in `read_calibration`.

        `size` (width and height, px) is used if neither `self.size` nor the calibration states one.
        """
        try:
            path = Path(self.file) if self.file else self.found(recording)
            return read_calibration(path, size=self.size or size, unit=self.unit, up=self.up, inverse=self.inverse)
        except FileNotFoundError as error:
            raise FileNotFoundError(f"{error}; name it by data.calibration=...") from None
        except LacksSize as error:
            raise LacksSize(error.what, "data.size") from None

    def found(self, recording: Path) -> Path:
        """Return the calibration in or above the folder of a recording; errors as in `find_calibration`."""
        folder = recording.parent if recording.is_file() else recording
        return folder if is_clip(folder) else find_calibration(folder, above=True)


FOUND = CalibrationSource()
"""The calibration in the folder of a recording, in the convention of its format."""


def read_calibration(
    path: Path,
    *,
    size: tuple[int, int] | None = None,
    unit: LengthUnit | None = None,
    up: UpDirection | None = None,
    inverse: bool | None = None,
) -> CameraRig:
    """Return the cameras of a calibration file in our convention: cam_from_world, m, z up.

    Args:
        path: The file. Its content determines the format. For EasyMocap, one of its two files, or their folder. It can
            also be a folder with one calibration, or a clip, which has its cameras.
        size: Image width and height, px, for files that do not state them.
        unit: Unit of lengths; None for the unit of the format.
        up: Axis that points up; None for the axis of the format.
        inverse: Whether extrinsics are world_from_cam; None for the convention of the format.

    Raises:
        FileNotFoundError: the file does not exist.
        ValueError: the file is malformed, has no known format, or lacks image sizes; the message names the file, the
            camera and the key.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"calibration {path}: no such file; expected a calibration, or a folder with one")
    if is_clip(path):
        given = {"size": size, "unit": unit, "up": up, "inverse": inverse}
        if said := [name for name, value in given.items() if value is not None]:
            raise ValueError(f"{path}: a clip says that itself; leave out {', '.join(said)}")
        return load_clip(path).rig
    path = find_calibration(path) if path.is_dir() else path
    format = calibration_format[recognise(path)]
    return format.convention.changed(unit, up, inverse).rig(format.function(path, size))


def is_clip(path: Path) -> bool:
    """Return whether a path is the folder of a clip, which has cameras in our convention, in no file of a format."""
    return (Path(path) / "clip.json").is_file()


def write_calibration(rig: CameraRig, path: Path, format: str) -> None:
    """Write cameras with their names and image sizes to a file, or for EasyMocap to a folder, as the format has them.

    The formats pose2sim and easymocap write Rodrigues vectors: rotations that a publication rounded become exact, and
    camera centres do not change. Raises ValueError if the format cannot store a lens: panoptic stores five
    coefficients, and only pose2sim stores fisheyes.
    """
    found = calibration_format.find(format)
    assert found.write is not None, f"calibrations of {format} are only read"
    found.write(found.convention.written_rig(rig), Path(path))


def recognise(path: Path) -> str:
    """Return the name of the format of a calibration file, or of the only one in a folder.

    Raises:
        FileNotFoundError: the file does not exist.
        ValueError: the file has none of the known formats, or is malformed.
    """
    path = find_calibration(path) if path.is_dir() else path
    if found := _recognised(path):
        return found.name
    known = "; ".join(format.help.removesuffix(".") for format in calibration_format.values())
    start = read_text(path).lstrip()[:60]
    raise ValueError(f"{path}: expected a calibration: {known}; found {start!r}. {_ELSEWHERE}")


def _recognised(path: Path) -> CalibrationFormat | None:
    start = read_text(path).lstrip()
    # Only the module of its format parses OpenCV's dialect of YAML.
    content: object = re.findall(r"^[ \t]*(\w+)\s*:", start, re.MULTILINE)
    syntax = "yaml"
    if start.startswith("<"):
        syntax = "xml"  # of OpenCV; or of Qualisys or Vicon, which no format here has
        content = re.findall(r"<(\w+)", start)
    elif not re.match(r"(#.*\n\s*)*+(%YAML|\w+\s*:)", start) and path.suffix not in (".yml", ".yaml"):
        syntax = "json" if start.startswith("{") or path.suffix == ".json" else "toml"
        content = read_json(path) if syntax == "json" else read_toml(path)
    formats = calibration_format.values()
    return next((each for each in formats if syntax in each.syntax.split() and each.matches(content)), None)


_ELSEWHERE = (
    "Pose2Sim converts calibrations of Qualisys, Vicon, OptiTrack, OpenCap and others, and calculates one from a "
    "checkerboard; docs/how-to/calibration.md has a TOML for values of your own"
)


def find_calibration(folder: Path, above: bool = False) -> Path:
    """Return the only calibration file in a folder; for EasyMocap, its `intri.yml`; the first, if each has one camera.

    The patterns `files` of all formats are searched in the folder. If there is no match and the folder is a recording,
    which may share a calibration with others (`above`), the patterns `files_above` are searched in its parent folder,
    and then in the folder above that.

    Raises:
        FileNotFoundError: there is no calibration; the message lists the patterns.
        ValueError: there are several calibrations; the message lists them.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder")
    formats = calibration_format.values()
    inside = sorted({pattern for format in formats for pattern in format.files})
    shared = sorted({pattern for format in formats for pattern in format.files_above}) if above else []
    whole = folder.resolve()
    for place, key in ((folder, "files"), (whole.parent, "files_above"), (whole.parent.parent, "files_above")):
        if key == "files_above" and not above:
            break
        found = sorted({path for format in formats for path in _matching(place, format, getattr(format, key))})
        if not found and not above:
            # A folder that is named can have nothing else in it; a recording has detections too.
            found = sorted(path for each in formats if each.by_camera for path in _matching(place, each, ("*.json",)))
        if len(found) > 1:
            # Settings and boards of another program have such names too.
            found = [path for path in found if _format_of(path) is not None] or found
        of_a_camera = [format for format in map(_format_of, found) if format is not None and format.by_camera]
        if len(of_a_camera) == len(found) > 1 and len({path.parent for path in found}) == 1:
            return found[0]
        if len(found) > 1:
            raise ValueError(
                f"{folder}: expected one calibration, found {', '.join(map(str, found))}; name the file to use"
            )
        if found:
            return found[0]
    beside = "".join(f", ../{pattern}, ../../{pattern}" for pattern in shared)
    raise FileNotFoundError(f"{folder}: found no calibration; looked for {', '.join(inside)}{beside}. {_ELSEWHERE}")


def _matching(place: Path, format: CalibrationFormat, patterns: tuple[str, ...]) -> Iterator[Path]:
    for path in {path for pattern in patterns for path in place.glob(pattern) if path.is_file()}:
        # Of the files of other programs, only the names are known.
        if not format.by_camera or _format_of(path) is format:
            yield path


def _format_of(path: Path) -> CalibrationFormat | None:
    try:
        return _recognised(path)
    except ValueError:
        return None  # Not even of its syntax, so of something else
