"""Calibration files of any format: find, recognise, read and write them."""

from dataclasses import dataclass, replace
from pathlib import Path

from dmae.data.cameras import CameraRig
from dmae.files.contents import read_text
from dmae.files.structured import read_json, read_toml
from dmae.formats.calibrations.conventions import Convention, LengthUnit, UpDirection
from dmae.formats.calibrations.entries import LacksSize
from dmae.formats.calibrations.registry import calibration_format


@dataclass(frozen=True)
class CalibrationSource:
    """Where the calibration of a recording is, and what its file does not say; None for what is found there.

    Attributes:
        file: Calibration file, or folder of it.
        size: Image width and height, px.
        unit: Unit of lengths.
        up: Axis that points up.
        inverse: Whether extrinsics are world_from_cam.
    """

    file: str | None = None
    size: tuple[int, int] | None = None
    unit: LengthUnit | None = None
    up: UpDirection | None = None
    inverse: bool | None = None

    def read(self, recording: Path, size: tuple[int, int] | None = None) -> CameraRig:
        """Read the cameras of a recording; errors as in `read_calibration`.

        Args:
            recording: Folder in which the calibration is looked for, or a file in that folder.
            size: Image width and height, px, where neither this nor the calibration has them.
        """
        path = Path(self.file or (recording.parent if recording.is_file() else recording))
        try:
            return read_calibration(path, size=self.size or size, unit=self.unit, up=self.up, inverse=self.inverse)
        except FileNotFoundError as error:
            raise FileNotFoundError(f"{error}; name it by data.calibration=...") from None
        except LacksSize as error:
            raise LacksSize(error.what, "data.size") from None

    def convention(self, own: Convention) -> Convention:
        """Return a convention with what is given here in its place."""
        return _convention(own, self.unit, self.up, self.inverse)


FOUND = CalibrationSource()
"""The calibration found in the folder of a recording."""


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
        path: The file, recognised by its content; of EasyMocap one of the two, or their folder; or a folder in which
            `find_calibration` finds the one calibration.
        size: Image width and height, px, for files that do not state them.
        unit: Unit of lengths; None for that of the format.
        up: Axis that points up; None for that of the format.
        inverse: Whether poses are written as world_from_cam; None for what is usual in the format.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is malformed, of no known format, or lacks image sizes; the message names it, the
            camera and the key.
    """
    path = Path(path)
    path = find_calibration(path) if path.is_dir() else path
    format = calibration_format[recognise(path)]
    return _convention(format.convention, unit, up, inverse).rig(format.function(path, size))


def convention_of(
    path: Path, *, unit: LengthUnit | None = None, up: UpDirection | None = None, inverse: bool | None = None
) -> Convention:
    """Return the convention in which `read_calibration` takes a file to be written."""
    path = Path(path)
    format = calibration_format[recognise(find_calibration(path) if path.is_dir() else path)]
    return _convention(format.convention, unit, up, inverse)


def write_calibration(
    rig: CameraRig,
    path: Path,
    format: str,
    *,
    unit: LengthUnit | None = None,
    up: UpDirection | None = None,
    inverse: bool | None = None,
) -> None:
    """Write cameras to a file, of EasyMocap to a folder; `unit`, `up` and `inverse` as in `read_calibration`.

    Every format holds names and image sizes. Formats that write Rodrigues vectors, pose2sim and easymocap, make
    rotations exact that a publication rounded, about the same camera centres.

    Raises:
        ValueError: there is no such format, or it cannot hold a lens: shelf has no distortion, voxelpose and panoptic
            have five coefficients, voxelpose no skew, and only pose2sim has fisheyes.
    """
    found = calibration_format.find(format)
    found.write(_convention(found.convention, unit, up, inverse).written_rig(rig), Path(path))


def _convention(own: Convention, unit: LengthUnit | None, up: UpDirection | None, inverse: bool | None) -> Convention:
    changes = {"unit": unit, "up": up, "inverse": inverse}
    return replace(own, **{key: value for key, value in changes.items() if value is not None})


def recognise(path: Path) -> str:
    """Return the name of the format of a calibration file.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is of none of the formats, or too malformed to tell.
    """
    path = Path(path)
    start = read_text(path).lstrip()
    # The YAML of OpenCV is read by its format alone.
    syntax, content = "yaml", None
    if not start.startswith("%YAML") and path.suffix not in (".yml", ".yaml"):
        syntax = "json" if start.startswith("{") or path.suffix == ".json" else "toml"
        content = read_json(path) if syntax == "json" else read_toml(path)
    for format in calibration_format.values():
        if format.syntax == syntax and format.matches(content):
            return format.name
    known = "; ".join(format.help.removesuffix(".") for format in calibration_format.values())
    raise ValueError(f"{path}: expected a calibration: {known}; found {start[:60]!r}")


def find_calibration(folder: Path) -> Path:
    """Return the one calibration of the recording in a folder; of EasyMocap, its `intri.yml`.

    Files called calibration are looked for in the folder and in its folders called calibration, and, where there are
    none, in such folders next to it and next to its parent.

    Raises:
        FileNotFoundError: there is none; the message lists the patterns that were looked for.
        ValueError: there are several; the message lists them.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder")
    formats = calibration_format.values()
    inside = sorted({pattern for format in formats for pattern in format.files})
    above = sorted({pattern for format in formats for pattern in format.files_above})
    whole = folder.resolve()
    for place, patterns in ((folder, inside), (whole.parent, above), (whole.parent.parent, above)):
        found = sorted({path for pattern in patterns for path in place.glob(pattern) if path.is_file()})
        if len(found) > 1:
            raise ValueError(
                f"{folder}: expected one calibration, found {', '.join(map(str, found))}; name the file to use"
            )
        if found:
            return found[0]
    beside = ", ".join(f"../{pattern}, ../../{pattern}" for pattern in above)
    raise FileNotFoundError(f"{folder}: found no calibration; looked for {', '.join(inside)}, {beside}")
