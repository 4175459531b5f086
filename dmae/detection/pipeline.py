"""From images to detections: each camera in pieces, in parallel and resumed, then all cameras together."""

import hashlib
import io
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.detection.images import CameraImages, Recording
from dmae.detection.registry import ImageDetector, PoseDetectorConfig, pose_detector
from dmae.files.arrays import read_arrays
from dmae.files.checks import MOST_PIXELS
from dmae.files.contents import write_atomic
from dmae.numerics.body import distance_to_bones
from dmae.numerics.statistics import median_over_frames
from dmae.parallel import in_parallel
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from dmae.registry import OutsideError, raised_in

PIECE = 240
"""Number of images that are processed together. The results of a piece do not depend on other pieces."""
CameraPeople = list[np.ndarray | None]
"""What a detector found in the images of a camera: people (D, J, 3) of each, x, y px and confidence, NaN where absent;
None for an image that cannot be read."""


def make_detector(config: PoseDetectorConfig) -> ImageDetector:
    """Return a detector for the images of one camera.

    Raises ValueError if there is no such detector, or it cannot be made; the message says why.
    """
    expected = (
        f"detector={config.name}: expected a function of the options that returns a detector, which has a skeleton and "
        "is called with images (see dmae.detection.registry),"
    )
    detector = pose_detector.find(config.name).function(config)
    if isinstance(detector, type):
        raise ValueError(f"{expected} it returned the class {detector.__name__} itself; call it")
    if not isinstance(getattr(detector, "skeleton", None), Skeleton) or not callable(detector):
        raise ValueError(f"{expected} it returned {type(detector).__name__}")
    return detector


def detect_people(
    cameras: Sequence[CameraImages], config: PoseDetectorConfig, pieces: Path, workers: int = 1
) -> dict[str, CameraPeople]:
    """Run a detector over all images of some cameras.

    Raises ValueError if the detector cannot be made, or its results are not people.

    Args:
        pieces: Folder to which each finished piece is written. Pieces that are there are not computed again.
        workers: Processes; -1 for one per core.

    Returns:
        What was found, by name of the camera.
    """
    tasks = [
        (camera, config, start, min(start + PIECE, len(camera)), pieces / f"{number:03d}_{start:08d}.npz")
        for number, camera in enumerate(cameras)
        for start in range(0, len(camera), PIECE)
    ]
    waiting = [task for task in tasks if not task[-1].is_file()]
    if waiting:
        # Errors of the detector are found before processes start.
        make_detector(config)
        done = in_parallel(_detect_piece, waiting, min(workers, len(waiting)), ordered=False)
        for _ in progress(done, "detecting people", len(waiting)):
            pass
    found: dict[str, CameraPeople] = {camera.name: [] for camera in cameras}
    for camera, *_, file in tasks:
        found[camera.name].extend(read_piece(file))
    return found


def to_detections(
    found: Sequence[CameraPeople], frames: Sequence[np.ndarray], count: int, skeleton: Skeleton
) -> Detections2D:
    """Return what was found in V cameras as detections of F frames.

    Args:
        frames: For each camera (N,) the frame of each image; -1 for an image that is not used.
        count: F.
        skeleton: J joints.
    """
    most = max((len(people) for camera in found for people in camera if people is not None), default=0)
    values = np.full((count, len(found), most, len(skeleton), 3), np.nan, np.float32)
    for view, (camera, places) in enumerate(zip(found, frames, strict=True)):
        for frame, people in zip(places, camera, strict=True):
            if frame >= 0 and people is not None:
                values[frame, view, : len(people)] = people
    absent = np.isnan(values).any(-1)
    values[absent] = np.nan
    return Detections2D(skeleton, values[..., :2], values[..., 2])


def _detect_piece(camera: CameraImages, config: PoseDetectorConfig, start: int, stop: int, file: Path) -> None:
    detector = make_detector(config)
    people: list[np.ndarray | None] = []
    readable: list[int] = []
    late = getattr(detector, "found_late", list)
    for number, image in enumerate(camera.read(start, stop)):
        people.append(
            None if image is None else check_people(detector, _look(detector, image, config.name), config.name)
        )
        if image is not None:
            readable.append(number)
            for ago, *found in late():
                people[readable[-1 - ago]] = check_people(detector, found, config.name)
    _write_piece(file, people, len(detector.skeleton))


