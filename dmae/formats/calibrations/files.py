"""Find, recognise, read and write calibration files of any format."""

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
    """Path of the calibration of a recording, and values that its file does not state.

    Attributes:
        file: Calibration file, or folder that contains it; None to search for it in the recording.
        size: Image width and height, px; None if the file states it.
        unit: Unit of lengths; None for the unit of the format.
        up: Axis that points up; None for the axis of the format.
        inverse: Whether extrinsics are world_from_cam; None for the convention of the format.
    """

    file: str | None = None
    size: tuple[int, int] | None = None
    unit: LengthUnit | None = None
    up: UpDirection | None = None
    inverse: bool | None = None

    def read(self, recording: Path, size: tuple[int, int] | None = None) -> CameraRig:
        """Return the cameras of a recording; errors as in `read_calibration`.

        Args:
            recording: Folder to search for the calibration, or a file in that folder.
            size: Image width and height, px, if neither `self.size` nor the calibration states it.
        """
        path = Path(self.file or (recording.parent if recording.is_file() else recording))
        try:
            return read_calibration(path, size=self.size or size, unit=self.unit, up=self.up, inverse=self.inverse)
        except FileNotFoundError as error:
            raise FileNotFoundError(f"{error}; name it by data.calibration=...") from None
        except LacksSize as error:
            raise LacksSize(error.what, "data.size") from None

    def convention(self, own: Convention) -> Convention:
        """Return the convention `own`, changed to the unit, up axis and direction that are given here."""
        return _convention(own, self.unit, self.up, self.inverse)


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
            also be a folder in which `find_calibration` finds one calibration.
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
    path = find_calibration(path) if path.is_dir() else path
    format = calibration_format[recognise(path)]
    return _convention(format.convention, unit, up, inverse).rig(format.function(path, size))


def convention_of(
    path: Path, *, unit: LengthUnit | None = None, up: UpDirection | None = None, inverse: bool | None = None
) -> Convention:
    """Return the convention by which `read_calibration` reads a file; arguments as in `read_calibration`."""
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
    """Write cameras to a file, or for EasyMocap to a folder; `unit`, `up` and `inverse` as in `read_calibration`.

    Every format stores names and image sizes. The formats pose2sim and easymocap write Rodrigues vectors: rotations
    that a publication rounded become exact, and camera centres do not change.

    Raises:
        ValueError: the format is unknown or cannot store a lens. shelf stores no distortion, voxelpose and panoptic
            store five coefficients, voxelpose stores no skew, and only pose2sim and caliscope store fisheyes.
    """
    found = calibration_format.find(format)
    found.write(_convention(found.convention, unit, up, inverse).written_rig(rig), Path(path))


def _convention(own: Convention, unit: LengthUnit | None, up: UpDirection | None, inverse: bool | None) -> Convention:
    changes = {"unit": unit, "up": up, "inverse": inverse}
    return replace(own, **{key: value for key, value in changes.items() if value is not None})


def recognise(path: Path) -> str:
    """Return the name of the format of a calibration file.

    Raises:
        FileNotFoundError: the file does not exist.
        ValueError: the file has none of the known formats, or is malformed.
    """
    path = Path(path)
    start = read_text(path).lstrip()
    # Only the module of its format parses OpenCV's dialect of YAML.
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
    """Return the only calibration file of the recording in a folder; for EasyMocap, its `intri.yml`.

    The patterns `files` of all formats are searched in the folder. If there is no match, the patterns `files_above` are
    searched in its parent folder, and then in the folder above that.

    Raises:
        FileNotFoundError: there is no calibration; the message lists the patterns.
        ValueError: there are several calibrations; the message lists them.
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
