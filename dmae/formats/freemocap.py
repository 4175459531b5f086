"""FreeMoCap: the folder of a recording, with detections by MediaPipe in its synchronised videos."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dmae.data.skeleton import BLAZEPOSE33, Skeleton
from dmae.files.arrays import read_npy
from dmae.files.checks import MOST_PIXELS, check_numbers
from dmae.formats.calibrations import FOUND, CalibrationSource
from dmae.formats.config import LengthUnit, UpDirection
from dmae.formats.footage import video_rate
from dmae.formats.recordings import NumberedDetections
from dmae.formats.registry import reader

_POINTS = "*2dData_numCams_numFrames_numTrackedPoints_pixelXY.npy"
_FOLDERS = ("", "output_data/raw_data", "output_data")
_VIDEOS = "synchronized_videos"


@reader(
    "freemocap",
    signs=[["output_data/raw_data/*2dData_numCams*.npy"], ["output_data/*2dData_numCams*.npy"]],
    cameras=False,
)
def read_freemocap(
    path: Path,
    *,
    calibration: CalibrationSource = FOUND,
    detections: Path | None = None,
    skeleton: Skeleton | None = None,
) -> NumberedDetections:
    """A FreeMoCap recording: <name>_camera_calibration.toml and output_data/raw_data/*2dData*_pixelXY.npy.

    Lengths in its calibration are in mm, and its world has the axes of the first camera, y down, unless `unit` and
    `up` are given. The synchronised videos give the rate. The array of points (cameras, frames, points, 2 or 3)
    contains the cameras of the calibration in the same order: x, y in px and, in some files, a depth, which is not
    read. Files have no confidence; it is 1. The first J points are the J joints of the skeleton.

    Args:
        detections: The file of the array, or a folder that contains it.
        skeleton: By default MediaPipe's 33 body landmarks.

    Raises:
        FileNotFoundError: there is no calibration, or no array.
        ValueError: there are several arrays, or the array has another shape.
    """
    unit, up = calibration.unit or LengthUnit.mm, calibration.up or UpDirection.minus_y
    rig, skeleton = replace(calibration, unit=unit, up=up).read(path), skeleton or BLAZEPOSE33
    file = _file(Path(detections or path))
    values = read_npy(file)
    shape = f"({len(rig)} cameras, frames, {len(skeleton)} or more points, 2 or 3)"
    if not isinstance(values, np.ndarray) or values.ndim != 4 or values.dtype.kind not in "fiu":
        raise ValueError(f"{file}: expected numbers of shape {shape}, found {getattr(values, 'shape', type(values))}")
    views, frames, points, numbers = values.shape
    if views != len(rig) or points < len(skeleton) or numbers not in (2, 3) or not frames:
        raise ValueError(f"{file}: expected shape {shape}, found {values.shape}")
    xy = values[:, :, : len(skeleton), :2].astype(np.float64)
    check_numbers(f"{file}: pixels", xy, MOST_PIXELS)
    # YOLO's joints that were not found are at 0, 0.
    known = np.isfinite(xy).all(-1, keepdims=True) & xy.any(-1, keepdims=True)
    rows = np.where(known, np.pad(xy, [(0, 0)] * 3 + [(0, 1)], constant_values=1.0), np.nan)
    each = {name: dict(enumerate(view[:, None])) for name, view in zip(rig.names, rows, strict=True)}
    return NumberedDetections(skeleton, each, video_rate(path / _VIDEOS), rig=rig)


def _file(path: Path) -> Path:
    if path.is_file():
        return path
    found = [file for folder in _FOLDERS for file in sorted((path / folder).glob(_POINTS))]
    if len(found) > 1:
        raise ValueError(f"{path}: expected one array of points, found {', '.join(map(str, found))}; give one as "
                         "data.detections=...")  # fmt: skip
    if not found:
        raise FileNotFoundError(f"{path}: expected output_data/raw_data/{_POINTS}, found none")
    return found[0]
