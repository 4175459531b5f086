"""EasyMocap: a JSON file of detections per view and frame; `intri.yml` and `extri.yml` in OpenCV's YAML dialect."""

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.skeleton import BODY25, Skeleton
from dmae.files.checks import child
from dmae.files.contents import write_atomic
from dmae.formats.calibrations import (
    CameraTable,
    ParsedCamera,
    calibration_format,
    make_rig,
    orthonormal,
    require,
    write_calibration,
)
from dmae.formats.opencv import read_storage
from dmae.formats.recordings import NumberedDetections, People, by_name, json_frames, listed
from dmae.formats.registry import reader, recording_writer
from dmae.formats.skeletons import guess_skeleton
from dmae.progress import progress

INTRINSICS, EXTRINSICS = "intri.yml", "extri.yml"
# EasyMocap writes six decimals; its earlier versions wrote three.
_ROTATION_TOLERANCE = 2e-3


def _read_storage(path: Path) -> dict:
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; EasyMocap keeps {INTRINSICS} and {EXTRINSICS} side by side")
    return read_storage(path)


def _camera(folder: Path, name: str, intrinsics: dict, extrinsics: dict) -> ParsedCamera:
    inner = CameraTable(folder / INTRINSICS, name, intrinsics)
    outer = CameraTable(folder / EXTRINSICS, name, extrinsics)
    K, R, rotation, distortion = (f"{key}_{name}" for key in ("K", "R", "Rot", "dist"))
    if distortion not in intrinsics and f"D_{name}" in intrinsics:
        distortion = f"D_{name}"
    turned = outer.rodrigues(R) if R in extrinsics or rotation not in extrinsics else outer.rotation(rotation)
    if R in extrinsics and rotation in extrinsics:
        apart = np.abs(outer.numbers(rotation, 9).reshape(3, 3) - turned).max()
        if apart > _ROTATION_TOLERANCE:
            raise outer.error(
                rotation, f"to be the matrix of {R}, which is its Rodrigues vector", f"one that is off by {apart:.1e}"
            )
    height, width, size = f"H_{name}", f"W_{name}", None
    if height in intrinsics or width in intrinsics:
        size = inner.size(width, height)
    return ParsedCamera(
        name, inner.intrinsics(K), inner.numbers(distortion, 4, 5, 8), turned, outer.numbers(f"T_{name}", 3), size
    )


def write_cameras(rig: CameraRig, path: Path) -> None:
    """Write `intri.yml` and `extri.yml`, with exact rotations; YAML libraries lack OpenCV's header and matrices."""
    require("an EasyMocap calibration", rig, coefficients=8)
    R, t = orthonormal(rig)
    intrinsics, extrinsics = [_names(rig)], [_names(rig)]
    for view, name in enumerate(rig.names):
        if not (name.isascii() and name.replace("_", "").replace("-", "").isalnum()):
            raise ValueError(f"camera {name!r}: an EasyMocap calibration takes names of letters, digits, - and _")
        width, height = rig.size[view]
        intrinsics += [
            _matrix(f"K_{name}", rig.K[view]),
            _matrix(f"dist_{name}", rig.dist[view, None, : 8 if rig.dist[view, 5:].any() else 5]),
            f"H_{name}: {height}",
            f"W_{name}: {width}",
        ]
        extrinsics += [
            _matrix(f"R_{name}", Rotation.from_matrix(R[view]).as_rotvec()[:, None]),
            _matrix(f"Rot_{name}", R[view]),
            _matrix(f"T_{name}", t[view][:, None]),
        ]
    for file, lines in ((INTRINSICS, intrinsics), (EXTRINSICS, extrinsics)):
        write_atomic(Path(path) / file, "\n".join(["%YAML:1.0", "---", *lines, ""]))


def _names(rig: CameraRig) -> str:
    return "\n".join(["names:", *(f'   - "{name}"' for name in rig.names)])


def _matrix(key: str, values: np.ndarray) -> str:
    rows, columns = values.shape
    data = ", ".join(map(repr, map(float, values.ravel())))
    return f"{key}: !!opencv-matrix\n   rows: {rows}\n   cols: {columns}\n   dt: d\n   data: [ {data} ]"


def _is_easymocap(keys: list[str]) -> bool:
    return any(key == "names" or key.startswith(("K_", "R_", "T_")) for key in keys)


