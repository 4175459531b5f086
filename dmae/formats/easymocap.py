"""EasyMocap: `intri.yml` and `extri.yml` of OpenCV's FileStorage, and detections, a JSON a view and frame."""

import json
import re
from pathlib import Path

import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from dmae.cameras import CameraRig
from dmae.clip import Detections2D
from dmae.conventions import Convention
from dmae.formats.cameras import Camera, Entry, make_rig, orthonormal, require
from dmae.formats.recording import Recording, frame_number, natural
from dmae.progress import progress
from dmae.skeleton import BODY25, Skeleton
from dmae.store import read_json, write_atomic

CONVENTION = Convention()
INTRINSICS, EXTRINSICS, ANNOTATIONS = "intri.yml", "extri.yml", "annots"
# EasyMocap itself writes six decimals, earlier versions of it three.
_AGREE = 2e-3


def read_cameras(path: Path, size: tuple[int, int] | None = None) -> CameraRig:
    """Cameras as a pair of files writes them: world to camera; those that `extri.yml` names.

    Args:
        path: One of `intri.yml` and `extri.yml`, or the folder of both.

    Raises:
        FileNotFoundError: one of the files is missing.
        ValueError: they are malformed or contradict each other; the message names camera and key.
    """
    folder = path if path.is_dir() else path.parent
    intrinsics, extrinsics = (_read_storage(folder / name) for name in (INTRINSICS, EXTRINSICS))
    # Intrinsics are often kept of more cameras than a recording was made with.
    names = extrinsics.get("names", intrinsics.get("names"))
    if not isinstance(names, list):
        raise ValueError(f"{folder / EXTRINSICS}: expected names to be a list of cameras, found {names!r:.60}")
    return make_rig(folder, (_camera(folder, str(name), intrinsics, extrinsics) for name in names), size)


def _read_storage(path: Path) -> dict:
    """What an OpenCV FileStorage holds at its top: matrices as arrays, lists of texts, numbers.

    OpenCV's own reader corrupts memory on files that are cut short.
    """
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such file; EasyMocap keeps {INTRINSICS} and {EXTRINSICS} side by side")
    try:
        # YAML proper has no colon in this line, and takes `01` for a number, which a camera's name is not.
        text = re.sub(r"^\s*%YAML.*", "", path.read_text())
        content = yaml.load(text, yaml.BaseLoader)
    except (yaml.YAMLError, UnicodeDecodeError, RecursionError) as error:
        raise ValueError(f"{path}: expected YAML of OpenCV's FileStorage, {' '.join(str(error).split())}") from None
    if not isinstance(content, dict):
        raise ValueError(f"{path}: expected K_<camera>, T_<camera>, ... of OpenCV's FileStorage, found {content!r:.60}")
    keys = re.findall(r"^([^\s:#-][^\s:]*):", text, re.MULTILINE)
    if len(keys) > len(content):
        twice = next(key for key in keys if keys.count(key) > 1)
        raise ValueError(f"{path}: expected every key once, found {twice} {keys.count(twice)} times")
    return {key: _value(path, key, value) for key, value in content.items()}


def _value(path: Path, key: str, value):
    if not isinstance(value, dict):
        return _number(value)
    try:
        data = np.array(value["data"], np.float64)
        if data.ndim == 1 and data.size == int(value["rows"]) * int(value["cols"]):
            return data
    except (KeyError, ValueError, TypeError):
        pass
    raise ValueError(
        f"{path}: expected {key} to be a matrix of rows, cols and as many numbers of data, found {value!r:.90}"
    )


def _number(text):
    try:
        return float(text)
    except (TypeError, ValueError):
        return text


def _camera(folder: Path, name: str, intrinsics: dict, extrinsics: dict) -> Camera:
    inner, outer = Entry(folder / INTRINSICS, name, intrinsics), Entry(folder / EXTRINSICS, name, extrinsics)
    K, R, rotation, distortion = (f"{key}_{name}" for key in ("K", "R", "Rot", "dist"))
    if distortion not in intrinsics and f"D_{name}" in intrinsics:
        distortion = f"D_{name}"
    turned = outer.rodrigues(R) if R in extrinsics or rotation not in extrinsics else outer.rotation(rotation)
    if R in extrinsics and rotation in extrinsics:
        apart = np.abs(outer.numbers(rotation, 9).reshape(3, 3) - turned).max()
        if apart > _AGREE:
            raise outer.error(
                rotation, f"to be the matrix of {R}, which is its Rodrigues vector", f"one that is off by {apart:.1e}"
            )
    height, width, size = f"H_{name}", f"W_{name}", None
    if height in intrinsics or width in intrinsics:
        size = inner.size(width, height)
    return Camera(
        name,
        inner.intrinsics(K),
        inner.numbers(distortion, 4, 5, 8),
        turned,
        outer.numbers(f"T_{name}", 3),
        size,
    )


def write_cameras(rig: CameraRig, path: Path) -> None:
    """Write `intri.yml` and `extri.yml` into a folder; rounded rotations become exact.

    Raises:
        ValueError: a lens or a camera name that the format cannot hold.
    """
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


