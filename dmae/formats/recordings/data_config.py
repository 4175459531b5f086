"""Options of a recording: its path, and the values that its files do not state."""

from dataclasses import dataclass, field

from dmae.formats.calibrations.conventions import LengthUnit, UpDirection
from dmae.formats.registry import reader


@dataclass(frozen=True)
class DataConfig:
    """The recording, clip or data set to read."""

    name: str | None = field(default=None, metadata={"choices": reader})
    """Format; by default recognised by the files in `path`."""
    path: str = "???"
    """Folder of the recording, of a clip, or of a data set of clips."""
    cameras: list[int | str] | None = None
    """Cameras to use, by name or counted from 0; by default all."""
    frames: list[int] | None = None
    """First frame to use, and the one after the last; by default all."""
    calibration: str | None = None
    """Calibration file, or folder of them; by default the one found in `path`."""
    detections: str | None = None
    """Folder of the detections, or file of COCO's; by default found in `path`."""
    videos: str | None = None
    """Folder of the videos that people were detected in, <camera>.mp4: backgrounds of reports and pictures."""
    images: str | None = None
    """Folder of the pictures that people were detected in, a folder of PNG or JPEG files for each camera."""
    fps: float | None = None
    """1/s; frame rate, if the files do not state it."""
    size: list[int] | None = None
    """px; image width and height, if the files do not state them."""
    skeleton: str | None = None
    """Skeleton of the detections, if the files do not state it or are wrong."""
    unit: LengthUnit | None = None
    """Unit of lengths in the calibration; by default that of its format."""
    up: UpDirection | None = None
    """Axis that points up in the calibration; by default that of its format."""
    inverse: bool | None = None
    """Whether extrinsics of the calibration are world_from_cam; by default as in its format."""
    offsets: list[int | str] | None = None
    """Frames by which each camera started late, in the order of the calibration, or those of some cameras as
    [name:frames]: frame k of a camera is frame k + offset."""
