"""MMPose and RTMPose: predictions, saved as one JSON or pickle file per camera.

A pickle can run any code when Python loads it. `dmae.files.pickles` reads pickles without running code.
"""

from pathlib import Path

import numpy as np

from dmae.data.skeleton import COCO17, Skeleton
from dmae.files.checks import MOST_PIXELS, check_numbers
from dmae.files.contents import read_bytes
from dmae.files.pickles import pickled_values
from dmae.files.structured import read_json
from dmae.formats.openpose import default_skeleton
from dmae.formats.recordings import Confidences, NumberedDetections, by_name, listed_frames
from dmae.formats.registry import reader

_PICKLES = (".pkl", ".pickle")
_FOLDERS = ("predictions", "")
_WHOLE_BODY = 133  # Number of points in COCO-WholeBody. Its first 17 points are the joints of COCO.


@reader("mmpose", signs=[["predictions/*.json"], ["predictions/*.pkl"], ["*.pkl"], ["*.pickle"]], cameras=False)
def read_detections(path: Path, *, skeleton: Skeleton | None = None) -> NumberedDetections:
    """Predictions of MMPose or RTMPose, <camera>.json or <camera>.pkl of all frames, with a calibration of any format.

    A file contains a list of frames. A frame is a list of people, or an object, which contains the people as
    `instances` or `predictions`, and can contain the number of the frame as `frame_id`. A person has `keypoints`: x and
    y in px, and the confidence of each joint, unless the confidences are in `keypoint_scores`.

    Args:
        path: Folder of the files, or one file.
        skeleton: By default the number of joints determines it.

    Raises:
        FileNotFoundError: there are no such files.
        ValueError: a file is malformed, a pickle would run code, or no known skeleton has the number of joints.
    """
    files = _files(Path(path))
    confidences, joints = Confidences(), None
    views: dict[str, dict[int, np.ndarray]] = {}
    for file in files:
        views[file.stem] = {}
        for number, place, people in listed_frames(file, _content(file), ("frame_id", "frame_index"), _people):
            found = [_person(f"{place}[{i}]", person, confidences) for i, person in enumerate(people)]
            for person in found:
                joints = joints or len(person)
                if len(person) != joints:
                    raise ValueError(f"{place}: expected people of {joints} joints as before, found {len(person)}")
            known = [person for person in found if np.isfinite(person).any()]
            views[file.stem][number] = np.array(known) if known else np.empty((0, joints or 0, 3))
    if joints is None:
        raise ValueError(f"{path}: expected people in some frame, found none in {', '.join(f.name for f in files)}")
    if skeleton is None:
        skeleton = default_skeleton(path, len(COCO17) if joints == _WHOLE_BODY else joints)
    elif joints < len(skeleton):
        raise ValueError(f"{path}: expected {len(skeleton)} joints as of {skeleton.name}, found {joints}")
    kept, notes = len(skeleton), confidences.notes
    cut = {
        name: {n: people[:, :kept] if len(people) else np.empty((0, kept, 3)) for n, people in view.items()}
        for name, view in views.items()
    }
    if kept < joints:
        notes += (f"of {joints} points of each person the first {kept} are read, those of {skeleton.name}",)
    return NumberedDetections(skeleton, cut, notes=notes)


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    for folder in _FOLDERS:
        for suffixes in ((".json",), _PICKLES):
            found = [
                file
                for file in by_name((path / folder).glob("*"))
                if file.suffix in suffixes and "calib" not in file.name.lower()
            ]
            if found:
                return found
    raise FileNotFoundError(
        f"{path}: expected predictions/<camera>.json or <camera>.pkl, found none; name their folder by "
        "data.detections=..."
    )


def _content(file: Path):
    """Return the frames of a file."""
    if file.suffix in _PICKLES:
        try:
            content = pickled_values(read_bytes(file))
        except ValueError as error:
            raise ValueError(f"{file}: {error}") from None
    else:
        content = read_json(file)
    for name in ("instance_info", "predictions", "frames"):
        if isinstance(content, dict) and name in content:
            content = content[name]
    if isinstance(content, dict):
        return [{"frame_id": key, "instances": people} for key, people in content.items()]
    return content


def _people(place: str, frame: object) -> list:
    """Return the people of a frame."""
    people = frame
    if isinstance(frame, dict):
        people = next((frame[name] for name in ("instances", "predictions", "people") if name in frame), None)
    # The result of MMPose's inferencer is a list of images, each of which is a list of people.
    if isinstance(people, list) and len(people) == 1 and isinstance(people[0], list):
        people = people[0]
    if not isinstance(people, list):
        raise ValueError(f"{place}: expected a list of people, or one as instances, found {frame!r:.60}")
    return people


def _person(place: str, person, confidences: Confidences) -> np.ndarray:
    """Return the joints of a person, (J, 3): x and y in px, confidence; NaN where absent."""
    values = person if isinstance(person, dict) else {}
    keypoints, scores = values.get("keypoints"), values.get("keypoint_scores")
    try:
        joints = np.array(keypoints, np.float64)
        joints = joints.reshape(-1, 3) if joints.ndim == 1 and joints.size % 3 == 0 else joints
        if scores is not None:
            joints = np.concatenate([joints[:, :2], np.array(scores, np.float64).reshape(-1, 1)], -1)
    except (TypeError, ValueError, OverflowError, IndexError):
        joints = np.empty(0)
    if joints.ndim != 2 or joints.shape[-1] != 3 or not len(joints):
        raise ValueError(
            f"{place}: expected keypoints, x, y and confidence of each joint, or keypoint_scores, found {person!r:.60}"
        )
    check_numbers(f"{place}.keypoints", joints, MOST_PIXELS)
    return confidences.clean(f"{place}.keypoints", joints)
