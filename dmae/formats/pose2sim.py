"""Pose2Sim: a trial of a session, with the settings of its Config.toml files."""

from dataclasses import replace
from pathlib import Path

from dmae.data.clip import Clip
from dmae.data.skeleton import BODY25, BODY25B, COCO17, COCO18, HALPE26, Skeleton
from dmae.files.numbers import check_rate
from dmae.files.structured import read_toml
from dmae.formats import openpose
from dmae.formats.calibrations.files import FOUND, CalibrationSource
from dmae.formats.pictures.video_rate import video_rate
from dmae.formats.recordings.numbered_detections import NumberedDetections, with_cameras
from dmae.formats.registry import reader
from dmae.formats.trc import trc_rate

_LEVELS = 3
"""Number of folders that can contain a Config.toml: the trial, the participant above it, the session above both."""
_POSES = ("pose-sync", "pose")
"""Folders of the detections of a trial. Synchronised detections are preferred."""
_MODELS = {
    "body25": BODY25, "body25b": BODY25B, "coco": COCO18, "coco17": COCO17, "body": COCO17,
    "halpe26": HALPE26, "bodywithfeet": HALPE26,
}  # fmt: skip


@reader("pose2sim", signs=[["pose"], ["pose-sync"]])
def read_pose2sim(
    path: Path,
    *,
    calibration: CalibrationSource = FOUND,
    detections: Path | None = None,
    fps: float | None = None,
    skeleton: Skeleton | None = None,
) -> Clip:
    """A trial of a Pose2Sim session, with the Config.toml files and the calibration of the session.

    Args:
        path: The trial.
        calibration: Path of the calibration, and the values that its file does not state.
        detections: Folder that contains the folders of the cameras; by default `pose-sync` or `pose` in `path`.
        fps: Frames per second; by default the rate of the session.
        skeleton: Skeleton of the detections; by default the skeleton of the session.

    Raises:
        FileNotFoundError, ValueError: as `read_detections` and `with_cameras`.
    """
    return with_cameras(read_detections(path, detections, skeleton), path, calibration, fps)


def read_detections(path: Path, detections: Path | None = None, skeleton: Skeleton | None = None) -> NumberedDetections:
    """Read the detections of a trial, in `pose-sync/` or else `pose/`.

    Pose2Sim's associated detections are not read, because capture associates persons itself. A setting is read from
    the nearest Config.toml that contains it: `pose.pose_model` is the skeleton, `project.frame_rate` the frame rate. If
    no file states the frame rate, it is the rate of `videos/*`, or else of `pose-3d/*.trc` in the trial.

    Raises:
        FileNotFoundError: the folder is not a trial; the message lists the trials in it.
        ValueError: a file is malformed.
    """
    path = Path(path).resolve()
    folder = detections or next((path / name for name in _POSES if (path / name).is_dir()), None)
    if folder is None:
        trials = sorted(
            str(found.parent.relative_to(path)) for depth in ("*", "*/*") for found in path.glob(f"{depth}/pose")
        )
        hint = f"; there are trials {', '.join(trials)}" if trials else "; name its folder by data.detections=..."
        raise FileNotFoundError(f"{path}: expected a trial, a folder that holds pose/{hint}")
    model = _setting(path, "pose", "pose_model")
    named = _MODELS.get(str(model).lower().replace("_", "").replace("-", ""))
    try:
        found = openpose.read_detections(folder, skeleton or named)
    except ValueError:
        # The number of joints shows that another model than in Config.toml made the files.
        if skeleton or not named:
            raise
        found = openpose.read_detections(folder)
        found = replace(found, notes=(*found.notes, f"{path}: not the {model} that Config.toml says"))
    return replace(found, fps=_rate(path))


def _rate(path: Path) -> float | None:
    rate = _setting(path, "project", "frame_rate")
    if isinstance(rate, int | float) and rate > 0:
        return check_rate(f"{path}: frame_rate of Config.toml", rate)
    rate = video_rate(path / "videos")
    if rate:
        return rate
    rates = {trc_rate(file) for file in sorted((path / "pose-3d").glob("*.trc"))}
    return rates.pop() if len(rates) == 1 else None


def _setting(path: Path, table: str, key: str):
    """Return a setting from the nearest Config.toml that contains it; None if no file contains it."""
    for level in [path, *path.parents][:_LEVELS]:
        file = level / "Config.toml"
        if not file.is_file():
            continue
        found = read_toml(file).get(table, {})
        if isinstance(found, dict) and key in found:
            return found[key]
    return None
