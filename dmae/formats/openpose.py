"""OpenPose's JSON: one folder per camera, with one file per frame."""

import json
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D, Poses3D, Source
from dmae.data.skeleton import BODY25, Skeleton
from dmae.files.checks import child
from dmae.files.contents import write_atomic
from dmae.formats.calibrations import write_calibration
from dmae.formats.poses import covariance_entry, pixel_covariances
from dmae.formats.recordings import (
    FRAME_KEYS,
    NumberedDetections,
    People,
    by_name,
    json_frames,
    listed,
    people_of_frame,
)
from dmae.formats.registry import pose_writer, reader, recording_writer
from dmae.formats.skeletons import default_skeleton, guess_skeleton
from dmae.progress import progress

CALIBRATION = "calibration.toml"
"""File name of the calibration, in Pose2Sim's format, for formats without a calibration format of their own."""
FOLDERS = ("openpose", "keypoints", "pose", "json", "predictions")
"""Folders in a recording that can contain the folders of the cameras. The recording itself is searched first."""
_KEYPOINTS = ("pose_keypoints_2d", "pose_keypoints", "keypoints")
_SUFFIXES = ("_keypoints", "_json")
_PANOPTIC = "body3DScene"  # Start of the names of Panoptic's pose files, which are not detections
COMPLETED_SCORE = 0.5
"""Confidence that is written for completed joints. Measured joints have 1."""


@reader(
    "openpose",
    signs=[
        ["*/*_keypoints.json"],
        ["*/*[0-9].json"],
        ["openpose"],
        ["keypoints/*/*.json"],
        ["pose/*/*.json"],
        ["json/*/*.json"],
        ["predictions/*/*.json"],
    ],
    general=True,
    cameras=False,
)
def read_detections(path: Path, *, skeleton: Skeleton | None = None) -> NumberedDetections:
    """OpenPose's <camera>/<name>_<frame number>_keypoints.json, with a calibration of any format.

    Read `<camera>/<anything><frame number>[_keypoints].json`, as OpenPose and Pose2Sim name them.

    A file can also be a frame of MMPose or RTMPose: a list of people with `keypoints` and `keypoint_scores`.

    A joint with confidence 0 or at 0, 0 is absent. A person `{}`, which Pose2Sim writes, is absent. If a file is not
    valid JSON, for example because it is cut short, its frame is absent and the file is listed in `unreadable`.

    Args:
        skeleton: Skeleton of the files. By default the number of joints determines it. BODY_25 and BODY_25B have the
            same number of joints, so `guess_skeleton` chooses between them.

    Raises:
        FileNotFoundError: there are no such files.
        ValueError: a file is JSON but not OpenPose's, a frame occurs twice, a person has a different number of joints
            than the skeleton, no file could be read, or there are too few people to determine the skeleton.
    """
    folders = camera_folders(Path(path))
    files = {name: sorted(filter(_is_frame, folder.glob("*.json"))) for name, folder in folders.items()}
    people = People(files, skeleton)
    for name, number, file, content in json_frames(path, files, people.unreadable):
        people.frame(name, number)
        of_mmpose = isinstance(content, list) or (
            isinstance(content, dict) and {*content} & ({*FRAME_KEYS} - {"people"})
        )
        found = people_of_frame(str(file), content) if of_mmpose else listed(file, content, "people")
        for i, person in enumerate(found):
            if person != {}:
                values = person if isinstance(person, dict) else {}
                key = next((key for key in _KEYPOINTS if key in values), _KEYPOINTS[0])
                place = f"{file}: people[{i}].{key}"
                people.add(name, number, place, values.get(key), values.get("keypoint_scores"))
    # OpenPose can write fractions of the image instead of px.
    largest = max((np.fmax.reduce(np.abs(person[:, :2]), axis=None, initial=-1) for person in people), default=-1)
    if 0 <= largest <= 1:
        raise ValueError(
            f"{path}: expected pixels, found no coordinate above {largest:g}; detect with keypoint_scale 0"
        )
    notes: tuple[str, ...] = ()
    if skeleton is None and people.joints in (None, len(BODY25)):
        skeleton, notes = guess_skeleton(path, people.all())
    return people.detections(skeleton or default_skeleton(path, people.joints), notes)


