"""From the images of cameras to detections: in pieces, in parallel. An interrupted run is continued."""

import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmae.data.clip import Detections2D
from dmae.data.skeleton import Skeleton
from dmae.detection.pictures import CameraPictures
from dmae.detection.registry import PictureDetector, PoseDetectorConfig, pose_detector
from dmae.files.arrays import read_arrays
from dmae.files.checks import MOST_PIXELS
from dmae.files.contents import write_atomic
from dmae.parallel import in_parallel
from dmae.progress import progress

PIECE = 240
"""Number of images that are processed together. The results of a piece do not depend on other pieces."""


@dataclass(frozen=True)
class Found:
    """What a detector found in the N images of a camera.

    Attributes:
        people: For each image (D, J, 3): x, y px and confidence; NaN where absent. None for one that cannot be read.
    """

    people: list[np.ndarray | None]

    @property
    def unreadable(self) -> list[int]:
        """Numbers of the images that cannot be read."""
        return [number for number, people in enumerate(self.people) if people is None]


def make_detector(config: PoseDetectorConfig) -> PictureDetector:
    """Return a detector for the images of one camera.

    Raises:
        ValueError: there is no such detector, or it cannot be made; the message says why.
    """
    detector = pose_detector.find(config.name).function(config)
    if not isinstance(getattr(detector, "skeleton", None), Skeleton) or not callable(detector):
        raise ValueError(
            f"detector={config.name}: expected a function that returns a detector, which has a skeleton and is called "
            f"with pictures (see dmae.detection.registry), it returned {type(detector).__name__}"
        )
    return detector


def detect_people(
    cameras: Sequence[CameraPictures], config: PoseDetectorConfig, pieces: Path, workers: int = 1
) -> dict[str, Found]:
    """Run a detector over all images of some cameras.

    Args:
        cameras: Each with its images.
        config: The detector.
        pieces: Folder to which each finished piece is written. Pieces that are there are not computed again.
        workers: Processes; -1 for one per core.

    Returns:
        By name of the camera, what was found.

    Raises:
        ValueError: the detector cannot be made, or its results are not people.
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
    found: dict[str, Found] = {camera.name: Found([]) for camera in cameras}
    for camera, *_, file in tasks:
        found[camera.name].people.extend(read_piece(file))
    return found


def to_detections(found: Sequence[Found], frames: Sequence[np.ndarray], count: int, skeleton: Skeleton) -> Detections2D:
    """Return what was found in V cameras as detections of F frames.

    Args:
        found: For each camera.
        frames: For each camera (N,) the frame of each image; -1 for an image that is not used.
        count: F.
        skeleton: J joints.
    """
    most = max((len(people) for camera in found for people in camera.people if people is not None), default=0)
    values = np.full((count, len(found), most, len(skeleton), 3), np.nan, np.float32)
    for view, (camera, places) in enumerate(zip(found, frames, strict=True)):
        for frame, people in zip(places, camera.people, strict=True):
            if frame >= 0 and people is not None:
                values[frame, view, : len(people)] = people
    absent = np.isnan(values).any(-1)
    values[absent] = np.nan
    return Detections2D(skeleton, values[..., :2], values[..., 2])


def _detect_piece(camera: CameraPictures, config: PoseDetectorConfig, start: int, stop: int, file: Path) -> None:
    """Detect the people of some images, and write them to a file."""
    detector = make_detector(config)
    people: list[np.ndarray | None] = []
    readable: list[int] = []
    late = getattr(detector, "found_late", list)
    for number, picture in enumerate(camera.read(start, stop)):
        people.append(None if picture is None else check_people(detector, detector(picture), config.name))
        if picture is not None:
            readable.append(number)
            for ago, *found in late():
                people[readable[-1 - ago]] = check_people(detector, found, config.name)
    there = [each for each in people if each is not None and len(each)]
    counts = np.array([0 if each is None else len(each) for each in people])
    values = np.concatenate(there) if there else np.empty((0, len(detector.skeleton), 3))
    known = np.array([each is not None for each in people], bool)
    np.savez(buffer := io.BytesIO(), readable=known, counts=counts, people=values.astype(np.float32))
    write_atomic(file, buffer.getvalue())


def check_people(detector: PictureDetector, found: Sequence[np.ndarray], name: str) -> np.ndarray:
    """Return what a detector found as people (D, J, 3)."""
    xy, score = (np.asarray(each, np.float64) for each in found)
    shape = (len(xy), len(detector.skeleton))
    if xy.shape != (*shape, 2) or score.shape != shape:
        raise ValueError(
            f"detector={name}: expected xy (D, {shape[1]}, 2) and score (D, {shape[1]}), "
            f"found {xy.shape} and {score.shape}"
        )
    people = np.concatenate([xy, score[..., None]], -1)
    with np.errstate(invalid="ignore"):
        people[~(np.abs(people) < MOST_PIXELS).all(-1)] = np.nan
    return people[np.isfinite(people).all(-1).any(-1)]


def read_piece(file: Path) -> Iterator[np.ndarray | None]:
    """Yield the people (D, J, 3) of each image of a piece; None for one that cannot be read."""
    arrays = read_arrays(file, "detections of some pictures", ("readable", "counts", "people"))
    ends = np.cumsum(arrays["counts"])
    for readable, start, end in zip(arrays["readable"], ends - arrays["counts"], ends, strict=True):
        yield arrays["people"][start:end] if readable else None
