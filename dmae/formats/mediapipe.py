"""MediaPipe: pose landmarks, saved as one JSON file per camera."""

from pathlib import Path

import numpy as np

from dmae.data.skeleton import BLAZEPOSE33, Skeleton
from dmae.files.checks import MOST_SCORE, check_numbers
from dmae.files.structured import read_json
from dmae.formats.calibrations import FOUND, CalibrationSource
from dmae.formats.recordings import NumberedDetections, People, camera_files, listed_frames, match_cameras
from dmae.formats.registry import reader

_FOLDER = "mediapipe"
_LANDMARKS = ("landmarks", "poseLandmarks", "pose_landmarks", "landmark")
_NUMBERS = ("frame", "frame_id", "frame_index")
_MOST_IMAGE_SIZES = 100.0
"""Largest absolute x and y of a landmark, as a multiple of the image size: landmarks can be outside the image."""


@reader("mediapipe", signs=[["mediapipe/*.json"]], cameras=False)
def read_mediapipe(
    path: Path,
    *,
    calibration: CalibrationSource = FOUND,
    detections: Path | None = None,
    skeleton: Skeleton | None = None,
) -> NumberedDetections:
    """Pose landmarks of MediaPipe, mediapipe/<camera>.json of all frames, with a calibration of any format.

    A file is a list of frames, each with its people. It does not state the frame rate. A frame is null, a person, a
    list of people, or an object, which contains the people as `landmarks`, `poseLandmarks` or `pose_landmarks`, and can
    contain the number of the frame as `frame`. A person is a list of 33 landmarks. A landmark has x and y, from 0 to 1
    across the image of its camera, and `visibility`, by default 1.

    Args:
        detections: Folder of the files, or one file.
        skeleton: Only the 33 landmarks, `blazepose33`, are possible.

    Raises:
        FileNotFoundError: there are no such files.
        ValueError: a file is malformed or named after no camera, or another skeleton is wanted.
    """
    if skeleton not in (None, BLAZEPOSE33):
        raise ValueError(f"{path}: MediaPipe's landmarks are {BLAZEPOSE33.name}, not {skeleton.name}")
    rig, folder = calibration.read(path), Path(detections or path / _FOLDER)
    files = camera_files(folder, "*.json")
    index, _ = match_cameras([file.stem for file in files], rig, folder)
    people = People((file.stem for file in files), BLAZEPOSE33)
    for file, view in zip(files, index, strict=True):
        content = read_json(file)
        content = content["frames"] if isinstance(content, dict) and "frames" in content else content
        for number, place, found in listed_frames(file, content, _NUMBERS, _people):
            people.frame(file.stem, number)
            for person in found:
                people.add(file.stem, number, place, _person(place, person, rig.size[view]))
    return people.detections(BLAZEPOSE33, rig=rig)


def _inner(found: object) -> object:
    """Return the landmarks from up to three nested objects; None if there are none."""
    for _ in range(3):
        if isinstance(found, dict) and not {"x", "y"} <= set(found):
            found = next((found[name] for name in _LANDMARKS if name in found), None)
    return found


def _people(_: str, frame: object) -> list:
    """Return the people of a frame, which is a list of people or only one person."""
    found = _inner(frame)
    if not found:
        return []
    if isinstance(found, list) and isinstance(_inner(found[0]), list):
        return [_inner(person) for person in found if person]
    return [found]


def _person(place: str, person: object, size: np.ndarray) -> np.ndarray:
    """Return the landmarks of a person, (33, 3): x and y in px, confidence."""
    count = len(BLAZEPOSE33)
    if not isinstance(person, list) or len(person) != count:
        what = f"{len(person)} of them" if isinstance(person, list) else f"{person!r:.40}"
        raise ValueError(f"{place}: expected {count} landmarks of each person, found {what}")
    try:
        rows = np.array([[each["x"], each["y"], each.get("visibility", 1.0)] for each in person], np.float64)
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        raise ValueError(f"{place}: expected landmarks with x, y and visibility, found {person[0]!r:.60}") from None
    check_numbers(f"{place}: x and y, shares of the image", rows[:, :2], _MOST_IMAGE_SIZES)
    check_numbers(f"{place}: visibility", rows[:, 2], MOST_SCORE)
    # In our convention, 0 is the centre of the first pixel.
    rows[:, :2] = rows[:, :2] * size - 0.5
    return rows
