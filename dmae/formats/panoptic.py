"""CMU Panoptic Studio: calibration of up to 521 cameras, 3D poses in a JSON file per frame, detections by OpenPose."""

import json
import re
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.skeleton import BODY25, PANOPTIC19, Skeleton
from dmae.files.checks import MOST_METRES, MOST_VARIANCE, check_numbers, child, numbers_of
from dmae.files.contents import write_atomic
from dmae.files.structured import read_json
from dmae.formats import openpose
from dmae.formats.calibrations import (
    FOUND,
    CalibrationSource,
    CameraTable,
    ParsedCamera,
    calibration_format,
    make_rig,
    require,
    write_calibration,
)
from dmae.formats.config import Convention, LengthUnit, UpDirection
from dmae.formats.poses import PoseFile
from dmae.formats.recordings import NumberedDetections, check_span, json_frames, listed
from dmae.formats.registry import pose_reader, pose_writer, reader
from dmae.progress import progress

CONVENTION = Convention(unit=LengthUnit.cm, up=UpDirection.minus_y)


def _camera(path: Path, number: int, values: dict) -> ParsedCamera:
    name = values.get("name") if isinstance(values, dict) else None
    entry = CameraTable(path, f"number {number}" if name is None else str(name), values)
    if name is None:
        raise entry.error("name", "of the camera", f"no such key among {sorted(values)}")
    return ParsedCamera(
        entry.camera,
        entry.intrinsics("K"),
        entry.numbers("distCoef", 5),
        entry.rotation("R"),
        entry.numbers("t", 3),
        entry.size("resolution") if "resolution" in values else None,
    )


def write_cameras(rig: CameraRig, path: Path) -> None:
    """Write cameras, `cam_from_world` as it is. Names such as 00_12 give panel and node; others are in panel 0."""
    require("a Panoptic calibration", rig, coefficients=5)
    cameras = []
    for view, name in enumerate(rig.names):
        place = re.fullmatch(r"(\d\d)_(\d\d)", name)
        panel, node = map(int, place.groups()) if place else (0, view)
        cameras.append(
            {
                "name": name,
                "type": "hd",
                "resolution": rig.size[view].tolist(),
                "panel": panel,
                "node": node,
                "K": rig.K[view].tolist(),
                "distCoef": rig.dist[view, :5].tolist(),
                "R": rig.cam_from_world[view, :3, :3].tolist(),
                "t": rig.cam_from_world[view, :3, 3:].tolist(),
            }
        )
    write_atomic(path, json.dumps({"calibDataSource": "dmae", "cameras": cameras}, indent=1))


def _matches(content: object) -> bool:
    return isinstance(content, dict) and isinstance(content.get("cameras"), list)


@calibration_format(
    "panoptic",
    syntax="json",
    matches=_matches,
    write=write_cameras,
    convention=CONVENTION,
    files=("*alib*.json", "*alib*/*.json"),
)
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """JSON with a list of cameras (CMU Panoptic).

    Return the cameras of the file: cam_from_world, cm, y down.
    """
    cameras = listed(path, read_json(path), "cameras")
    return make_rig(path, (_camera(path, number, values) for number, values in enumerate(cameras)), size)


POSES = "hdPose3d_stage1_coco19"
_SCENE = "body3DScene_"
_VALUES = 10  # Number of values per joint: x, y, z, source, and six entries of the covariance
_UPPER = np.triu_indices(3)
_MATRIX = np.array([[4, 5, 6], [5, 7, 8], [6, 8, 9]])  # Places of the entries of the covariance among the values


@reader(
    "panoptic",
    signs=[["hdPose3d_stage1_coco19"], ["calibration_*.json", "hdVideos"], ["*/body3DScene_*.json"]],
    cameras=False,
)
def read_panoptic(
    path: Path,
    *,
    calibration: CalibrationSource = FOUND,
    detections: Path | None = None,
    skeleton: Skeleton | None = None,
) -> NumberedDetections:
    """A CMU Panoptic sequence: calibration_<sequence>.json, poses as truth, and OpenPose's JSON of the cameras in use.

    Panoptic publishes cameras and poses. The detections have to be made with OpenPose. If there are none, as in an
    export of this package, the clip has truth but no detections. `unit` and `up` also apply to the truth. By default
    the pose files state the rate, and the skeleton is found as in `dmae.formats.openpose.read_detections`.
    """
    try:
        found = openpose.read_detections(detections or path, skeleton=skeleton)
    except FileNotFoundError:
        if detections is not None:
            raise
        found = None
    try:
        poses = read_poses(path, CONVENTION.changed(calibration.unit, calibration.up))
    except FileNotFoundError as error:
        if found is not None:
            return found
        raise FileNotFoundError(
            f"{error}; expected these, or a folder for each camera that holds <name>_<frame number>_keypoints.json; "
            "name the folder of detections by data.detections=..."
        ) from None
    if found is None:
        skeleton, rig = skeleton or BODY25, calibration.read(path)
        views = {name: dict.fromkeys(poses.xyz, np.empty((0, len(skeleton), 3))) for name in rig.names}
        note = "there are no detections: the recording has its cameras and its truth alone"
        found = NumberedDetections(skeleton, views, rig=rig, notes=(note,))
    notes = (*found.notes, *poses.notes)
    return replace(found, fps=poses.fps, notes=notes, truth=poses.xyz, truth_skeleton=PANOPTIC19)