def camera_folders(path: Path) -> dict[str, Path]:
    """Return the folders of frames by camera name, from `path` or from one of `FOLDERS` in it.

    The name of a camera is its folder's, without `_json` or `_keypoints` at the end. Raises FileNotFoundError if there
    are no such folders, and ValueError if two have the same name.
    """
    for place in (path, *(path / name for name in FOLDERS)):
        if not place.is_dir():
            continue
        found = by_name(
            folder
            for folder in place.iterdir()
            if "calib" not in folder.name.lower() and any(map(_is_frame, folder.glob("*.json")))
        )
        names = [folder.name.removesuffix("_keypoints").removesuffix("_json") for folder in found]
        if len(set(names)) < len(names):
            raise ValueError(f"{place}: expected a folder for each camera, found two of the same: {names}")
        if found:
            return dict(zip(names, found, strict=True))
    raise FileNotFoundError(
        f"{path}: expected a folder for each camera that holds <name>_<frame number>_keypoints.json, found none; "
        "name the folder of detections by data.detections=..."
    )


def _is_frame(file: Path) -> bool:
    return not file.name.startswith(_PANOPTIC) and (file.stem.endswith(_SUFFIXES) or file.stem[-1:].isdigit())


def write_detections(
    detections: Detections2D,
    cameras: tuple[str, ...],
    folder: Path,
    first: int = 0,
    sources: np.ndarray | None = None,
    covariances: np.ndarray | None = None,
) -> None:
    """Write `<camera>/<camera>_<frame number>_keypoints.json`, to 0.0001 px, of V cameras, with frames from `first`.

    Args:
        sources: (F, D, J) `Source` of the joints if `detections` are reprojected poses, with the same D persons in
            each view. People then have a `person_id`, and `joint_source` in addition to `pose_keypoints_2d`.
        covariances: (F, V, D, J, 3) px^2, xx, xy and yy. People then have `joint_covariance`, null where unknown.
    """
    folders = [child(folder, name, "camera") for name in cameras]
    for frame in progress(range(len(detections.xy)), "writing detections"):
        for view, place in enumerate(folders):
            file = child(place, f"{place.name}_{first + frame:012d}_keypoints.json", "camera")
            write_people(detections, frame, view, file, sources, covariances)


def write_people(
    detections: Detections2D,
    frame: int,
    view: int,
    file: Path,
    sources: np.ndarray | None = None,
    covariances: np.ndarray | None = None,
) -> None:
    """Write the detections of one image as OpenPose does. Arguments as in `write_detections`."""
    xy, score = detections.xy[frame, view].astype(np.float64), detections.score[frame, view]
    values = np.concatenate([xy, score[..., None]], -1)
    values = np.round(np.where(np.isnan(values), 0, values), 4)
    written = []
    for number in np.flatnonzero(detections.observed[frame, view].any(-1)):
        person: dict[str, list] = {"person_id": [-1 if sources is None else int(number)]}
        person["pose_keypoints_2d"] = values[number].ravel().tolist()
        if sources is not None:
            person["joint_source"] = sources[frame, number].tolist()
        if covariances is not None:
            person["joint_covariance"] = covariance_entry(covariances[frame, view, number])
        written.append(person)
    write_atomic(file, json.dumps({"version": 1.3, "people": written}))


def reproject(poses: Poses3D, rig: CameraRig) -> Detections2D:
    """Return poses as one detection per person and view, inside images, confidence `COMPLETED_SCORE` or else 1."""
    xy, _ = rig.project(poses.xyz)
    score = np.where(poses.source == Source.COMPLETED, COMPLETED_SCORE, 1.0)[:, None]
    inside = rig.inside(xy)
    return Detections2D(
        poses.skeleton,
        np.where(inside[..., None], xy, np.nan),
        np.where(inside, np.broadcast_to(score, inside.shape), np.nan),
    )


@pose_writer("openpose", folder=True, errors=True)
def write_openpose_poses(poses: Poses3D, clip: Clip, path: Path) -> None:
    """OpenPose's JSON of poses as the cameras see them, with a Pose2Sim calibration."""
    first = clip.provenance.get("first_frame", 0)
    write_calibration(clip.rig, path / CALIBRATION, "pose2sim")
    cov = pixel_covariances(poses, clip.rig)
    write_detections(reproject(poses, clip.rig), clip.rig.names, path, first, poses.source, cov)


@recording_writer("openpose", lacks=["fps", "skeleton"])
def write_openpose(clip: Clip, path: Path) -> None:
    """OpenPose's JSON of detections, with a Pose2Sim calibration."""
    write_calibration(clip.rig, path / CALIBRATION, "pose2sim")
    write_detections(clip.detections, clip.rig.names, path, clip.provenance.get("first_frame", 0))