def _look(detector: ImageDetector, image: np.ndarray, name: str) -> Sequence[np.ndarray]:
    """Return what a detector finds in an image. The errors of the user's say that they are its own."""
    try:
        return detector(image)
    except (ValueError, KeyError, OSError) as error:
        if ":" not in name:
            raise
        raise OutsideError(f"detector={name}: {raised_in(error, type(detector))}") from error


def check_people(detector: ImageDetector, found: Sequence[np.ndarray], name: str) -> np.ndarray:
    """Return what a detector found as people (D, J, 3)."""
    joints = len(detector.skeleton)
    try:
        xy, score = (np.asarray(each, np.float64) for each in found)
        if not xy.size and not score.size:
            return np.empty((0, joints, 3))
        people = np.concatenate([xy, score[..., None]], -1)
        if people.shape != (len(people), joints, 3):
            raise ValueError
    except (TypeError, ValueError):
        shapes = [getattr(each, "shape", each) for each in found] if isinstance(found, tuple | list) else type(found)
        raise ValueError(
            f"detector={name}: expected two arrays, xy (D, {joints}, 2) px and score (D, {joints}), 1 if the detector "
            f"states none; found {shapes!r:.80}"
        ) from None
    if 0 < np.fmax.reduce(np.abs(xy[score > 0]), axis=None, initial=0) <= 1:
        raise ValueError(f"detector={name}: expected pixels, found no coordinate above 1")
    with np.errstate(invalid="ignore"):
        people[~(np.abs(people) < MOST_PIXELS).all(-1)] = np.nan
    return people[np.isfinite(people).all(-1).any(-1)]


def _write_piece(file: Path, people: CameraPeople, joints: int) -> None:
    readable = np.array([each is not None for each in people], bool)
    there = [np.empty((0, joints, 3)) if each is None else each for each in people]
    values = np.concatenate([np.empty((0, joints, 3)), *there]).astype(np.float32)
    np.savez(buffer := io.BytesIO(), readable=readable, counts=np.array(list(map(len, there))), people=values)
    write_atomic(file, buffer.getvalue())


def read_piece(file: Path) -> Iterator[np.ndarray | None]:
    """Yield the people (D, J, 3) of each image of a piece; None for one that cannot be read."""
    arrays = read_arrays(file, "detections of some images", ("readable", "counts", "people"))
    ends = np.cumsum(arrays["counts"])
    for readable, start, end in zip(arrays["readable"], ends - arrays["counts"], ends, strict=True):
        yield arrays["people"][start:end] if readable else None


def in_calibration(found: Sequence[CameraPeople], recording: Recording, skeleton: Skeleton) -> Detections2D:
    """Return what was found in the cameras of a recording as detections, in the pixels of its calibration."""
    fitted = [
        [
            None if each is None else np.concatenate([fitting.to_calibration(each[..., :2]), each[..., 2:]], -1)
            for each in people
        ]
        for people, fitting in zip(found, recording.fittings, strict=True)
    ]
    return to_detections(fitted, recording.alignment.frames, recording.alignment.count, skeleton)


# What cameras see together: parts of people are removed, people whom one camera missed are searched again

_NEAR = 0.15
"""Largest median distance between the joints of a person that was searched at a place and of the projection there,
relative to the radius of the body in the image."""


