"""Output of detections: their skeleton, with or without images; 2D keypoints for cameras without a calibration."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np

from dmae.data.clip import Detections2D
from dmae.data.conversion import convert_detections
from dmae.data.skeleton import COCO17
from dmae.detection.recording import Recording
from dmae.files.contents import write_atomic
from dmae.formats.openpose import write_detections


class FlatFormat(StrEnum):
    """Format of 2D keypoints."""

    openpose = "openpose"
    """A folder for each camera, a file for each of its frames; a file for each photograph."""
    coco = "coco"
    """A file for each camera, or for all photographs, keypoints of COCO."""


@dataclass(frozen=True)
class OutputConfig:
    """How detections are written."""

    skeleton: str | None = None
    """Skeleton to convert detections to, as body25; by default that of the detector."""
    images: bool = True
    """Whether the clip contains the images: the videos are linked, or encoded again if their size or frames differ from
    those of the clip. Of photographs: whether they are also written with the people drawn over them."""
    format: FlatFormat = field(default=FlatFormat.openpose)
    """Format of 2D keypoints, which are written without a calibration."""


def write_flat(recording: Recording, detections: Detections2D, config: OutputConfig, out: Path) -> None:
    """Write detections of cameras without a calibration.

    Args:
        recording: The videos.
        detections: (F, V, D, J), in pixels of the images.
        config: Format.
        out: Folder.
    """
    names = tuple(camera.name for camera in recording.cameras)
    if config.format == FlatFormat.openpose:
        write_detections(detections, names, out)
        return
    if config.skeleton is None:
        detections = convert_detections(detections, COCO17)
    for view, (name, camera) in enumerate(zip(names, recording.cameras, strict=True)):
        frames = range(len(detections.xy))
        entries = [(frame, view, f"{name}/{frame:06d}.jpg", camera.size) for frame in frames]
        write_atomic(out / f"{name}.json", json.dumps(coco(detections, entries)))


def coco(detections: Detections2D, entries: Sequence[tuple[int, int, str, tuple[int, int]]]) -> dict:
    """Return detections as COCO's keypoints: category 1, the number of the entry as `image_id`.

    Args:
        detections: (F, V, D, J).
        entries: Frame, view, name and size of each image.
    """
    skeleton, annotations = detections.skeleton, []
    images = [
        {"id": image, "file_name": name, "width": size[0], "height": size[1]}
        for image, (_, _, name, size) in enumerate(entries)
    ]
    there = detections.observed.any(-1)
    people = [
        (image, frame, view, number)
        for image, (frame, view, _, _) in enumerate(entries)
        for number in np.flatnonzero(there[frame, view])
    ]
    for image, frame, view, number in people:
        xy, score = detections.xy[frame, view, number], detections.score[frame, view, number]
        known = ~np.isnan(score)
        low, high = xy[known].min(0), xy[known].max(0)
        keypoints = np.where(known[:, None], np.column_stack([xy, score]), 0)
        annotations.append(
            {
                "id": len(annotations) + 1,
                "image_id": image,
                "category_id": 1,
                "keypoints": [round(float(value), 3) for value in keypoints.ravel()],
                "num_keypoints": int(known.sum()),
                "bbox": [round(float(value), 2) for value in (*low, *(high - low))],
                "area": round(float(np.prod(high - low)), 1),
                "iscrowd": 0,
                "score": round(float(score[known].mean()), 4),
            }
        )
    bones = [[a + 1, b + 1] for a, b in skeleton.bones]
    category = {"id": 1, "name": "person", "keypoints": list(skeleton.joints), "skeleton": bones}
    return {"images": images, "annotations": annotations, "categories": [category]}