@calibration_format(
    "easymocap", syntax="yaml", matches=_is_easymocap, write=write_cameras, files=(INTRINSICS, f"*/{INTRINSICS}")
)
def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """intri.yml and extri.yml (EasyMocap).

    Return the cameras that `extri.yml` names: cam_from_world, in the unit of the files. `path` is one of the two files
    or their folder; `size` is width and height, px, if the files do not state them.
    """
    folder = path if path.is_dir() else path.parent
    intrinsics, extrinsics = (_read_storage(folder / name) for name in (INTRINSICS, EXTRINSICS))
    # `intri.yml` often contains more cameras than the recording.
    names = extrinsics.get("names", intrinsics.get("names"))
    if not isinstance(names, list):
        raise ValueError(f"{folder / EXTRINSICS}: expected names to be a list of cameras, found {names!r:.60}")
    return make_rig(folder, (_camera(folder, str(name), intrinsics, extrinsics) for name in names), size)


ANNOTATIONS = "annots"


@reader("easymocap", signs=[["annots"]], cameras=False)
def read_detections(path: Path, *, skeleton: Skeleton | None = None) -> NumberedDetections:
    """An EasyMocap sequence: intri.yml, extri.yml, annots/<camera>/<frame number>.json.

    A joint with confidence 0 or at 0, 0 is absent. If a file is not valid JSON, for example because it is cut short,
    its frame is absent and the file is listed in `unreadable`. EasyMocap's person ids, which are only valid within a
    view, are not read.

    Args:
        path: The recording, its folder `annots`, or another folder that contains the folders of the cameras.
        skeleton: By default BODY_25 or BODY_25B; `guess_skeleton` chooses between them.

    Raises:
        FileNotFoundError: there are no such files.
        ValueError: a file is JSON but not EasyMocap's, a person has another number of joints, images of a camera differ
            in size, a frame occurs twice, or no file could be read.
    """
    folders = _camera_folders(Path(path))
    files = {name: sorted(folder.glob("*.json")) for name, folder in folders.items()}
    people = People(files, skeleton or BODY25)
    notes: tuple[str, ...] = ()
    for name, number, file, content in json_frames(path, files, people.unreadable):
        people.frame(name, number)
        for i, person in enumerate(listed(file, content, "annots")):
            keypoints = person.get("keypoints") if isinstance(person, dict) else None
            people.add(name, number, f"{file}: annots[{i}].keypoints", keypoints)
        people.image(name, str(file), content)
    if skeleton is None:
        skeleton, notes = guess_skeleton(path, people.all())
    return people.detections(skeleton, notes)


def _camera_folders(path: Path) -> dict[str, Path]:
    places = [path / ANNOTATIONS, path]
    for place in places:
        folders = [file.parent for file in place.glob("*/*.json")]
        if folders:
            return {folder.name: folder for folder in by_name(set(folders))}
    raise FileNotFoundError(
        f"{path}: expected {ANNOTATIONS}/<camera>/<frame number>.json, found none; name it by data.detections=..."
    )


@recording_writer("easymocap", lacks=["fps", "skeleton"])
def write_easymocap(clip: Clip, path: Path) -> None:
    """EasyMocap's calibration and detections.

    Write `annots/<camera>/<frame number>.json` into a recording's folder, to 0.001 px.
    """
    write_calibration(clip.rig, path, "easymocap")
    found, first = clip.detections, clip.provenance.get("first_frame", 0)
    values = np.concatenate([found.xy.astype(np.float64), found.score[..., None]], -1)
    boxes = np.concatenate([np.fmin.reduce(values[..., :2], -2), np.fmax.reduce(values[..., :2], -2)], -1)
    seen = np.any(found.observed, -1)
    folders = [child(Path(path) / ANNOTATIONS, name, "camera") for name in clip.rig.names]
    values, boxes = np.round(np.nan_to_num(values), 4), np.round(boxes, 4)
    for frame, views in enumerate(progress(values, "writing detections", len(values))):
        for view, name in enumerate(clip.rig.names):
            people = [
                {
                    "personID": int(number),
                    "bbox": [*boxes[frame, view, number].tolist(), 1.0],
                    "keypoints": views[view, number].tolist(),
                    "isKeyframe": False,
                }
                for number in np.flatnonzero(seen[frame, view])
            ]
            width, height = clip.rig.size[view].tolist()
            image = f"images/{name}/{first + frame:06d}.jpg"
            content = {"filename": image, "height": height, "width": width, "annots": people, "isKeyframe": False}
            write_atomic(folders[view] / f"{first + frame:06d}.json", json.dumps(content))
