"""COCO keypoints: images and annotations of all cameras in one JSON file, or one JSON file per camera."""

import json
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain, islice
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, BinaryIO

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import SKELETONS, Skeleton
from dmae.files.checks import MOST_PIXELS, check_numbers
from dmae.files.contents import check_vacant, whole_folder, write_atomic
from dmae.files.structured import read_json
from dmae.formats.calibrations import write_calibration
from dmae.formats.labelled_images import LabelledImage, PersonLabel, detected_images, joint_labels, read_labelled_images
from dmae.formats.openpose import CALIBRATION
from dmae.formats.poses import covariance_entry
from dmae.formats.recordings import NumberedDetections, People, by_name, frame_number
from dmae.formats.registry import pose_writer, reader, recording_writer
from dmae.formats.skeletons import bare, default_skeleton
from dmae.formats.writing import exported_poses
from dmae.progress import progress

_SIDES = {"l_": "left_", "r_": "right_"}


def joint_names(skeleton: Skeleton) -> list[str]:
    """Return the names of joints as COCO writes them, left_eye for example."""
    names = []
    for joint in skeleton.joints:
        part, dot, name = joint.rpartition(".")
        names.append(part + dot + _SIDES.get(name[:2], name[:2]) + name[2:])
    return names


def category_joints(file: Path, categories) -> list[str] | None:
    """Return the names of the joints from the only category with keypoints; None if no category has keypoints."""
    if not isinstance(categories, list) or not all(isinstance(category, dict) for category in categories):
        raise ValueError(f"{file}: expected a list of categories, found {categories!r:.60}")
    named = [category["keypoints"] for category in categories if category.get("keypoints")]
    if len(named) > 1:
        raise ValueError(f"{file}: expected one category with keypoints, found {len(named)}")
    return [*map(str, named[0])] if named else None


def recognise_skeleton(path: Path, names: list[str] | None, joints: int | None) -> Skeleton:
    """Return the skeleton with the joints that a category names, or else the default for a number of joints.

    Raises ValueError, with the path, if no skeleton has these joints.
    """
    for skeleton in SKELETONS.values():
        if names and [*map(bare, names)] == [*map(bare, skeleton.joints)]:
            return skeleton
    if names:
        raise ValueError(
            f"{path}: no skeleton has the keypoints {names}; there are {sorted(SKELETONS)}, data.skeleton=... names "
            "the one to take them for"
        )
    if joints is None:
        raise ValueError(f"{path}: no keypoints in any annotation, and no category that names them")
    return default_skeleton(path, joints)


def image_entry(image: LabelledImage, number: int, file_name: str) -> dict:
    """Return the entry of an image, with the additional keys `camera` and `frame`."""
    width, height = image.size
    return {
        "id": number,
        "width": width,
        "height": height,
        "file_name": file_name,
        "camera": image.camera,
        "frame": image.number,
    }


