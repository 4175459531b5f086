"""COCO keypoints: images and annotations of all cameras in one JSON file, or one JSON file per camera."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.data.store import check_vacant, whole_folder
from dmae.files.mapped import frame_blocks
from dmae.files.numbers import MOST_PIXELS, check_numbers
from dmae.files.structured import read_json
from dmae.formats.calibrations.files import FOUND, CalibrationSource, write_calibration
from dmae.formats.labelled_images.coco_entries import clip_entry, write_json
from dmae.formats.labelled_images.joints import joint_labels
from dmae.formats.labelled_images.pictures import Picture, array_pictures, read_pictures
from dmae.formats.openpose import CALIBRATION
from dmae.formats.recordings.camera_matching import frame_number, natural
from dmae.formats.recordings.coco_categories import category_joints, recognise_skeleton
from dmae.formats.recordings.confidences import Confidences
from dmae.formats.recordings.numbered_detections import NumberedDetections, with_cameras
from dmae.formats.registry import pose_writer, reader, recording_writer
from dmae.formats.writing import exported_poses
from dmae.progress import progress

KEYPOINTS = "keypoints.json"
HIDDEN_SCORE = 0.5
"""Confidence of a joint that is labelled but not visible (v = 1), in files without confidences; visible ones get 1."""
_FRAMES = 512
"""Number of frames that are written at a time, for clips without images."""
_Id = int | str
"""Type of the ids of images."""


@dataclass
class _Found:
    """The content of the files that were read so far: people by camera and frame number, image sizes by camera."""

    views: dict[str, dict[int, list]] = field(default_factory=dict)
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)
    fps: float | None = None
    names: list[str] | None = None
    joints: int | None = None
    confidences: Confidences = field(default_factory=Confidences)


@reader(
    "coco",
    signs=[["*keypoints*.json"], ["annotations*.json"], ["coco*.json"]],
    file="*.json",
    general=True,
)
def read_coco(
    path: Path,
    *,
    calibration: CalibrationSource = FOUND,
    detections: Path | None = None,
    fps: float | None = None,
    skeleton: Skeleton | None = None,
) -> Clip:
    """COCO keypoints in one JSON for all cameras or one JSON per camera, with a calibration of any format.

    Args:
        path: The recording, or its file of annotations.
        calibration: Path of the calibration, and the values that its file does not state.
        detections: File or folder of the annotations; by default `path`.
        fps: Frames per second, if `info` does not state it.
        skeleton: As in `read_detections`.

    Raises:
        FileNotFoundError, ValueError: as `read_detections` and `with_cameras`.
    """
    return with_cameras(read_detections(detections or path, skeleton), path, calibration, fps)


def read_detections(path: Path, skeleton: Skeleton | None = None) -> NumberedDetections:
    """Read the annotations of a file, or of all files of a folder except calibrations.

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
    files = [path] if path.is_file() else sorted(path.glob("*.json"), key=lambda file: natural(file.name))
    files = [file for file in files if "calib" not in file.name.lower()]
    if not files:
        raise FileNotFoundError(
            f"{path}: expected COCO annotations, *.json, found none; name them by data.detections=..."
        )
    found = _Found()
    for file in files:
        content = read_json(file)
        images, annotations = _parts(file, content)
        camera = file.stem if len(files) > 1 else None
        if images is None:
            if camera is None:
                raise ValueError(f"{file}: expected a file for each camera where files are lists of results, found one")
            images = _result_images(file, annotations)
        elif "categories" in content:
            found.names = category_joints(file, content["categories"]) or found.names
        places = _images(file, images, camera, found)
        _annotations(file, annotations, places, found)
        about = content.get("info") if isinstance(content, dict) else None
        found.fps = found.fps or (about.get("fps") if isinstance(about, dict) else None)
    skeleton = skeleton or recognise_skeleton(path, found.names, found.joints)
    if found.joints not in (None, len(skeleton)):
        raise ValueError(f"{path}: expected {len(skeleton)} keypoints as of {skeleton.name}, found {found.joints}")
    empty = np.empty((0, len(skeleton), 3))
    views = {name: {n: np.array(people or empty) for n, people in view.items()} for name, view in found.views.items()}
    return NumberedDetections(skeleton, views, found.fps, notes=found.confidences.notes, sizes=found.sizes)


def _parts(file: Path, content) -> tuple[list | None, list]:
    """Return images and annotations; images are None if the file is only a list of results."""
    if isinstance(content, list):
        return None, content
    parts = [content.get(key) if isinstance(content, dict) else None for key in ("images", "annotations")]
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


def _images(file: Path, images: list, camera: str | None, found: _Found) -> dict:
    """Return an empty list of people for each image id. `found.views` contains the same lists, by camera and frame."""
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
        frames = found.views.setdefault(str(view), {})
        if image["id"] in places or frame in frames:
            raise ValueError(f"{file}: images[{number}]: image {image['id']}, frame {frame} of {view}, occurs twice")
        places[image["id"]] = frames[frame] = []
        if "width" in image and "height" in image:
            size = image["width"], image["height"]
            first = found.sizes.setdefault(str(view), size)
            if first != size:
                raise ValueError(f"{file}: images[{number}]: expected {first} px as before of {view}, found {size}")
    return places


