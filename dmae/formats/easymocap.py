"""EasyMocap's detections: one JSON file per view and frame."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import BODY25, Skeleton
from dmae.data.store import write_atomic
from dmae.files.names import child
from dmae.files.numbers import MOST_PIXELS, check_numbers
from dmae.files.structured import read_json
from dmae.formats.calibrations.files import FOUND, CalibrationSource, write_calibration
from dmae.formats.openpose import OF_25_JOINTS
from dmae.formats.recordings.camera_matching import frame_number, natural
from dmae.formats.recordings.confidences import Confidences
from dmae.formats.recordings.numbered_detections import NumberedDetections, with_cameras
from dmae.formats.recordings.skeleton_guess import guess_skeleton
from dmae.formats.registry import reader, recording_writer
from dmae.progress import progress

ANNOTATIONS = "annots"


@reader("easymocap", signs=[["intri.yml"], ["annots"]])
def read_easymocap(
    path: Path,
    *,
    calibration: CalibrationSource = FOUND,
    detections: Path | None = None,
    fps: float | None = None,
    skeleton: Skeleton | None = None,
) -> Clip:
    """An EasyMocap sequence: intri.yml, extri.yml, annots/<camera>/<frame number>.json.

    Args:
        path: The recording.
        calibration: Path of the calibration, and the values that its file does not state.
        detections: Folder that contains the folders of the cameras; by default `annots` in `path`.
        fps: Frames per second. The files do not state it.
        skeleton: Skeleton of the detections; by default BODY_25 or BODY_25B.

    Raises:
        FileNotFoundError, ValueError: as `read_detections` and `with_cameras`.
    """
    try:
        found = read_detections(detections or path, skeleton or BODY25)
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{error}; name it by data.detections=...") from None
    if skeleton is None:
        people = (frame for view in found.views.values() for frame in view.values())
        recognised, notes = guess_skeleton(path, OF_25_JOINTS, people)
        found = replace(found, skeleton=recognised, notes=(*found.notes, *notes))
    return with_cameras(found, path, calibration, fps)


def read_detections(path: Path, skeleton: Skeleton = BODY25) -> NumberedDetections:
    """Read `annots/<camera>/<frame number>.json`.

    A joint with confidence 0 is absent. If a file is not valid JSON, for example because it is cut short, its frame is
    absent and the file is listed in `unreadable`. EasyMocap's person ids, which are only valid within a view, are not
    read.

    Args:
        path: The recording, its folder `annots`, or another folder that contains the folders of the cameras.

    Raises:
        FileNotFoundError: there are no such files.
        ValueError: a file is JSON but not EasyMocap's, a person has a different number of joints than the skeleton,
            images of a camera differ in size, a frame occurs twice, or no file could be read.
    """
    folders = _camera_folders(Path(path))
    views: dict[str, dict[int, np.ndarray]] = {name: {} for name in folders}
    unreadable: dict[str, list[str]] = {}
    sizes: dict[str, tuple[int, int]] = {}
    confidences = Confidences()
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
        size, views[name][number] = _size(file, content), _people(file, content, skeleton, confidences)
        if size and sizes.setdefault(name, size) != size:
            raise ValueError(f"{file}: expected images of {sizes[name]} px as before of camera {name!r}, found {size}")
    if not any(views.values()):
        raise ValueError(f"{path}: not one file could be read; {next(iter(unreadable.values()))[0]}")
    return NumberedDetections(skeleton, views, unreadable=unreadable, sizes=sizes, notes=confidences.notes)


def _camera_folders(path: Path) -> dict[str, Path]:
    places = [path / ANNOTATIONS, path]
    for place in places:
        folders = [file.parent for file in place.glob("*/*.json")]
        if folders:
            return {folder.name: folder for folder in sorted(set(folders), key=lambda folder: natural(folder.name))}
    raise FileNotFoundError(f"{path}: expected {ANNOTATIONS}/<camera>/<frame number>.json, found none")


def _size(file: Path, content) -> tuple[int, int] | None:
    """Return image width and height, px; None if the file does not state them."""
    if not isinstance(content, dict) or "width" not in content or "height" not in content:
        return None
    size = content["width"], content["height"]
    if not all(isinstance(length, int) and length > 0 for length in size):
        raise ValueError(f"{file}: expected positive whole width and height, found {size}")
    return size


def _people(file: Path, content, skeleton: Skeleton, confidences: Confidences) -> np.ndarray:
    """Return the people with at least one joint, (D, J, 3): x, y in px and confidence."""
    people = content.get("annots") if isinstance(content, dict) else None
    if not isinstance(people, list):
        raise ValueError(f"{file}: expected an object with a list of annots, found {content!r:.60}")
    found = np.empty((len(people), len(skeleton), 3))
    for number, person in enumerate(people):
        keypoints = person.get("keypoints") if isinstance(person, dict) else None
        try:
            array = np.array(keypoints, np.float64)
        except (TypeError, ValueError, OverflowError):
            array = np.empty(0)
        if array.shape != found.shape[1:]:
            shape = f", of shape {array.shape}" if array.size else ""
            raise ValueError(
                f"{file}: annots[{number}].keypoints: expected x, y, confidence of the {len(skeleton)} joints of "
                f"{skeleton.name}, found {keypoints!r:.60}{shape}; data.skeleton=... names another skeleton"
            )
        check_numbers(f"{file}: annots[{number}].keypoints", array, MOST_PIXELS)
        found[number] = confidences.clean(f"{file}: annots[{number}].keypoints", array)
    return found[~np.isnan(found).all((1, 2))]


def write_detections(detections: Detections2D, rig: CameraRig, folder: Path, first: int = 0) -> None:
    """Write `annots/<camera>/<frame number>.json` into the folder of a recording, to 0.001 px.

    Args:
        first: Number of the first frame.
    """
    values = np.concatenate([detections.xy.astype(np.float64), detections.score[..., None]], -1)
    boxes = np.concatenate([np.fmin.reduce(values[..., :2], -2), np.fmax.reduce(values[..., :2], -2)], -1)
    seen = detections.observed.any(-1)
    folders = [child(Path(folder) / ANNOTATIONS, name, "camera") for name in rig.names]
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
            write_atomic(folders[view] / f"{first + frame:06d}.json", json.dumps(content))


@recording_writer("easymocap", lacks=["fps", "skeleton"])
def write_easymocap(clip: Clip, path: Path) -> None:
    """EasyMocap's calibration and detections."""
    write_calibration(clip.rig, path, "easymocap")
    write_detections(clip.detections, clip.rig, path, clip.provenance.get("first_frame", 0))
