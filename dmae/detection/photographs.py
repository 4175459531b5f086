"""Photographs that do not belong together: people are detected in each by itself, and written as 2D keypoints."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from dmae.data.clip import Detections2D
from dmae.data.conversion import convert_detections
from dmae.data.skeleton import COCO17
from dmae.detection.output import FlatFormat, OutputConfig, coco
from dmae.detection.pictures import CameraPictures, pictures_in, read_files
from dmae.detection.pipeline import detect_people, make_detector, to_detections
from dmae.detection.recording import output_skeleton
from dmae.detection.registry import PoseDetectorConfig
from dmae.files.checks import PICTURES, child
from dmae.files.contents import write_atomic
from dmae.files.pictures import read_upright, upright_size
from dmae.formats.openpose import write_people
from dmae.progress import progress
from dmae.reporting.words import counted
from dmae.viewing.canvas import Mark, draw_line, draw_mark, person_colour

KEYPOINTS, DRAWN = "keypoints.json", "drawn"
"""COCO's file of all photographs; folder of the photographs with the people drawn over them."""
_LISTED = 5
_THIN = 400
"""Pixels of the longer side of a photograph for each pixel of the width of a line."""
_QUALITY = 90


@dataclass(frozen=True)
class Photographs:
    """Photographs, each of its own size.

    Attributes:
        cameras: N, each with one image.
        notes: On files that are left out.
    """

    cameras: tuple[CameraPictures, ...]
    notes: tuple[str, ...]


def find_photographs(path: Path) -> Photographs:
    """Return the photographs of a folder, or a single one.

    Raises:
        FileNotFoundError: there are none.
        ValueError: not one can be read, or two have the same name with different suffixes.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"photos={path}: no such folder")
    files = [path] if path.is_file() else pictures_in(path)
    if not files:
        raise FileNotFoundError(f"photos={path}: expected photographs ({', '.join(PICTURES)}), found none")
    stems = [file.stem.lower() for file in files]
    if twice := [file.name for file in files if stems.count(file.stem.lower()) > 1]:
        raise ValueError(f"photos={path}: expected photographs of different names, found {', '.join(twice[:_LISTED])}")
    cameras, damaged = [], []
    for file in files:
        try:
            size = upright_size(file)
        except ValueError as error:
            damaged.append(str(error))
            continue
        cameras.append(CameraPictures(file.name, file, size, np.zeros(1), None, partial(read_files, [file])))
    if not cameras:
        raise ValueError(f"photos={path}: not one photograph can be read; {damaged[0]}")
    return Photographs(tuple(cameras), tuple(f"left out: {why}" for why in damaged))


def detect_photographs(
    photographs: Photographs,
    config: PoseDetectorConfig,
    pieces: Path,
    skeleton: str | None = None,
    workers: int = 1,
) -> tuple[Detections2D, tuple[str, ...]]:
    """Return the people of N photographs, (1, N, D, J), and notes on them.

    All windows of each photograph are searched. Other arguments and errors are those of
    `dmae.detection.recording.detect_recording`.
    """
    target, own = output_skeleton(skeleton), make_detector(config).skeleton
    found = detect_people(photographs.cameras, replace(config, search_every=1), pieces, workers)
    each = [found[camera.name] for camera in photographs.cameras]
    detections = to_detections(each, [np.zeros(1, int)] * len(each), 1, own)
    unreadable = [name for name, one in found.items() if one.unreadable]
    empty = [name for name, one in found.items() if not one.unreadable and not len(one.people[0])]
    notes = [f"no people detected in {_listed(empty)}"] if empty else []
    notes += [f"left out, cannot be read: {_listed(unreadable)}"] if unreadable else []
    return convert_detections(detections, target or own), tuple(notes)


def write_photographs(photographs: Photographs, detections: Detections2D, config: OutputConfig, out: Path) -> None:
    """Write the people of photographs.

    Args:
        photographs: N.
        detections: (1, N, D, J), in pixels of the photographs.
        config: Its format, and whether photographs are written with the people drawn over them.
        out: Folder; in OpenPose's format of a file `<photograph>_keypoints.json` for each, in COCO's of one for all.
    """
    cameras = photographs.cameras
    if config.format == FlatFormat.openpose:
        for number, camera in enumerate(cameras):
            write_people(detections, 0, number, child(out, f"{camera.path.stem}_keypoints.json", "photograph"))
    else:
        if config.skeleton is None:
            detections = convert_detections(detections, COCO17)
        entries = [(0, number, camera.name, camera.size) for number, camera in enumerate(cameras)]
        write_atomic(out / KEYPOINTS, json.dumps(coco(detections, entries)))
    if config.images:
        (out / DRAWN).mkdir(exist_ok=True)
        for number, camera in enumerate(progress(cameras, "drawing", len(cameras))):
            _draw(camera.path, detections, number, child(out / DRAWN, f"{camera.path.stem}.jpg", "photograph"))


def _draw(path: Path, detections: Detections2D, number: int, to: Path) -> None:
    """Write a photograph with its people, those of low confidence included."""
    try:
        canvas = read_upright(path)
    except ValueError:
        return
    thick = max(1, round(max(canvas.shape[:2]) / _THIN))
    for person, joints in enumerate(detections.xy[0, number].astype(np.float64)):
        known, colour = np.isfinite(joints).all(-1), person_colour(person)
        for bone in detections.skeleton.bones:
            if known[list(bone)].all():
                draw_line(canvas, joints[list(bone)], colour, thick, outlined=True)
        for joint in np.flatnonzero(known):
            draw_mark(canvas, joints[joint], Mark.DISC, colour, max(1, thick // 2))
    encoded = cv2.imencode(".jpg", canvas[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    write_atomic(to, encoded.tobytes())


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _LISTED} others" if len(names) > _LISTED else ""
    return f"{counted(len(names), 'photograph')}: {', '.join(names[:_LISTED])}{more}"
