"""The `.npy` dictionaries of the paper's released code: cameras, detections and truth of Shelf.

They are pickles, which can run any code when loaded. `dmae.files.pickles` reads them without running code.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.skeleton import BODY21, BODY25, SHELF14
from dmae.files.arrays import read_npy
from dmae.files.checks import MOST_METRES, MOST_PIXELS, check_numbers
from dmae.formats.calibrations import CameraTable, ParsedCamera, make_rig
from dmae.formats.recordings import NumberedDetections, People, frame_number, natural, to_clip
from dmae.formats.registry import reader

CAMERAS, DETECTIONS, TRUTH = "camera_params.npy", "*2d_detection_dict.npy", "*3d_eval*.npy"
FPS = 25.0


@reader("released", signs=[["camera_params.npy"]])
def read_released(path: Path, *, fps: float | None = None) -> Clip:
    """The dictionaries of the paper's code: camera_params.npy, *2d_detection_dict.npy, maybe *3d_eval*.npy.

    Detections have the skeleton BODY_25, or the 21 joints of the paper if the file contains only those. The truth has
    the skeleton SHELF14, with NaN where an actor is not annotated.

    Args:
        fps: Frames per second; by default 25, the rate of the Shelf recording.

    Raises:
        FileNotFoundError: cameras or detections are missing.
        ValueError: a file is malformed, or its pickle would run code.
    """
    rig = read_cameras(path / CAMERAS)
    file = _one(path, DETECTIONS)
    if file is None:
        raise FileNotFoundError(f"{path}: expected {DETECTIONS}, found none")
    found, truth = _detections(file, rig), _one(path, TRUTH)
    annotated = None if truth is None else _truth(truth, sorted(next(iter(found.views.values()))))
    return to_clip(replace(found, truth=annotated, truth_skeleton=SHELF14), rig, fps or FPS, path)


def _one(folder: Path, pattern: str) -> Path | None:
    found = sorted(folder.glob(pattern))
    if len(found) > 1:
        raise ValueError(f"{folder}: expected one {pattern}, found {', '.join(file.name for file in found)}")
    return found[0] if found else None


def read_cameras(path: Path) -> CameraRig:
    """Return the cameras in `camera_params.npy`: cam_from_world, m; errors as in `read_npy`."""
    cameras = read_npy(path)
    if not isinstance(cameras, list):
        raise ValueError(f"{path}: expected a list of cameras, found {cameras!r:.60}")
    return make_rig(path, (_camera(CameraTable(path, str(n), values)) for n, values in enumerate(cameras)), None)


def _camera(entry: CameraTable) -> ParsedCamera:
    name = str(entry.values.get("id", entry.camera))
    return ParsedCamera(
        name,
        entry.numbers("K", 9).reshape(3, 3),
        np.zeros(5),
        entry.numbers("R", 9).reshape(3, 3),
        entry.numbers("T", 3),
        entry.size("res"),
    )


def _detections(path: Path, rig: CameraRig) -> NumberedDetections:
    content = read_npy(path)
    if not isinstance(content, dict) or not content or not all(isinstance(view, dict) for view in content.values()):
        raise ValueError(f"{path}: expected detections by view and frame, found {content!r:.60}")
    # Coordinates are fractions of the image. The released code assumes the same image size for all cameras.
    scale = np.array([*(rig.size[0] - 1), 1.0])
    names = sorted(map(str, content), key=natural)
    people = People(names)
    for name in names:
        for frame, listed in content.get(name, {}).items():
            place, number = f"{path}: {name}, {frame}", frame_number(path, str(frame))
            if not isinstance(listed, list | tuple):
                raise ValueError(f"{place}: expected a list of people, found {listed!r:.60}")
            people.frame(name, number)
            for person in listed:
                people.add(name, number, place, _person(place, person) * scale)
    return people.detections(BODY21 if people.joints == len(BODY21) else BODY25)


def _person(place: str, person) -> np.ndarray:
    values = person if isinstance(person, dict) else {}
    joints = np.asarray(values.get("meta", values.get("filtered_skel")))
    if joints.shape not in ((len(BODY25), 3), (len(BODY21), 3)) or joints.dtype.kind != "f":
        raise ValueError(f"{place}: expected `meta` or `filtered_skel` of 25 or 21 x 3 numbers, found {person!r:.60}")
    check_numbers(f"{place}: fractions of the image", joints, MOST_PIXELS)
    return joints.astype(np.float64)


def _truth(path: Path, numbers: list[int]) -> dict[int, np.ndarray]:
    content = read_npy(path)
    frames = list(content) if isinstance(content, list | np.ndarray) else []
    if len(frames) != len(numbers):
        raise ValueError(f"{path}: expected {len(numbers)} frames as in the detections, found {len(frames)}")
    truth = {}
    for number, actors in zip(numbers, frames, strict=True):
        if not isinstance(actors, list | tuple | np.ndarray):
            raise ValueError(f"{path}: frame {number}: expected a list of actors, found {actors!r:.60}")
        truth[number] = np.full((len(actors), len(SHELF14), 3), np.nan)
        for actor, joints in enumerate(actors):
            place = f"{path}: frame {number}, actor {actor}"
            # The 15th joint is the mean of the hips.
            truth[number][actor] = _actor(place, joints)[: len(SHELF14)]
    return truth


def _actor(place: str, joints) -> np.ndarray:
    """Return joints (14 or 15, 3) m; all NaN if the actor is not annotated."""
    try:
        found = np.asarray(joints, np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
        joints = joints or "nothing"
    if found.size == 0 and not isinstance(joints, str):
        return np.full((len(SHELF14), 3), np.nan)
    if found.shape not in ((len(SHELF14), 3), (len(SHELF14) + 1, 3)):
        raise ValueError(f"{place}: expected {len(SHELF14)} or {len(SHELF14) + 1} x 3 numbers, found {joints!r:.60}")
    check_numbers(f"{place}: joints, m", found, MOST_METRES)
    return found