def annotation_entry(person: PersonLabel, number: int, image: int) -> dict:
    """Return the entry of an annotation, to 0.001 px. `docs/reference/exports.md` lists the additional keys."""
    box = [0, 0, 0, 0] if person.box is None else list(person.box)
    entry: dict[str, Any] = {
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
    if person.cause is not None and person.occluder is not None:
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


def write_json(path: Path, info: dict, skeleton: Skeleton, images: Iterable[LabelledImage], folder: str = "") -> None:
    """Write images, `file_name` `folder` + `<camera>/<frame>.jpg`, and persons as JSON, one image at a time."""
    with TemporaryFile(prefix="dmae-") as annotations:
        write_atomic(Path(path), _pieces(info, skeleton, images, folder, annotations))


def _pieces(
    info: dict, skeleton: Skeleton, images: Iterable[LabelledImage], folder: str, annotations: BinaryIO
) -> Iterator[bytes]:
    """Yield the JSON in pieces. Annotations follow all images, so they are first written to a temporary file."""
    yield f'{{"info": {json.dumps(info)}, "images": ['.encode()
    labelled = 0
    for number, image in enumerate(images, 1):
        entry = image_entry(image, number, f"{folder}{image.path}.jpg")
        yield f"{', ' if number > 1 else ''}{json.dumps(entry)}".encode()
        for person in image.persons:
            labelled += 1
            entry = annotation_entry(person, labelled, number)
            annotations.write(f"{', ' if labelled > 1 else ''}{json.dumps(entry)}".encode())
    yield b'], "annotations": ['
    annotations.seek(0)
    yield from iter(partial(annotations.read, 1 << 20), b"")
    yield f'], "categories": {json.dumps([category_entry(skeleton)])}}}'.encode()


KEYPOINTS = "keypoints.json"
_FOLDERS = ("keypoints", "annotations")
HIDDEN_SCORE = 0.5
"""Confidence of a joint that is labelled but not visible (v = 1), in files without confidences; visible ones get 1."""
_FRAMES = 512  # Number of frames that are written at a time, for clips without images
_Id = int | str  # Type of the ids of images


@reader(
    "coco",
    signs=[["*keypoints*.json"], ["annotations*.json"], ["coco*.json"], ["keypoints/*.json"], ["annotations/*.json"]],
    file="*.json",
    general=True,
    cameras=False,
)
def read_detections(path: Path, *, skeleton: Skeleton | None = None) -> NumberedDetections:
    """COCO keypoints in one JSON for all cameras or one JSON per camera, with a calibration of any format.

    Read the annotations of a file, or of all files of a folder, or of `keypoints` or `annotations` in it, except
    calibrations.

    In a single file, each image states its `camera`, or its `file_name` contains a folder named after the camera. Each
    of several files contains the camera that it is named after, and may be only a list of results. The number of a
    frame is the `frame` of the image, or else the last number in its `file_name`. The confidence of a joint is its
    value in `keypoint_scores`, or else v of x, y, v. If all v are 0, 1 or 2, they mean absent, `HIDDEN_SCORE`, and 1.

    Args:
        skeleton: By default the one with the joints that the category names, or else by the number of joints.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: a file is malformed or contradicts itself; the message names the file and the entry.
    """
    path = Path(path)
    inside = [by_name((path / folder).glob("*.json")) for folder in _FOLDERS]
    files = [path] if path.is_file() else next(filter(None, inside), by_name(path.glob("*.json")))
    files = [file for file in files if "calib" not in file.name.lower()]
    if not files:
        raise FileNotFoundError(
            f"{path}: expected COCO annotations, *.json, found none; name them by data.detections=..."
        )
    people, fps, names = People(skeleton=skeleton), None, None
    contents = ((file, read_json(file)) for file in progress(files, "reading files"))
    if len(files) > 1:
        # Others are of cameras, or settings.
        ours = {"images", "annotations"}
        contents = (each for each in contents if not isinstance(each[1], dict) or ours & set(each[1]))
    # One after the other: all of them may not fit into memory.
    first = [*islice(contents, 2)]
    for file, content in chain(first, contents):
        images, annotations = _parts(file, content)
        camera = file.stem if len(first) > 1 else None
        if images is None:
            if camera is None:
                raise ValueError(f"{file}: expected a file for each camera where files are lists of results, found one")
            images = _result_images(file, annotations)
        elif "categories" in content:
            names = category_joints(file, content["categories"]) or names
        _add_people(file, annotations, _places(file, images, camera, people), people)
        about = content.get("info") if isinstance(content, dict) else None
        fps = fps or (about.get("fps") if isinstance(about, dict) else None)
    skeleton = skeleton or recognise_skeleton(path, names, people.joints)
    if people.joints not in (None, len(skeleton)):
        raise ValueError(f"{path}: expected {len(skeleton)} keypoints as of {skeleton.name}, found {people.joints}")
    return people.detections(skeleton, fps=fps)


def _parts(file: Path, content) -> tuple[list | None, list]:
    """Return images and annotations; images are None if the file is only a list of results."""
    if isinstance(content, list):
        return None, content
    parts: list[Any] = [content.get(key) if isinstance(content, dict) else None for key in ("images", "annotations")]
    if not all(isinstance(part, list) for part in parts):
        raise ValueError(f"{file}: expected lists of images and annotations, found {content!r:.60}")
    return parts[0], parts[1]


def _result_images(file: Path, results: list) -> list[dict]:
    ids = []
    for number, result in enumerate(results):
        if not isinstance(result, dict) or not isinstance(result.get("image_id"), _Id):
            raise ValueError(
                f"{file}: [{number}]: expected an object with image_id and keypoints, found {result!r:.60}"
            )
        ids.append(result["image_id"])
    return [{"id": image, "file_name": str(image)} for image in dict.fromkeys(ids)]


def _places(file: Path, images: list, camera: str | None, people: People) -> dict[_Id, tuple[str, int]]:
    """Return camera and frame of each image by its id; add frames and sizes of images to `people`."""
    places: dict = {}
    for number, image in enumerate(images):
        if not isinstance(image, dict) or not isinstance(image.get("id"), _Id) or "file_name" not in image:
            raise ValueError(f"{file}: images[{number}]: expected an object with id and file_name, found {image!r:.60}")
        name = Path(str(image["file_name"]))
        view = image.get("camera") or camera or name.parent.name
        if not view:
            raise ValueError(
                f"{file}: images[{number}]: nothing states the camera of {name}; expected `camera`, a folder in "
                "file_name, or a file of annotations for each camera"
            )
        frame = image["frame"] if "frame" in image else frame_number(Path(f"{file}, {name}"), name.stem)
        if type(frame) is not int:
            raise ValueError(f"{file}: images[{number}]: expected a whole number as frame, found {frame!r:.60}")
        if image["id"] in places or frame in people.views.get(str(view), ()):
            raise ValueError(f"{file}: images[{number}]: image {image['id']}, frame {frame} of {view}, occurs twice")
        places[image["id"]] = str(view), frame
        people.frame(str(view), frame)
        people.image(str(view), f"{file}: images[{number}]", image)
    return places


def _add_people(file: Path, annotations: list, places: dict[_Id, tuple[str, int]], people: People) -> None:
    found, bare = [], []
    for number, annotation in enumerate(annotations):
        here = f"{file}: annotations[{number}]"
        image = annotation.get("image_id") if isinstance(annotation, dict) else None
        if not isinstance(image, _Id) or image not in places:
            raise ValueError(
                f"{here}: expected an object with the image_id of one of the images, found {annotation!r:.60}"
            )
        keypoints = annotation.get("keypoints")
        if annotation.get("iscrowd") or not keypoints:
            continue
        values = _numbers(f"{here}.keypoints", keypoints, 3)
        scores = annotation.get("keypoint_scores")
        if scores is not None:
            scores = _numbers(f"{here}.keypoint_scores", scores, 1)[:, 0]
            if len(scores) != len(values):
                raise ValueError(f"{here}.keypoint_scores: expected {len(values)}, found {len(scores)}")
            values[:, 2] = np.where(values[:, 2] == 0, 0, scores)
        else:
            bare.append(values[:, 2])
        found.append((*places[image], f"{here}.keypoints", values))
    if bare and np.isin(np.concatenate(bare), (0, 1, 2)).all():
        for third in bare:
            third[:] = np.choose(third.astype(int), (0, HIDDEN_SCORE, 1))
    for person in found:
        people.add(*person)


def _numbers(place: str, found, each: int) -> np.ndarray:
    try:
        array = np.array(found, np.float64).reshape(-1, each)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{place}: expected a list of numbers, {each} for each joint, found {found!r:.60}") from None
    check_numbers(place, array, MOST_PIXELS)
    return array


@pose_writer("coco", errors=True)
def write_coco_poses(poses: Poses3D, clip: Clip, path: Path) -> None:
    """COCO keypoints of poses as the cameras see them, with the images and masks of the clip, if it has them.

    The images are written into a folder next to the file, `<name>_images`. A clip without colour images has no such
    folder: `info.images` is then false, and `file_name` only states camera and frame.
    """
    info, clip = clip_entry(clip), clip.without_lost_images()
    if not clip.has_images:
        write_json(path, info | {"images": False}, poses.skeleton, _without_colour(clip, poses.skeleton))
        return
    labels = joint_labels(clip, exported_poses(clip), poses.skeleton)
    folder = path.with_name(f"{path.stem}_images")
    check_vacant(folder, "the images")
    with whole_folder(folder) as partial:

        def written() -> Iterator[LabelledImage]:
            for image in progress(read_labelled_images(clip, labels), "writing images", len(clip) * len(clip.rig)):
                file = partial / f"{image.path}.jpg"
                file.parent.mkdir(exist_ok=True)
                file.write_bytes(image.encoded("jpg"))
                yield replace(image, rgb=None)

        images = _in_order(written())
    write_json(path, info | {"images": True}, poses.skeleton, images, f"{folder.name}/")


def _without_colour(clip: Clip, skeleton: Skeleton) -> Iterator[LabelledImage]:
    """Yield the images of a clip by frame and view, without colour; at most `_FRAMES` at a time without images."""
    first, cov = clip.provenance.get("first_frame", 0), exported_poses(clip).cov
    stated = np.isfinite(cov).any()
    step = _FRAMES if clip.images is None else max(len(clip), 1)
    for start in range(0, len(clip), step):
        part = clip.select(frames=slice(start, start + step))
        part = replace(part, provenance=clip.provenance | {"first_frame": first + start})
        labels = joint_labels(part, exported_poses(part), skeleton)
        if stated and labels.cov is None and labels.cause is None:
            labels = replace(labels, cov=np.full((*labels.flags.shape, 3), np.nan))
        yield from _in_order(read_labelled_images(part, labels))


def _in_order(images: Iterable[LabelledImage]) -> list[LabelledImage]:
    return sorted(images, key=lambda image: (image.frame, image.view))


@recording_writer("coco")
def write_coco(clip: Clip, path: Path) -> None:
    """COCO keypoints of the detections, with a Pose2Sim calibration."""
    write_calibration(clip.rig, path / CALIBRATION, "pose2sim")
    info = {"fps": clip.fps, "images": False}
    write_json(path / KEYPOINTS, info, clip.detections.skeleton, detected_images(clip))
