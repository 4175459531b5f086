"""What cameras see together: parts of people are removed, and people that one of them missed are searched again."""

import hashlib
import io
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import Skeleton
from dmae.detection.picture_size import Fitting
from dmae.detection.pictures import CameraPictures
from dmae.detection.pipeline import PIECE, Found, check_people, make_detector, read_piece
from dmae.detection.projected_people import body_radius, missed_people, parts_of_people
from dmae.detection.registry import PoseDetectorConfig
from dmae.files.contents import write_atomic
from dmae.parallel import in_parallel
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

_NEAR = 0.15
"""Largest median distance between the joints of a person that was searched at a place and of the projection there,
relative to the radius of the body in the image."""


def compare_views(
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
    """Return what a detector found in V cameras, corrected with the help of the other cameras.

    People are captured from the detections. Detections that are parts of them are removed. Where a person projects into
    an image and no detection is left for it, the detector searches at that place. What it finds there is added if it
    agrees with the projection. An added detection is measured in its image like all others.

    Args:
        found: For each camera.
        cameras: With the images, in the order of the rig.
        detections: (F, V, D, J) what was found, in the pixels of the calibration.
        frames: For each camera (N,) the frame of each image; -1 for an image that is not used.
        fittings: Scale and margin of each camera's images.
        fps: Frames per second of the detections.
        config: The detector. Without a method `find_at` people are not searched.
        pieces: Folder to which each finished piece is written. Pieces that are there are not computed again.
        workers: Processes; -1 for one per core.
    """
    if not config.across_views or len(rig) < 2:
        return list(found)
    poses = capture(Clip("detected", fps, rig, detections), CaptureConfig())
    parts = parts_of_people(poses, rig, detections)
    found = [
        _without(each, places, parts[:, view]) for view, (each, places) in enumerate(zip(found, frames, strict=True))
    ]
    if not hasattr(make_detector(config), "find_at"):
        return found
    xy, score = (
        np.where(parts[..., None, None], np.nan, part) for part in (detections.xy, detections.score[..., None])
    )
    missed = missed_people(poses, rig, replace(detections, xy=xy, score=score[..., 0]))
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


def _without(found: Found, frames: np.ndarray, parts: np.ndarray) -> Found:
    """Return what a camera found without parts of people, (F, D) True."""
    return Found(
        [
            people if people is None or frame < 0 else people[~parts[frame, : len(people)]]
            for people, frame in zip(found.people, frames, strict=True)
        ]
    )


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