@pose_reader("panoptic", signs=["hdPose3d_stage1_coco19", "body3DScene_*.json"])
def read_panoptic_poses(path: Path) -> PoseFile:
    """A folder of CMU Panoptic's poses; frames without a file between the first and the last are absent."""
    rows, fps, _ = _read_rows(Path(path), completed=True)
    check_span(path, rows, len(rows))
    absent = np.full_like(next(iter(rows.values())), np.nan)
    found = np.array([rows.get(number, absent) for number in range(min(rows), max(rows) + 1)])
    xyz, stated = CONVENTION.points(found[..., :3]), np.nan_to_num(found[..., 3]).astype(np.uint8)
    source = np.where(stated == Source.ABSENT, Source.MEASURED, stated)
    turn = CONVENTION.points(np.eye(3))
    cov = turn.T @ found[..., _MATRIX] @ turn
    return PoseFile(Poses3D(PANOPTIC19, xyz, np.where(np.isnan(xyz).any(-1), Source.ABSENT, source), cov), fps)


@dataclass(frozen=True)
class PanopticTruth:
    """True poses, of 3D pose files."""

    # By frame number, (P, 19, 3) m, world; NaN where absent. Each body id in the files is one person. All frames have
    # the same P persons, in the order of their ids.
    xyz: dict[int, np.ndarray]
    fps: float | None  # Frames per second; None if the files do not state it
    notes: tuple[str, ...]  # Files that could not be read, and the ids of the persons if they are not 0 to P - 1


def read_poses(path: Path, convention: Convention = CONVENTION) -> PanopticTruth:
    """Read `hdPose3d_stage1_coco19/body3DScene_<frame number>.json`: PANOPTIC19 joints, cm, y down.

    Joints without positive confidence are absent. So are joints that `write_poses` marked as completed: they are not
    truth. If a file is not valid JSON, for example because it is cut short, its frame is absent, and `notes` names
    the first such file.

    Args:
        path: The recording, or the folder that contains the files.
        convention: Unit of lengths and up axis of the files.

    Raises:
        FileNotFoundError: there are no such files.
        ValueError: there are several folders of poses, a file is JSON but not Panoptic's, an id occurs twice in
            a frame, frame rates differ, or no file could be read.
    """
    rows, fps, notes = _read_rows(Path(path), completed=False)
    return PanopticTruth({number: convention.points(row[..., :3]) for number, row in rows.items()}, fps, notes)


def _read_rows(path: Path, completed: bool) -> tuple[dict[int, np.ndarray], float | None, tuple[str, ...]]:
    """Return joints (P, 19, 10) as `_bodies` does, by frame number, frames per second, and notes."""
    frames: dict[int, dict[int, np.ndarray]] = {}
    rates: dict[float, Path] = {}
    unreadable: dict[str, list[str]] = {}
    files = sorted(_pose_folder(path).glob(f"{_SCENE}*.json"))
    for _, number, file, content in json_frames(path, {"poses": files}, unreadable):
        frames[number] = _bodies(file, content, completed)
        rate = re.fullmatch(r"[a-z]+_(\d+)(?:_(\d+))?", str(content.get("fpsType")))
        if rate:
            rates.setdefault(float(f"{rate[1]}.{rate[2] or 0}"), file)
    if len(rates) > 1:
        raise ValueError(f"{path}: expected one fpsType, found {' and '.join(f'{r} in {f}' for r, f in rates.items())}")
    ids = sorted({body for bodies in frames.values() for body in bodies})
    absent = np.full((len(PANOPTIC19), _VALUES), np.nan)
    rows = {
        number: np.array([bodies.get(body, absent) for body in ids]).reshape(-1, *absent.shape)
        for number, bodies in frames.items()
    }
    lost = unreadable.get("poses", [])
    notes = [f"{len(lost)} files of poses could not be read and are absent, first {lost[0]}"] if lost else []
    if ids != list(range(len(ids))):
        notes.append(f"persons 0 to {len(ids) - 1} of the truth are the bodies of ids {ids}")
    return rows, next(iter(rates), None), tuple(notes)


def _pose_folder(path: Path) -> Path:
    found = [folder for folder in (path, *sorted(path.glob("*Pose3d*coco19"))) if any(folder.glob(f"{_SCENE}*.json"))]
    if not found:
        raise FileNotFoundError(f"{path}: expected {POSES}/{_SCENE}<frame number>.json, found none")
    if len(found) > 1:
        raise ValueError(f"{path}: expected one folder of poses, found {', '.join(map(str, found))}; name one of them")
    return found[0]


