"""Pose2Sim: a trial of a session, with its Config.toml files and its calibration, TOML with one table per camera."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import tomlkit
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.skeleton import BODY25, BODY25B, COCO17, COCO18, HALPE26, Skeleton
from dmae.files.checks import check_rate
from dmae.files.contents import write_atomic
from dmae.files.structured import read_toml
from dmae.formats import openpose
from dmae.formats.calibrations import (
    CameraTable,
    ParsedCamera,
    calibration_format,
    camera_tables,
    make_rig,
    orthonormal,
    require,
)
from dmae.formats.footage import video_rate
from dmae.formats.recordings import NumberedDetections
from dmae.formats.registry import reader
from dmae.formats.trc import trc_rate

_METADATA = "metadata"


def toml_camera(entry: CameraTable) -> ParsedCamera:
    """Return the camera of a table as Pose2Sim, anipose and Caliscope write it; the last writes rotations as matrices.

    Raises ValueError, with file, camera and key, if it is malformed.
    """
    dist, fisheye = entry.lens("distortions")
    turned = entry.numbers("rotation", 3, 9)
    return ParsedCamera(
        str(entry.values.get("name", entry.camera)),
        entry.intrinsics("matrix"),
        dist,
        entry.rodrigues("rotation") if turned.size == 3 else entry.rotation("rotation"),
        entry.numbers("translation", 3),
        entry.size("size") if "size" in entry.values else None,
        fisheye,
    )


def write_cameras(rig: CameraRig, path: Path) -> None:
    """Write cameras to a file. Rounded rotations in `cam_from_world` become exact."""
    require("a Pose2Sim calibration", rig, coefficients=8, fisheye=True)
    R, t = orthonormal(rig)
    rotation = Rotation.from_matrix(R).as_rotvec()
    tables = {}
    for view, name in enumerate(rig.names):
        # A camera can have any name, but the table `[metadata]` is not a camera.
        tables[f"camera_{name}" if name == _METADATA else name] = {
            "name": name,
            "size": rig.size[view].astype(float).tolist(),
            "matrix": rig.K[view].tolist(),
            "distortions": _coefficients(rig, view).tolist(),
            "rotation": rotation[view].tolist(),
            "translation": t[view].tolist(),
            "fisheye": bool(rig.fisheye[view]),
        }
    write_atomic(path, tomlkit.dumps(tables))


def _coefficients(rig: CameraRig, view: int) -> np.ndarray:
    """Return the distortion coefficients of a view: 4 if the others are zero, as Pose2Sim writes, or else 5 or 8."""
    dist = np.pad(rig.dist[view], (0, 8 - rig.dist.shape[1]))
    return dist[: 4 if not dist[4:].any() else 5 if not dist[5:].any() else 8]


def _matches(content: dict) -> bool:
    return any(isinstance(table, dict) and "matrix" in table for table in content.values())


@calibration_format(
    "pose2sim",
    syntax="toml",
    matches=_matches,
    write=write_cameras,
    files=("*alib*.toml", "*alib*/*.toml"),
    # In Pose2Sim, all trials of a session share one calibration.
    files_above=("*alib*/*.toml",),
)
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """TOML tables with matrix, distortions, rotation (Pose2Sim, anipose).

    Return the cameras of the file: cam_from_world, in the unit of the file. It contains rotations as Rodrigues vectors.

    A camera without `name` has the name of its table. Distortion is OpenCV's k1 k2 p1 p2 [k3 [k4 k5 k6]], or with
    `fisheye = true` k1 k2 k3 k4. `[metadata]` is not read.
    """
    tables = {name: table for name, table in read_toml(path).items() if name != _METADATA}
    return make_rig(path, map(toml_camera, camera_tables(path, tables)), size)


_LEVELS = 3
"""Number of folders that can contain a Config.toml: the trial, the participant above it, the session above both."""
_POSES = ("pose-sync", "pose")  # Folders of the detections of a trial. Synchronised detections are preferred.
_MODELS = {
    "body25": BODY25, "body25b": BODY25B, "coco": COCO18, "coco17": COCO17, "body": COCO17,
    "halpe26": HALPE26, "bodywithfeet": HALPE26,
}  # fmt: skip


@reader("pose2sim", signs=[["pose"], ["pose-sync"]], cameras=False)
def read_detections(
    path: Path, *, detections: Path | None = None, skeleton: Skeleton | None = None
) -> NumberedDetections:
    """A trial of a Pose2Sim session, with the Config.toml files and the calibration of the session.

    By default detections are in `pose-sync/` or else `pose/` of the trial; Pose2Sim's associated detections are not
    read, because capture associates persons itself. A setting is read from the nearest Config.toml that contains it:
    `pose.pose_model` is the skeleton, `project.frame_rate` the frame rate. If no file states the frame rate, it is the
    rate of `videos/*`, or else of `pose-3d/*.trc` in the trial.

    Raises FileNotFoundError, which lists trials, if the folder is none, and ValueError if a file is malformed.
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
        found = openpose.read_detections(folder, skeleton=skeleton or named)
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
