"""Calibrations in whatever format they come."""

from dataclasses import replace
from enum import StrEnum
from pathlib import Path

from dmae.cameras import CameraRig
from dmae.conventions import Convention, Unit, Up
from dmae.formats import easymocap, panoptic, shelf, toml, voxelpose
from dmae.store import read_json


class CalibrationFormat(StrEnum):
    """Whose calibration file it is."""

    pose2sim = "pose2sim"
    """TOML of Pose2Sim and anipose."""
    shelf = "shelf"
    """JSON of the 4DAssociation release."""
    voxelpose = "voxelpose"
    """JSON of VoxelPose."""
    easymocap = "easymocap"
    """`intri.yml` and `extri.yml`."""
    panoptic = "panoptic"
    """JSON of CMU Panoptic."""


_MODULES = {
    CalibrationFormat.pose2sim: toml,
    CalibrationFormat.shelf: shelf,
    CalibrationFormat.voxelpose: voxelpose,
    CalibrationFormat.easymocap: easymocap,
    CalibrationFormat.panoptic: panoptic,
}

# Where the projects keep theirs, in and below the folder of a recording.
_PLACES = (
    "*alib*.toml",
    "*alib*.json",
    easymocap.INTRINSICS,
    "*alib*/*.toml",
    "*alib*/*.json",
    f"*/{easymocap.INTRINSICS}",
)
# Pose2Sim keeps one calibration for all trials of a session.
_PLACES_ABOVE = ("*alib*/*.toml",)


def read_calibration(
    path: Path,
    *,
    size: tuple[int, int] | None = None,
    unit: Unit | None = None,
    up: Up | None = None,
    inverse: bool | None = None,
) -> CameraRig:
    """The cameras of a calibration file, in our convention: cam_from_world, m, z up.

    Args:
        path: The file, recognised by what is in it; of EasyMocap either of the two, or their folder; or a
            folder of which `find_calibration` finds the one calibration.
        size: Image width and height, px, for files that hold none.
        unit: What lengths are written in; None for what the format prescribes. So are `up` and `inverse`,
            which says that poses are written as world_from_cam.

    Raises:
        FileNotFoundError: no such file.
        ValueError: the file is malformed, of no known format, or lacks image sizes; the message names it, the
            camera and the key.
    """
    path = Path(path)
    path = find_calibration(path) if path.is_dir() else path
    module = _MODULES[recognise(path)]
    return convention_of(path, unit=unit, up=up, inverse=inverse).rig(module.read_cameras(path, size))


def convention_of(
    path: Path, *, unit: Unit | None = None, up: Up | None = None, inverse: bool | None = None
) -> Convention:
    """How `read_calibration` takes a file to write its world and its extrinsics."""
    path = Path(path)
    module = _MODULES[recognise(find_calibration(path) if path.is_dir() else path)]
    return _convention(module.CONVENTION, unit, up, inverse)


def write_calibration(
    rig: CameraRig,
    path: Path,
    format: CalibrationFormat,
    *,
    unit: Unit | None = None,
    up: Up | None = None,
    inverse: bool | None = None,
) -> None:
    """Write cameras to a file, of EasyMocap to a folder; `unit`, `up` and `inverse` as in `read_calibration`.

    Names and image sizes are held by every format. Rotations that a publication rounded are made exact by those
    that write Rodrigues vectors, pose2sim and easymocap, about the same camera centres.

    Raises:
        ValueError: the format cannot hold a lens: shelf has no distortion, voxelpose and panoptic have five
            coefficients, voxelpose no skew, and only pose2sim has fisheyes.
    """
    module = _MODULES[CalibrationFormat(format)]
    module.write_cameras(_convention(module.CONVENTION, unit, up, inverse).written_rig(rig), Path(path))


def _convention(own: Convention, unit: Unit | None, up: Up | None, inverse: bool | None) -> Convention:
    changes = {"unit": unit, "up": up, "inverse": inverse}
    return replace(own, **{key: value for key, value in changes.items() if value is not None})


def recognise(path: Path) -> CalibrationFormat:
    """The format of a calibration file.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is of none of the formats, or too malformed to tell.
    """
    path = Path(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file")
    try:
        start = path.read_text().lstrip()
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: expected a calibration in a text format, {error}") from None
    if start.startswith("%YAML") or path.suffix in (".yml", ".yaml"):
        return CalibrationFormat.easymocap
    if start.startswith("{") or path.suffix == ".json":
        found = _recognise_json(read_json(path))
    else:
        tables = toml.read_toml(path).values()
        found = CalibrationFormat.pose2sim if any(isinstance(t, dict) and "matrix" in t for t in tables) else None
    if found is None:
        raise ValueError(
            f"{path}: expected a calibration: tables with matrix, distortions, rotation (Pose2Sim, anipose), cameras "
            f"with K, RT, imgSize (4DAssociation), with R, T, fx (VoxelPose) or in a list (Panoptic), or "
            f"{easymocap.INTRINSICS} (EasyMocap); found {start[:60]!r}"
        )
    return found


def _recognise_json(content) -> CalibrationFormat | None:
    if not isinstance(content, dict):
        return None
    if isinstance(content.get("cameras"), list):
        return CalibrationFormat.panoptic
    keys = {key for camera in content.values() if isinstance(camera, dict) for key in camera}
    if keys & {"RT", "imgSize"}:
        return CalibrationFormat.shelf
    return CalibrationFormat.voxelpose if keys & {"T", "fx", "fy"} else None


def find_calibration(folder: Path) -> Path:
    """The one calibration that belongs to the recording in a folder; of EasyMocap, its `intri.yml`.

    Looked for are files called calibration in the folder and those in its folders called calibration, and, where
    there are none, those in such folders beside it and beside its parent.

    Raises:
        FileNotFoundError: there is none; the message lists what was looked for.
        ValueError: there are several; the message lists them.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder")
    whole = folder.resolve()
    for place, patterns in ((folder, _PLACES), (whole.parent, _PLACES_ABOVE), (whole.parent.parent, _PLACES_ABOVE)):
        found = sorted({path for pattern in patterns for path in place.glob(pattern) if path.is_file()})
        if len(found) > 1:
            raise ValueError(
                f"{folder}: expected one calibration, found {', '.join(map(str, found))}; name the file to use"
            )
        if found:
            return found[0]
    above = ", ".join(f"../{pattern}, ../../{pattern}" for pattern in _PLACES_ABOVE)
    raise FileNotFoundError(f"{folder}: found no calibration; looked for {', '.join(_PLACES)}, {above}")
