"""Entries of a COCO file: images, annotations and categories."""

import json
from collections.abc import Iterable, Iterator
from functools import partial
from pathlib import Path
from tempfile import TemporaryFile
from typing import BinaryIO

import numpy as np

from dmae.data.clip import Clip
from dmae.data.skeleton import Skeleton
from dmae.data.store import write_atomic
from dmae.formats.labelled_images.pictures import PersonLabel, Picture
from dmae.formats.recordings.coco_categories import joint_names
from dmae.formats.recordings.pixel_covariances import covariance_entry


def image_entry(picture: Picture, number: int, file_name: str) -> dict:
    """Return the entry of an image, with the additional keys `camera` and `frame`."""
    width, height = picture.size
    return {
        "id": number,
        "width": width,
        "height": height,
        "file_name": file_name,
        "camera": picture.camera,
        "frame": picture.number,
    }


def annotation_entry(person: PersonLabel, number: int, image: int) -> dict:
    """Return the entry of an annotation, to 0.001 px. `docs/reference/exports.md` lists the additional keys."""
    box = [0, 0, 0, 0] if person.box is None else list(person.box)
    entry = {
        "id": number,
        "image_id": image,
        "category_id": 1,
        "iscrowd": 0,
        "bbox": box,
        "bbox_of": "pixels" if person.visible_pixels else "joints",
        "area": person.area,
        "segmentation": [] if person.mask is None else person.mask,
        "num_keypoints": int((person.flags > 0).sum()),
        "keypoints": keypoints(person),
    }
    if person.scores is not None:
        known = np.where(person.flags > 0, person.scores, 0).astype(np.float64)
        entry["keypoint_scores"] = known.round(4).tolist()
    if person.sources is not None:
        entry |= {"track_id": person.person, "joint_source": person.sources.tolist()}
    if person.cov is not None:
        entry["joint_covariance"] = covariance_entry(person.cov)
    if person.cause is not None:
        entry |= {"visibility": person.cause.tolist(), "hidden_by": person.occluder.tolist()}
    for name in ("visible_pixels", "amodal_pixels"):
        if getattr(person, name) is not None:
            entry[name] = getattr(person, name)
    if person.amodal_mask is not None:
        entry |= {"amodal_segmentation": person.amodal_mask, "amodal_bbox": list(person.amodal_box or (0, 0, 0, 0))}
    return entry


def keypoints(person: PersonLabel) -> list[float]:
    """Return x and y in px and v of all joints in one list; zeros for joints that are not in the image."""
    labelled = person.flags > 0
    points = np.where(labelled[:, None], person.xy.astype(np.float64), 0).round(3)
    return [
        value for (x, y), flag in zip(points.tolist(), person.flags.tolist(), strict=True) for value in (x, y, flag)
    ]


def category_entry(skeleton: Skeleton) -> dict:
    """Return the entry of the category `person`, with the joints and bones of a skeleton."""
    return {
        "id": 1,
        "name": "person",
        "supercategory": "person",
        "keypoints": joint_names(skeleton),
        "skeleton": [[parent + 1, child + 1] for parent, child in skeleton.bones],
    }


def clip_entry(clip: Clip) -> dict:
    """Return the `info` entry of a clip. `hidden_by` is an index of `objects` where `visibility` is 3."""
    return {"fps": clip.fps, "objects": list(clip.occlusion.objects) if clip.occlusion else []}


def write_json(path: Path, info: dict, skeleton: Skeleton, pictures: Iterable[Picture], folder: str = "") -> None:
    """Write pictures and their persons as one JSON file, with one picture in memory at a time.

    The `file_name` of an image is `folder` + `<camera>/<frame>.jpg`.
    """
    with TemporaryFile(prefix="dmae-") as annotations:
        write_atomic(Path(path), _pieces(info, skeleton, pictures, folder, annotations))


def _pieces(
    info: dict, skeleton: Skeleton, pictures: Iterable[Picture], folder: str, annotations: BinaryIO
) -> Iterator[bytes]:
    """Yield the JSON in pieces. Annotations follow all images, so they are first written to a temporary file."""
    yield f'{{"info": {json.dumps(info)}, "images": ['.encode()
    labelled = 0
    for number, picture in enumerate(pictures, 1):
        entry = image_entry(picture, number, f"{folder}{picture.path}.jpg")
        yield f"{', ' if number > 1 else ''}{json.dumps(entry)}".encode()
        for person in picture.persons:
            labelled += 1
            entry = annotation_entry(person, labelled, number)
            annotations.write(f"{', ' if labelled > 1 else ''}{json.dumps(entry)}".encode())
    yield b'], "annotations": ['
    annotations.seek(0)
    yield from iter(partial(annotations.read, 1 << 20), b"")
    yield f'], "categories": {json.dumps([category_entry(skeleton)])}}}'.encode()
