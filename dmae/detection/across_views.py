"""People that a camera missed: searched where the poses from the other cameras project into its images."""

import hashlib
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import Skeleton
from dmae.data.store import write_atomic
from dmae.detection.picture_size import Fitting
from dmae.detection.pictures import CameraPictures
from dmae.detection.pipeline import PIECE, Found, check_people, make_detector, read_piece
from dmae.detection.registry import PoseDetectorConfig
from dmae.parallel import in_parallel
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

_SAME = 0.3
"""Largest median distance between the joints of a detection and of a projected person that are one, relative to the
radius of the body in the image."""
_NEAR = 0.15
"""The same for a person that was searched at a place, to be kept."""
_TORSO = ("l_shoulder", "r_shoulder", "l_hip", "r_hip")
"""Joints that must be known of a person that is searched."""
_LEAST_INSIDE = 0.5
"""Smallest share of a person's joints that must project into an image."""


def find_missed(
    found: Sequence[Found],
    cameras: Sequence[CameraPictures],
    rig: CameraRig,
    detections: Detections2D,
    frames: Sequence[np.ndarray],
    fittings: Sequence[Fitting],
    fps: float,
    config: PoseDetectorConfig,
    pieces: Path,
    workers: int = 1,
) -> list[Found]:
    """Return what a detector found in V cameras, with the people added that it finds with the help of other cameras.

    People are captured from the detections. Where a person projects into an image and no detection is near, the
    detector searches at that place. What it finds there is added if it agrees with the projection. An added detection
    is measured in its image like all others.

    Args:
        found: For each camera.
        cameras: With the images, in the order of the rig.
        detections: (F, V, D, J) what was found, in the pixels of the calibration.
        frames: For each camera (N,) the frame of each image; -1 for an image that is not used.
        fittings: Scale and margin of each camera's images.
        fps: Frames per second of the detections.
        config: The detector. Without a method `find_at` nothing is added.
        pieces: Folder to which each finished piece is written. Pieces that are there are not computed again.
        workers: Processes; -1 for one per core.
    """
    if not config.across_views or len(rig) < 2 or not hasattr(make_detector(config), "find_at"):
        return list(found)
    missed = missed_people(rig, detections, fps)
    tasks = []
    for view, (camera, places, fitting) in enumerate(zip(cameras, frames, fittings, strict=True)):
        expected = {
            number: fitting.from_calibration(missed[frame, view])
            for number, frame in enumerate(places.tolist())
            if (frame, view) in missed and found[view].people[number] is not None
        }
        for start in range(0, len(camera), PIECE):
            wanted = {number: expected[number] for number in range(start, start + PIECE) if number in expected}
            if wanted:
                known = {number: found[view].people[number] for number in wanted}
                # The places depend on the calibration: pieces of an interrupted run with another one are not taken.
                places_of = hashlib.sha256(b"".join(each.tobytes() for each in wanted.values())).hexdigest()[:16]
                file = pieces / f"again_{view:03d}_{start:08d}_{places_of}.npz"
                tasks.append((view, (camera, config, wanted, known, file)))
    waiting = [task for _, task in tasks if not task[-1].is_file()]
    done = in_parallel(_search_piece, waiting, max(1, min(workers, len(waiting))), ordered=False)
    for _ in progress(done, "searching people that other cameras see", len(waiting)):
        pass
    people = [list(each.people) for each in found]
    for view, (*_, wanted, known, file) in tasks:
        for number, added in zip(wanted, read_piece(file), strict=True):
            people[view][number] = np.concatenate([known[number], added])
    return [Found(each) for each in people]


def missed_people(rig: CameraRig, detections: Detections2D, fps: float) -> dict[tuple[int, int], np.ndarray]:
    """Return the people that views missed, by frame and view: where their joints are expected, (n, J, 2) px.

    A person that is captured in a frame is missed by a view if at least half of its joints project into the image and
    no detection is near the projection.
    """
    poses = capture(Clip("detected", fps, rig, detections), CaptureConfig())
    skeleton = detections.skeleton
    xyz, torso = poses.xyz, skeleton.index(*_TORSO)
    known = np.isfinite(xyz[:, :, torso]).all((-1, -2))
    missed: dict[tuple[int, int], list[np.ndarray]] = {}
    for frame in np.flatnonzero(known.any(1)).tolist():
        projected, _ = rig.project(xyz[frame : frame + 1, known[frame]])
        inside = rig.inside(projected)[0].mean(-1) >= _LEAST_INSIDE
        inside &= np.isfinite(projected[0][:, :, torso]).all((-1, -2))
        for view, person in np.argwhere(inside).tolist():
            expected = projected[0, view, person]
            distance = np.linalg.norm(detections.xy[frame, view] - expected, axis=-1)
            near = np.nanmedian(distance[np.isfinite(distance).any(-1)], -1) < _SAME * body_radius(expected, skeleton)
            if not near.any():
                missed.setdefault((frame, view), []).append(expected)
    return {place: np.stack(each) for place, each in missed.items()}


def body_radius(xy: np.ndarray, skeleton: Skeleton) -> float:
    """Return the largest distance of joints (J, 2) from the middle of the hips, px; NaN where unknown."""
    hips = xy[skeleton.index("l_hip", "r_hip")].mean(0)
    return float(np.nanmax(np.linalg.norm(xy - hips, axis=-1)))


def _agrees(person: np.ndarray, expected: np.ndarray, skeleton: Skeleton) -> bool:
    """Return whether a person (J, 3) is at one of the expected places (n, J, 2)."""
    distance = np.linalg.norm(person[:, :2] - expected, axis=-1)
    return any(
        np.isfinite(each).any() and np.nanmedian(each) < _NEAR * body_radius(places, skeleton)
        for each, places in zip(distance, expected, strict=True)
    )


def _search_piece(
    camera: CameraPictures,
    config: PoseDetectorConfig,
    wanted: dict[int, np.ndarray],
    known: dict[int, np.ndarray],
    file: Path,
) -> None:
    """Search people at expected places in some images, and write those found to a file."""
    detector = make_detector(config)
    start, stop = min(wanted), max(wanted) + 1
    found = {number: np.empty((0, len(detector.skeleton), 3)) for number in wanted}
    for number, picture in zip(range(start, stop), camera.read(start, stop), strict=True):
        if number in wanted and picture is not None:
            there = detector.find_at(picture, wanted[number], known[number][..., :2])
            people = check_people(detector, there, config.name)
            found[number] = people[[_agrees(person, wanted[number], detector.skeleton) for person in people]]
    counts = np.array([len(each) for each in found.values()])
    values = np.concatenate(list(found.values())).astype(np.float32)
    np.savez(buffer := io.BytesIO(), readable=np.ones(len(found), bool), counts=counts, people=values)
    write_atomic(file, buffer.getvalue())