def compare_views(
    found: Sequence[CameraPeople], recording: Recording, config: PoseDetectorConfig, pieces: Path, workers: int = 1
) -> list[CameraPeople]:
    """Return what a detector found in the V cameras of a recording, corrected with the help of the other cameras.

    People are captured from the detections. Detections that are parts of them are removed. Where a person projects into
    an image and no detection is left for it, the detector searches at that place. What it finds there is added if it
    agrees with the projection. An added detection is measured in its image like all others. Nothing changes without a
    calibration, or with a single camera.

    Args:
        found: What the detector found in each camera, in the pixels of its images.
        config: The detector. Without a method `find_at` people are not searched.
        pieces: Folder to which each finished piece is written. Pieces that are there are not computed again.
        workers: Processes; -1 for one per core.
    """
    rig, alignment = recording.rig, recording.alignment
    if rig is None or not config.across_views or len(rig) < 2:
        return list(found)
    detector = make_detector(config)
    detections = in_calibration(found, recording, detector.skeleton)
    poses = capture(Clip("detected", alignment.fps, rig, detections), CaptureConfig())
    parts = parts_of_people(poses, rig, detections)
    found = [
        [
            people if people is None or frame < 0 else people[~parts[frame, view, : len(people)]]
            for people, frame in zip(each, places, strict=True)
        ]
        for view, (each, places) in enumerate(zip(found, alignment.frames, strict=True))
    ]
    if not hasattr(detector, "find_at"):
        return found
    xy, score = (
        np.where(parts[..., None, None], np.nan, part) for part in (detections.xy, detections.score[..., None])
    )
    missed = missed_people(poses, rig, replace(detections, xy=xy, score=score[..., 0]))
    tasks = []
    of_cameras = zip(recording.cameras, alignment.frames, recording.fittings, strict=True)
    for view, (camera, places, fitting) in enumerate(of_cameras):
        expected = {
            number: fitting.from_calibration(missed[frame, view])
            for number, frame in enumerate(places.tolist())
            if (frame, view) in missed and found[view][number] is not None
        }
        for start in range(0, len(camera), PIECE):
            wanted = {number: expected[number] for number in range(start, start + PIECE) if number in expected}
            if wanted:
                known = {number: found[view][number] for number in wanted}
                # The places depend on the calibration: pieces of an interrupted run with another one are not taken.
                places_of = hashlib.sha256(b"".join(each.tobytes() for each in wanted.values())).hexdigest()[:16]
                file = pieces / f"again_{view:03d}_{start:08d}_{places_of}.npz"
                tasks.append((view, (camera, config, wanted, known, file)))
    waiting = [task for _, task in tasks if not task[-1].is_file()]
    done = in_parallel(_search_piece, waiting, max(1, min(workers, len(waiting))), ordered=False)
    for _ in progress(done, "searching people that other cameras see", len(waiting)):
        pass
    for view, (*_, wanted, known, file) in tasks:
        for number, added in zip(wanted, read_piece(file), strict=True):
            found[view][number] = np.concatenate([known[number], added])
    return found


def _agrees(person: np.ndarray, expected: np.ndarray, skeleton: Skeleton) -> bool:
    """Return whether a person (J, 3) is at one of the expected places (n, J, 2)."""
    distance = np.linalg.norm(person[:, :2] - expected, axis=-1)
    return any(
        np.isfinite(each).any() and np.nanmedian(each) < _NEAR * body_radius(places, skeleton)
        for each, places in zip(distance, expected, strict=True)
    )


def _search_piece(
    camera: CameraImages,
    config: PoseDetectorConfig,
    wanted: dict[int, np.ndarray],
    known: dict[int, np.ndarray],
    file: Path,
) -> None:
    """Search people at expected places in some images, and write those found to a file."""
    detector: Any = make_detector(config)  # with the method `find_at`
    start, stop = min(wanted), max(wanted) + 1
    found = {number: np.empty((0, len(detector.skeleton), 3)) for number in wanted}
    for number, image in zip(range(start, stop), camera.read(start, stop), strict=True):
        if number in wanted and image is not None:
            there = detector.find_at(image, wanted[number], known[number][..., :2])
            people = check_people(detector, there, config.name)
            found[number] = people[[_agrees(person, wanted[number], detector.skeleton) for person in people]]
    _write_piece(file, list(found.values()), len(detector.skeleton))


# Captured people projected into images: which cameras missed them, and which detections are parts of them

_SAME = 0.3
"""Largest median distance between the joints of a detection and of a projected person that are one, relative to the
radius of the body in the image."""
_FORBIDDEN = 1e3  # Cost of a pair that is farther apart
_TORSO = ("l_shoulder", "r_shoulder", "l_hip", "r_hip")  # Joints that must be known of a person that is searched
_LEAST_INSIDE = 0.5  # Smallest share of a person's joints that must project into an image
_SMALLER, _ON_BODY, _MOST_JOINTS = 0.5, 0.2, 0.9
"""A detection is a part of a person if it is no person (`_SAME`), its size is at most this share of the person's, and
this share of its joints is within this distance from the person's bones, relative to the radius of the body."""