def _annotations(file: Path, annotations: list, places: dict, found: _Found) -> None:
    """Add the people in the annotations to the lists in `places`, which are given by image id."""
    people, scored = [], []
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
        found.joints = found.joints or len(values)
        if len(values) != found.joints:
            raise ValueError(f"{here}.keypoints: expected {found.joints} as before, found {len(values)}")
        scores = annotation.get("keypoint_scores")
        if scores is not None:
            scores = _numbers(f"{here}.keypoint_scores", scores, 1)[:, 0]
            if len(scores) != len(values):
                raise ValueError(f"{here}.keypoint_scores: expected {len(values)}, found {len(scores)}")
            values[:, 2] = np.where(values[:, 2] == 0, 0, scores)
        scored.append(scores is not None)
        people.append((f"{here}.keypoints", places[annotation["image_id"]], values))
    bare = [values[:, 2] for (*_, values), known in zip(people, scored, strict=True) if not known]
    if bare and np.isin(bare, (0, 1, 2)).all():
        for third in bare:
            third[:] = np.choose(third.astype(int), (0, HIDDEN_SCORE, 1))
    for here, place, values in people:
        values = found.confidences.clean(here, values)
        if not np.isnan(values).all():
            place.append(values)


def _numbers(place: str, found, each: int) -> np.ndarray:
    try:
        array = np.array(found, np.float64).reshape(-1, each)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{place}: expected a list of numbers, {each} for each joint, found {found!r:.60}") from None
    check_numbers(place, array, MOST_PIXELS)
    return array


def write_annotations(
    path: Path,
    rig: CameraRig,
    fps: float,
    skeleton: Skeleton,
    xy: np.ndarray,
    flags: np.ndarray,
    *,
    scores: np.ndarray | None = None,
    sources: np.ndarray | None = None,
    first: int = 0,
) -> None:
    """Write people as annotations, to 0.001 px: one image per camera and frame, one annotation per person in it.

    Additional keys: `camera` and `frame` of images, `fps` of `info`, and of annotations `keypoint_scores` if `scores`
    are given, and `joint_source` and `track_id`, the index of the person, if `sources` are given.

    Args:
        xy: (F, V, D, J, 2) px.
        flags: (F, V, D, J) 0 not labelled, 1 hidden or not measured, 2 visible.
        scores: (F, V, D, J) confidences.
        sources: (F, D, J) `Source`. The D detections are then persons with the same index in all frames.
        first: Number of the first frame.
    """
    pictures = array_pictures(rig, xy, flags, scores=scores, sources=sources, first=first)
    write_json(path, {"fps": fps, "pictures": False}, skeleton, pictures)


@pose_writer("coco")
def write_coco_poses(poses: Poses3D, clip: Clip, path: Path) -> None:
    """COCO keypoints of poses as the cameras see them, with the images and masks of the clip, if it has them.

    The images are written into a folder next to the file, `<name>_images`. A clip without colour images has no such
    folder: `info.pictures` is then false, and `file_name` only states camera and frame.
    """
    info = clip_entry(clip)
    if clip.images is None or "rgb" not in clip.images.kinds:
        write_json(path, info | {"pictures": False}, poses.skeleton, _without_colour(clip, poses.skeleton))
        return
    labels = joint_labels(clip, exported_poses(clip), poses.skeleton)
    folder = path.with_name(f"{path.stem}_images")
    check_vacant(folder, "the pictures")
    with whole_folder(folder) as partial:

        def written() -> Iterator[Picture]:
            for picture in progress(read_pictures(clip, labels), "writing pictures", len(clip) * len(clip.rig)):
                file = partial / f"{picture.path}.jpg"
                file.parent.mkdir(exist_ok=True)
                file.write_bytes(picture.encoded("jpg"))
                yield replace(picture, rgb=None)

        pictures = _in_order(written())
    write_json(path, info | {"pictures": True}, poses.skeleton, pictures, f"{folder.name}/")


def _without_colour(clip: Clip, skeleton: Skeleton) -> Iterator[Picture]:
    """Yield the pictures of a clip by frame and view, without colour; at most `_FRAMES` at a time without images."""
    first, cov = clip.provenance.get("first_frame", 0), exported_poses(clip).cov
    stated = any(np.isfinite(cov[part]).any() for part in frame_blocks(cov))
    step = _FRAMES if clip.images is None else max(len(clip), 1)
    for start in range(0, len(clip), step):
        part = clip.select(frames=slice(start, start + step))
        part = replace(part, provenance=clip.provenance | {"first_frame": first + start})
        labels = joint_labels(part, exported_poses(part), skeleton)
        if stated and labels.cov is None and labels.cause is None:
            labels = replace(labels, cov=np.full((*labels.flags.shape, 3), np.nan))
        yield from _in_order(read_pictures(part, labels))


def _in_order(pictures: Iterable[Picture]) -> list[Picture]:
    return sorted(pictures, key=lambda picture: (picture.frame, picture.view))


@recording_writer("coco")
def write_coco(clip: Clip, path: Path) -> None:
    """COCO keypoints of the detections, with a Pose2Sim calibration."""
    write_calibration(clip.rig, path / CALIBRATION, "pose2sim")
    found, first = clip.detections, clip.provenance.get("first_frame", 0)
    flags = np.where(found.observed, 2, 0)
    file = path / KEYPOINTS
    write_annotations(file, clip.rig, clip.fps, found.skeleton, found.xy, flags, scores=found.score, first=first)
