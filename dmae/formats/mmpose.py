"""MMPose and RTMPose: predictions, saved as one JSON or pickle file per camera.

A pickle can run any code when Python loads it. `dmae.files.pickles` reads pickles without running code.
"""

from pathlib import Path

from dmae.data.skeleton import Skeleton
from dmae.files.contents import read_bytes
from dmae.files.pickles import pickled_values
from dmae.files.structured import read_json
from dmae.formats import openpose
from dmae.formats.recordings import NumberedDetections, People, by_name, listed_frames, people_of_frame
from dmae.formats.registry import reader
from dmae.formats.skeletons import default_skeleton
from dmae.progress import progress

_PICKLES = (".pkl", ".pickle")
_FOLDERS = ("predictions", "")


@reader("mmpose", signs=[["predictions/*.json"], ["predictions/*.pkl"], ["*.pkl"], ["*.pickle"]], cameras=False)
def read_detections(path: Path, *, skeleton: Skeleton | None = None) -> NumberedDetections:
    """Predictions of MMPose or RTMPose, <camera>.json or <camera>.pkl, or <camera>/<frame>.json, and a calibration.

    The calibration is of any format. A file contains a list of frames or, in the folder of a camera, one frame. A frame
    is a list of people, or an object, which contains the people as `instances` or `predictions`, and can contain the
    number of the frame as `frame_id`. A person has `keypoints`: x and y in px, and the confidence of each joint, unless
    the confidences are in `keypoint_scores`.

    Args:
        path: Folder of the files, or one file.
        skeleton: By default the number of joints determines it.

    Raises:
        FileNotFoundError: there are no such files.
        ValueError: a file is malformed, a pickle would run code, or no known skeleton has the number of joints.
    """
    files = _files(Path(path))
    if not files:
        return openpose.read_detections(path, skeleton=skeleton)
    people = People(file.stem for file in files)
    for file in progress(files, "reading files"):
        for number, place, found in listed_frames(file, _content(file), ("frame_id", "frame_index"), people_of_frame):
            people.frame(file.stem, number)
            for i, person in enumerate(found):
                values = person if isinstance(person, dict) else {}
                at, scores = f"{place}[{i}].keypoints", values.get("keypoint_scores")
                people.add(file.stem, number, at, values.get("keypoints"), scores)
    joints = people.joints
    if joints is None:
        raise ValueError(f"{path}: expected people in some frame, found none in {', '.join(f.name for f in files)}")
    if skeleton is None:
        skeleton = default_skeleton(path, joints)
    elif joints < len(skeleton):
        raise ValueError(f"{path}: expected {len(skeleton)} joints as of {skeleton.name}, found {joints}")
    return people.detections(skeleton)


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
    if any(any((path / folder).glob("*/*.json")) for folder in (*_FOLDERS, *openpose.FOLDERS)):
        return []  # A file for each frame
    raise FileNotFoundError(
        f"{path}: expected predictions/<camera>.json or <camera>.pkl, found none; name their folder by "
        "data.detections=..."
    )


def _content(file: Path):
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