def read_detections(path: Path, skeleton: Skeleton = BODY25) -> Recording:
    """Read `annots/<camera>/<frame number>.json`.

    A joint of confidence 0 is absent. A file that is not JSON, cut short for instance, makes its frame absent and
    is recorded. Person ids, which EasyMocap gives within a view, are not read.

    Args:
        path: The recording, its `annots`, or another folder of cameras.

    Raises:
        FileNotFoundError: there are no such files.
        ValueError: a file is JSON but not EasyMocap's, people have not the skeleton's number of joints, images
            of a camera differ in size, a frame is there twice, or no file could be read.
    """
    folders = _camera_folders(Path(path))
    views: dict[str, dict[int, np.ndarray]] = {name: {} for name in folders}
    unreadable: dict[str, list[str]] = {}
    sizes: dict[str, tuple[int, int]] = {}
    todo = [(name, file) for name, folder in folders.items() for file in sorted(folder.glob("*.json"))]
    for name, file in progress(todo, "reading detections"):
        number = frame_number(file, file.stem)
        if number in views[name]:
            raise ValueError(f"{file}: expected frame {number} of camera {name!r} once, found it twice")
        try:
            content = read_json(file)
        except ValueError as error:
            unreadable.setdefault(name, []).append(str(error))
            continue
        size, views[name][number] = _size(file, content), _people(file, content, skeleton)
        if size and sizes.setdefault(name, size) != size:
            raise ValueError(f"{file}: expected images of {sizes[name]} px as before of camera {name!r}, found {size}")
    if not any(views.values()):
        raise ValueError(f"{path}: not one file could be read; {next(iter(unreadable.values()))[0]}")
    return Recording(skeleton, views, unreadable=unreadable, sizes=sizes)


def _camera_folders(path: Path) -> dict[str, Path]:
    places = [path / ANNOTATIONS, path]
    for place in places:
        folders = [file.parent for file in place.glob("*/*.json")]
        if folders:
            return {folder.name: folder for folder in sorted(set(folders), key=lambda folder: natural(folder.name))}
    raise FileNotFoundError(f"{path}: expected {ANNOTATIONS}/<camera>/<frame number>.json, found none")


def _size(file: Path, content) -> tuple[int, int] | None:
    """Image width and height, px, where a file of detections says."""
    if not isinstance(content, dict) or "width" not in content or "height" not in content:
        return None
    size = content["width"], content["height"]
    if not all(isinstance(length, int) and length > 0 for length in size):
        raise ValueError(f"{file}: expected positive whole width and height, found {size}")
    return size


def _people(file: Path, content, skeleton: Skeleton) -> np.ndarray:
    """(D, J, 3)."""
    people = content.get("annots") if isinstance(content, dict) else None
    if not isinstance(people, list):
        raise ValueError(f"{file}: expected an object with a list of annots, found {content!r:.60}")
    found = np.empty((len(people), len(skeleton), 3))
    for number, person in enumerate(people):
        keypoints = person.get("keypoints") if isinstance(person, dict) else None
        try:
            array = np.array(keypoints, np.float64)
        except (TypeError, ValueError):
            array = np.empty(0)
        if array.shape != found.shape[1:]:
            shape = f", of shape {array.shape}" if array.size else ""
            raise ValueError(
                f"{file}: annots[{number}].keypoints: expected x, y, confidence of the {len(skeleton)} joints of "
                f"{skeleton.name}, found {keypoints!r:.60}{shape}; data.skeleton=... names another skeleton"
            )
        found[number] = array
    found[~(found[..., 2] > 0)] = np.nan
    return found[~np.isnan(found).all((1, 2))]


def write_detections(detections: Detections2D, rig: CameraRig, folder: Path, first: int = 0) -> None:
    """Write `annots/<camera>/<frame number>.json` into the folder of a recording, to 0.001 px.

    Args:
        first: Number of the first frame.
    """
    values = np.concatenate([detections.xy.astype(np.float64), detections.score[..., None]], -1)
    boxes = np.concatenate([np.fmin.reduce(values[..., :2], -2), np.fmax.reduce(values[..., :2], -2)], -1)
    seen = detections.observed.any(-1)
    values, boxes = np.round(np.nan_to_num(values), 4), np.round(boxes, 4)
    for frame, views in enumerate(progress(values, "writing detections", len(values))):
        for view, name in enumerate(rig.names):
            people = [
                {
                    "personID": int(number),
                    "bbox": [*boxes[frame, view, number].tolist(), 1.0],
                    "keypoints": views[view, number].tolist(),
                    "isKeyframe": False,
                }
                for number in np.flatnonzero(seen[frame, view])
            ]
            width, height = rig.size[view].tolist()
            image = f"images/{name}/{first + frame:06d}.jpg"
            content = {"filename": image, "height": height, "width": width, "annots": people, "isKeyframe": False}
            write_atomic(Path(folder) / ANNOTATIONS / name / f"{first + frame:06d}.json", json.dumps(content))