def _bodies(file: Path, content, completed: bool) -> dict[int, np.ndarray]:
    """Return joints (19, 10) by body id: x, y, z, `Source`, and covariance as in the file; NaN where unknown."""
    found = {}
    for number, body in enumerate(listed(file, content, "bodies")):
        values = body if isinstance(body, dict) else {}
        name, place = values.get("id"), f"{file}: bodies[{number}]"
        if not isinstance(name, int) or name in found:
            raise ValueError(f"{place}.id: expected a number that no other body has, found {name!r:.60}")
        joints = _flat(values.get("joints19"), f"{place}.joints19", 4 * len(PANOPTIC19)).reshape(-1, 4)
        known = joints[:, 3] > 0
        source = np.full(len(PANOPTIC19), float(Source.MEASURED))
        if "joint_source" in values:
            source = _flat(values["joint_source"], f"{place}.joint_source", len(PANOPTIC19))
            if not np.isin(source, list(Source)).all():
                raise ValueError(
                    f"{place}.joint_source: expected {', '.join(f'{s:d} {s.name.lower()}' for s in Source)}"
                )
            known &= completed | (source != Source.COMPLETED)
        cov = np.full((len(PANOPTIC19), 6), np.nan)
        if "joint_covariance" in values:
            given, most = values["joint_covariance"], 1e4 * MOST_VARIANCE
            cov = _flat(given, f"{place}.joint_covariance", 6 * len(PANOPTIC19), most).reshape(-1, 6)
        found[name] = np.where(known[:, None], np.concatenate([joints[:, :3], source[:, None], cov], 1), np.nan)
    return found


def _flat(found, place: str, count: int, most: float = 100 * MOST_METRES) -> np.ndarray:
    array = numbers_of(found)
    if array.shape != (count,):
        raise ValueError(f"{place}: expected {count} numbers, found {found!r:.60}")
    check_numbers(place, array, most)
    return array


def write_poses(poses: Poses3D, fps: float, folder: Path, first: int = 0, every: int = 1) -> None:
    """Write `hdPose3d_stage1_coco19/body3DScene_<frame number>.json` into a recording's folder.

    Frames are numbered from `first`, and one in `every` is written.

    The confidence is `COMPLETED_SCORE` for completed joints, -1 for absent joints, which are at 0, 0, 0, and 1 for the
    others. Bodies also have `joint_source`, the `Source` of their joints. If covariances are known, bodies have
    `joint_covariance`: six numbers per joint, xx, xy, xz, yy, yz, zz, in cm^2 and the axes of the file; null where
    unknown. Raises ValueError if the poses have another skeleton than PANOPTIC19.
    """
    if poses.skeleton != PANOPTIC19:
        raise ValueError(f"expected poses of panoptic19, found {poses.skeleton.name}; convert them first")
    confidence = np.select(
        [poses.source == Source.ABSENT, poses.source == Source.COMPLETED], [-1.0, openpose.COMPLETED_SCORE], 1.0
    )
    joints = np.concatenate([np.nan_to_num(CONVENTION.written_points(poses.xyz)), confidence[..., None]], -1)
    joints = np.round(joints, 4)
    for frame in progress(range(0, len(joints), every), "writing poses"):
        bodies = [
            {"id": person, "joints19": joints[frame, person].ravel().tolist(), "joint_source": source.tolist()}
            | _covariances(poses.cov[frame, person])
            for person, source in enumerate(poses.source[frame])
            if (source != Source.ABSENT).any()
        ]
        content = {
            "version": 0.7,
            "univTime": round(1000 * (first + frame) / fps, 3),
            "fpsType": f"hd_{fps:g}".replace(".", "_"),
            "bodies": bodies,
        }
        write_atomic(Path(folder) / POSES / f"{_SCENE}{first + frame:08d}.json", json.dumps(content))


def _covariances(cov: np.ndarray) -> dict[str, list]:
    """Return the covariances (19, 3, 3) m^2 of a person as an entry of the file; empty if no covariance is known."""
    if np.isnan(cov).all():
        return {}
    turn = CONVENTION.written_points(np.eye(3))
    entries = (turn.T @ cov.astype(np.float64) @ turn)[:, _UPPER[0], _UPPER[1]]
    return {"joint_covariance": [None if np.isnan(value) else float(f"{value:.6g}") for value in entries.ravel()]}


@pose_writer("panoptic", folder=True, errors=True, skeleton="panoptic19")
def write_panoptic(poses: Poses3D, clip: Clip, path: Path) -> None:
    """A folder of CMU Panoptic's poses and calibration, always on its skeleton."""
    write_calibration(clip.rig, child(path, f"calibration_{clip.id}.json", "clip"), "panoptic")
    write_poses(poses, clip.fps, path, clip.provenance.get("first_frame", 0))