def missed_people(poses: Poses3D, rig: CameraRig, detections: Detections2D) -> dict[tuple[int, int], np.ndarray]:
    """Return the people that views missed, by frame and view: where their joints are expected, (n, J, 2) px.

    A person that is captured in a frame is missed by a view if at least half of its joints project into the image and
    no detection near the projection is left for it. Each detection counts for one person, also where people overlap.
    """
    torso = poses.skeleton.index(*_TORSO)
    known = np.isfinite(poses.xyz[:, :, torso]).all((-1, -2))
    missed = {}
    for frame in np.flatnonzero(known.any(1)).tolist():
        projected, inside = _project(poses, rig, frame, known[frame])
        inside &= np.isfinite(projected[:, :, torso]).all((-1, -2))
        distance = _distances(detections.xy[frame], projected) / body_radius(projected, poses.skeleton)[:, None]
        gone = inside & ~_assigned(distance)
        for view in np.flatnonzero(gone.any(1)).tolist():
            missed[frame, view] = projected[view, gone[view]]
    return missed


def parts_of_people(poses: Poses3D, rig: CameraRig, detections: Detections2D) -> np.ndarray:
    """Return (F, V, D) True for detections that are parts of people, for example a small body found in long hair.

    Such a detection is much smaller than a captured person in the same image, lies on the bones of that person, and is
    near no captured person. A real person of that size would be hidden by the larger one, or captured by other cameras.
    """
    parts = np.zeros(detections.xy.shape[:3], bool)
    sizes = _size(detections.xy)
    known = np.isfinite(poses.xyz).all(-1).any(-1)
    for frame in np.flatnonzero(known.any(1)).tolist():
        projected, _ = _project(poses, rig, frame, known[frame])
        radius = body_radius(projected, poses.skeleton)[:, None]
        distance = _distances(detections.xy[frame], projected) / radius
        explained = (distance < _SAME).any(-1)
        smaller = sizes[frame][..., None] < _SMALLER * _size(projected)[:, None]
        for view, detection, person in np.argwhere(smaller & ~explained[..., None]).tolist():
            places = detections.xy[frame, view, detection]
            places = places[np.isfinite(places).all(-1)]
            apart = distance_to_bones(places, projected[view, person], poses.skeleton.bones)
            on_body = apart < _ON_BODY * radius[view, 0, person]
            parts[frame, view, detection] |= on_body.mean() >= _MOST_JOINTS
    return parts


def body_radius(xy: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the largest distance of joints (..., J, 2) from the middle of the hips, px; NaN where unknown."""
    hips = xy[..., skeleton.index("l_hip", "r_hip"), :].mean(-2, keepdims=True)
    return np.fmax.reduce(np.linalg.norm(xy - hips, axis=-1), -1)


def _project(poses: Poses3D, rig: CameraRig, frame: int, persons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return some persons of a frame, (V, n, J, 2) px, and whether most of each is inside the images, (V, n)."""
    projected, _ = rig.project(poses.xyz[frame : frame + 1, persons])
    return projected[0], rig.inside(projected)[0].mean(-1) >= _LEAST_INSIDE


def _distances(xy: np.ndarray, projected: np.ndarray) -> np.ndarray:
    """Return the median distances (V, D, P), px, of the common joints of detections (V, D, J, 2) and persons (V, P, J,
    2)."""
    distance = np.linalg.norm(xy[:, :, None] - projected[:, None], axis=-1)
    return median_over_frames(np.moveaxis(distance, -1, 0))


def _assigned(distance: np.ndarray) -> np.ndarray:
    """Return (V, P) True for persons to which a detection of the view is assigned, by distances (V, D, P)."""
    assigned = np.zeros((len(distance), distance.shape[2]), bool)
    cost = np.where(distance < _SAME, distance, _FORBIDDEN)
    for view, each in enumerate(cost):
        rows, columns = linear_sum_assignment(each)
        assigned[view, columns[each[rows, columns] < _FORBIDDEN]] = True
    return assigned


def _size(xy: np.ndarray) -> np.ndarray:
    """Return the diagonals of the upright boxes around joints (..., J, 2), px; NaN where no joint is known."""
    return np.linalg.norm(np.fmax.reduce(xy, -2) - np.fmin.reduce(xy, -2), axis=-1)
