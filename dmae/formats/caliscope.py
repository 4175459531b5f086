"""Caliscope: recordings of a project, with the points of a tracker in one CSV file for all cameras.

Its calibration is TOML with one table per camera in `cameras`; in older projects, tables `cam_0`, `cam_1` and so on.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.skeleton import BLAZEPOSE33, COCO17, HALPE26, Skeleton
from dmae.files.checks import MOST_PIXELS, check_numbers
from dmae.files.contents import read_text
from dmae.files.structured import read_toml
from dmae.formats.calibrations import calibration_format, camera_tables, make_rig
from dmae.formats.pose2sim import toml_camera
from dmae.formats.recordings import NumberedDetections, csv_rows
from dmae.formats.registry import reader

FILE = "camera_array.toml"
_IDS = ("cam_id", "port")


def _tables(content: dict) -> dict[str, dict]:
    cameras = content.get("cameras")
    if isinstance(cameras, dict):
        return cameras
    return {
        name.removeprefix("cam_"): table
        for name, table in content.items()
        if isinstance(table, dict) and "matrix" in table and any(key in table for key in _IDS)
    }


def _matches(content: dict) -> bool:
    return any(isinstance(table, dict) and "matrix" in table for table in _tables(content).values())


@calibration_format("caliscope", syntax="toml", matches=_matches, files=(FILE,), files_above=(FILE,))
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """TOML tables cameras.0 and on with matrix, distortions, rotation (Caliscope).

    Return cam_from_world, m, of the cameras that the project does not ignore, named as their tables. Rotations are
    matrices or Rodrigues vectors.
    """
    entries = camera_tables(path, _tables(read_toml(path)))
    return make_rig(path, (toml_camera(entry) for entry in entries if entry.values.get("ignore") is not True), size)


_TRACKERS = {"HALPE26": HALPE26, "COCO_WHOLEBODY": COCO17, "HOLISTIC": BLAZEPOSE33, "POSE": BLAZEPOSE33}
"""Skeletons by a part of the name of the tracker. Points of hands and face have larger numbers than body points."""
_POINTS = "xy_*.csv"
_CALIBRATION_TARGETS = ("CHARUCO", "ARUCO", "CHESSBOARD")
_MOST_ROWS = 50_000_000


@reader(
    "caliscope", signs=[["xy_*.csv"], ["*/xy_*.csv"], ["camera_array.toml"], ["recordings/*/*/xy_*.csv"]], cameras=False
)
def read_detections(path: Path, *, skeleton: Skeleton | None = None) -> NumberedDetections:
    """A Caliscope project, or one of its recordings: camera_array.toml and <TRACKER>/xy_<TRACKER>.csv.

    Read the points of a CSV file: one person per camera. The file has no confidences; they become 1.

    The frame number is `sync_index`. Rows of all cameras with the same `sync_index` show the same moment.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: there are several files, the file is malformed, or its tracker is unknown.
    """
    file = _file(Path(path))
    skeleton = skeleton or _skeleton(file)
    header, rows = _rows(file)
    camera = "cam_id" if "cam_id" in header else "port"
    columns = ("sync_index", camera, "point_id", "img_loc_x", "img_loc_y")
    lacking = [name for name in columns if name not in header]
    if lacking:
        raise ValueError(f"{file}: expected the columns {', '.join(columns)}, found {', '.join(header)}")
    known = rows[:, [header.index(name) for name in columns]]
    whole, xy = known[:, :3], known[:, 3:]
    check_numbers(f"{file}: img_loc", xy, MOST_PIXELS)
    if not (np.isfinite(whole) & (whole == np.round(whole)) & (whole >= 0) & (whole < 1e9)).all():
        raise ValueError(f"{file}: expected whole numbers of frames, cameras and points from 0 on")
    index, cameras, point = whole.T
    body = point < len(skeleton)
    if not body.any():
        raise ValueError(f"{file}: found no point of {skeleton.name}, which have numbers below {len(skeleton)}")
    views: dict[str, dict[int, np.ndarray]] = {}
    for name in np.unique(cameras).astype(int):
        own = body & (cameras == name)
        numbers, place = np.unique(index[cameras == name], return_inverse=True)
        frames = np.full((len(numbers), 1, len(skeleton), 3), np.nan)
        kept = own[cameras == name]
        frames[place[kept], 0, point[own].astype(int), :2] = xy[own]
        frames[..., 2] = np.where(np.isfinite(frames[..., 0]), 1.0, np.nan)
        views[str(name)] = dict(zip(numbers.astype(int).tolist(), frames, strict=True))
    return NumberedDetections(skeleton, views, _rate(header, rows))


def _file(path: Path) -> Path:
    if path.is_file():
        return path
    for pattern in (_POINTS, f"*/{_POINTS}", f"recordings/*/*/{_POINTS}", f"*/*/{_POINTS}"):
        found = [file for file in sorted(path.glob(pattern)) if not file.stem.upper().endswith(_CALIBRATION_TARGETS)]
        if len(found) > 1:
            names = ", ".join(str(file.relative_to(path)) for file in found)
            raise ValueError(f"{path}: expected the points of one recording and tracker, found {names}; give one of "
                             "them as data.detections=..., or the recording as data.path=...")  # fmt: skip
        if found:
            return found[0]
    raise FileNotFoundError(f"{path}: expected <TRACKER>/xy_<TRACKER>.csv, found none; name it by data.detections=...")


def _skeleton(file: Path) -> Skeleton:
    tracker = file.stem.upper()
    for part, skeleton in _TRACKERS.items():
        if part in tracker:
            return skeleton
    raise ValueError(
        f"{file}: expected a tracker called {', '.join(_TRACKERS)}, found {file.stem}; data.skeleton=... names the "
        "skeleton of its points"
    )


def _rows(file: Path) -> tuple[list[str], np.ndarray]:
    """Return the names of the columns, and the values (n, columns); NaN where a cell is empty."""
    header, *lines = read_text(file).splitlines() or [""]
    names = [name.strip() for name in header.split(",")]
    if len(lines) > _MOST_ROWS:
        raise ValueError(f"{file}: expected up to {_MOST_ROWS:,} rows, found {len(lines):,}")
    rows = csv_rows(file, [line.split(",") for line in lines], len(names), 2)
    if not len(rows):
        raise ValueError(f"{file}: expected a row for each point, found none")
    return names, rows


def _rate(header: Sequence[str], rows: np.ndarray) -> float | None:
    """Return the frames per second, from the first time of each frame in the file; None if there are no times."""
    if "frame_time" not in header:
        return None
    index, time = rows[:, header.index("sync_index")], rows[:, header.index("frame_time")]
    known = np.isfinite(index) & np.isfinite(time)
    numbers, first = np.unique(index[known], return_index=True)
    times = time[known][first]
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = np.diff(times) / np.diff(numbers)
    step = np.median(steps) if len(steps) else np.nan
    return float(np.round(1 / step, 2)) if 1e-3 < step < 1e3 else None
