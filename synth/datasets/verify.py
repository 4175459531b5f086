"""Check clips and data sets: files, numbers, labels, detections and images, and that they agree with each other."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from itertools import repeat
from pathlib import Path
from typing import NamedTuple

import av
import numpy as np

from dmae.data.clip import Clip, Poses3D, person_name
from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.labels import DetectionLabels, JointError, OcclusionLabels, Visibility
from dmae.data.store import CHECKSUMS, MANIFEST, load_clip, read_manifest
from dmae.files.checksums import find_damage, find_data_set_damage, number_of
from dmae.files.structured import read_json
from dmae.progress import progress
from synth.datasets.clip import attempt_seed
from synth.datasets.config import image_kinds
from synth.datasets.generate import CONFIG
from synth.datasets.images import image_files
from synth.labels.surfaces import agreement

_MIN_AGREEMENT = 0.99
"""Least fraction of joints with a visibility that must agree with the id images, beyond statistical chance."""


def check_images(clip: Clip) -> list[str]:
    """Check that images exist, are readable and have the right size, and that ids and parts agree with the labels."""
    if clip.images is None:
        return []
    problems = []
    for view, name in enumerate(clip.rig.names):
        for kind in clip.images.kinds:
            try:
                problems += _check_view(clip, kind, view, name)
            except (OSError, ValueError, av.FFmpegError) as error:
                problems.append(f"{kind} of camera {name}: {error}")
        if "parts" in clip.images.kinds and not problems:
            problems += _check_parts(clip, name)
    if len(clip.images.frames) != len(clip):
        problems.append(f"{len(clip.images.frames)} frames of images, {len(clip)} of labels")
    if "ids" in clip.images.kinds and clip.occlusion is not None and not problems:
        compared, agreeing = (counts.sum() for counts in agreement(clip))
        expected = _MIN_AGREEMENT * compared
        deviation = np.sqrt(compared * _MIN_AGREEMENT * (1 - _MIN_AGREEMENT))
        if agreeing < expected - 3 * deviation:
            problems.append(f"visibility agrees with the ids at {agreeing} of {compared} joints, less than 99%")
    return problems


def _check_view(clip: Clip, kind: str, view: int, name: str) -> list[str]:
    """Check one kind of images of one view. The images are read once."""
    assert clip.images is not None
    width, height = clip.rig.size[view].tolist()
    occlusion = clip.occlusion
    # Without labels, the objects are unknown.
    ids_end = FIRST_OBJECT_ID + len(occlusion.objects) if occlusion else np.inf
    persons = clip.truth.xyz.shape[1] if clip.truth is not None else FIRST_OBJECT_ID - 1
    blank = []
    for frame, image in enumerate(clip.images.read(kind, name)):
        if image.shape[:2] != (height, width):
            found = f"{image.shape[1]} x {image.shape[0]}"
            return [f"{kind} of camera {name}: expected {width} x {height} px, found {found}"]
        if kind == "rgb" and image.min() == image.max():
            blank.append(frame)
        if kind != "ids":
            continue
        shown = np.bincount(image.ravel(), minlength=FIRST_OBJECT_ID)
        unknown = np.flatnonzero(shown)
        unknown = unknown[((unknown > persons) & (unknown < FIRST_OBJECT_ID)) | (unknown >= ids_end)]
        if len(unknown):
            return [f"ids of camera {name}, frame {frame}: {unknown[:5].tolist()} stand for no person and no object"]
        if occlusion is not None and occlusion.visible_pixels is not None:
            counted = occlusion.visible_pixels[frame, view]
            if not np.array_equal(shown[1 : 1 + len(counted)], counted):
                return [f"ids of camera {name}, frame {frame}: {shown[1 : 1 + len(counted)].tolist()} pixels show the "
                        f"persons, visible_pixels says {counted.tolist()}"]  # fmt: skip
    return [f"rgb of camera {name}: {len(blank)} frames of one colour, first {blank[0]}"] if blank else []


def _check_parts(clip: Clip, name: str) -> list[str]:
    """Check the body parts of one view: all have names, and only pixels of persons have a part."""
    assert clip.images is not None
    persons = clip.images.read("ids", name) if "ids" in clip.images.kinds else repeat(None)
    for frame, (parts, ids) in enumerate(zip(clip.images.read("parts", name), persons, strict=False)):
        if parts.max() > len(clip.images.parts):
            return [f"parts of camera {name}, frame {frame}: {parts.max()} is none of the "
                    f"{len(clip.images.parts)} parts that clip.json names"]  # fmt: skip
        if ids is not None:
            apart = np.count_nonzero((parts > 0) != ((ids > 0) & (ids < FIRST_OBJECT_ID)))
            if apart:
                return [f"parts of camera {name}, frame {frame}: {apart} pixels have a part but no person in the "
                        "ids, or a person but no part"]  # fmt: skip
    return []


def check_surplus(clip: Clip) -> Iterator[str]:
    """Check that the image folder of a clip contains no other files."""
    images = clip.images
    assert images is not None
    for path in sorted(images.folder.glob("rgb/*.mp4")) if "rgb" in images.kinds else ():
        # `check_images` reports unreadable videos.
        with suppress(OSError, IndexError, av.FFmpegError), av.open(str(path)) as container:
            count, expected = container.streams.video[0].frames, len(images.frames)
            if count > expected:
                yield f"rgb/{path.name}: expected {expected} frames, found {count}"
    found = {path for ending in ("png", "mp4", "jpg") for path in images.folder.rglob(f"*.{ending}")}
    surplus = sorted(found - image_files(images))
    if surplus:
        first = surplus[0].relative_to(images.folder)
        yield f"image files that do not belong to the clip: {len(surplus)}, first {first}"


# Checks of the numbers, labels and detections of a clip. Each check returns descriptions of the problems it finds.

_EDGE = 0.05
"""Tolerance of projections, px. It is needed because truth is stored in single precision."""
_NEAR_CAMERA = 1e-3
"""Tolerance of distances from the camera's plane, m, for the same reason."""
_FAR_OFF = 0.15
"""A detection is wrong if its median joint is farther than this from its person, in heights of the person. This is used
if a clip has no offsets of joints."""
_MAX_OFF = 0.05
"""Greatest fraction of wrong detections in a clip. Some are expected, because detectors make such errors."""


def check_numbers(clip: Clip) -> Iterator[str]:
    """Check that points are complete or NaN, and confidences from 0 to 1. `load_clip` refuses infinite numbers."""
    points = {"detections.xy": clip.detections.xy}
    points |= {f"{name}.xyz": poses.xyz for name in ("truth", "poses") if (poses := getattr(clip, name)) is not None}
    for name, array in points.items():
        torn = np.isnan(array).any(-1) != np.isnan(array).all(-1)
        if torn.any():
            yield f"{name}: {int(torn.sum())} points with some, but not all, coordinates NaN"
    with np.errstate(invalid="ignore"):
        beyond = (clip.detections.score < 0) | (clip.detections.score > 1)
    if beyond.any():
        yield f"detections.score: {int(beyond.sum())} confidences outside 0..1"


def check_labels(clip: Clip) -> list[str]:
    """Check that codes and occluders exist, and that margins are known for hidden joints and only for these."""
    wrong = {}
    if clip.occlusion is not None and clip.truth is not None:
        wrong |= _wrong_occlusion(clip.occlusion, clip.truth)
    if clip.detection_labels is not None:
        wrong |= _wrong_detection_labels(clip.detection_labels, clip.detections.observed)
    return [f"{what}: {int(found.sum())} of {found.size}" for what, found in wrong.items() if found.any()]


def _wrong_occlusion(labels: OcclusionLabels, truth: Poses3D) -> dict[str, np.ndarray]:
    code, wrong = labels.visibility, {}
    persons = truth.xyz.shape[1]
    absent = np.broadcast_to(np.isnan(truth.xyz).any(-1)[:, None], code.shape)
    wrong["visibility is not ABSENT exactly where the truth is NaN"] = (code == Visibility.ABSENT) != absent
    if labels.occluder is not None:
        by, person = labels.occluder, np.arange(persons)[:, None]
        others = (Visibility.HIDDEN_BY_PERSON, Visibility.HIDDEN_BY_OBJECT)
        own = np.broadcast_to(person, code.shape)
        least = np.select([code == Visibility.HIDDEN_BY_SELF, np.isin(code, others)], [own, 0], -1)
        ends = [persons - 1, len(labels.objects) - 1]
        greatest = np.select([code == other for other in others], ends, least)
        oneself = (code == Visibility.HIDDEN_BY_PERSON) & (by == person)
        wrong["occluder does not match visibility"] = (by < least) | (by > greatest) | oneself
    if labels.depth_margin is not None:
        hidden = (code >= Visibility.HIDDEN_BY_SELF) & (code <= Visibility.HIDDEN_BY_OBJECT)
        wrong["depth_margin is not known exactly where joints are hidden"] = np.isnan(labels.depth_margin) == hidden
        wrong["depth_margin is not positive"] = labels.depth_margin <= 0
    if labels.amodal_pixels is not None:
        wrong["visible_pixels exceed amodal_pixels"] = labels.visible_pixels > labels.amodal_pixels
    return wrong


def _wrong_detection_labels(labels: DetectionLabels, observed: np.ndarray) -> dict[str, np.ndarray]:
    wrong = {}
    for name, there in (("person", observed.any(-1)), ("joint_person", observed)):
        person = getattr(labels, name)
        if person is not None:
            wrong[f"{name} is set where nothing is detected"] = (person >= 0) & ~there
    if labels.error is not None:
        absent = labels.error == JointError.ABSENT
        wrong["error is not ABSENT exactly where nothing is detected"] = absent == observed
    return wrong


def check_projection(clip: Clip) -> list[str]:
    """Check that the projections of joints agree with their labels: in the image, outside it, or behind the camera."""
    if clip.occlusion is None or clip.truth is None:
        return []
    visibility = clip.occlusion.visibility
    rig = clip.actual_rig
    xy, depth = rig.project(clip.truth.xyz)
    size = rig.size[:, None, None]
    with np.errstate(invalid="ignore"):
        inside = ((xy >= -0.5 - _EDGE) & (xy <= size - 0.5 + _EDGE)).all(-1)
        well_inside = ((xy >= -0.5 + _EDGE) & (xy <= size - 0.5 - _EDGE)).all(-1)
        wrong = {
            "in an image project outside it": (visibility <= Visibility.HIDDEN_BY_OBJECT) & ~inside,
            "outside an image project into it": (visibility == Visibility.OUTSIDE_IMAGE) & well_inside,
            "outside an image are behind its camera": (visibility == Visibility.OUTSIDE_IMAGE)
            & (depth < -_NEAR_CAMERA),
            "behind a camera are before it": (visibility == Visibility.BEHIND_CAMERA) & (depth > _NEAR_CAMERA),
        }
    return [
        f"{int(found.sum())} joints labelled {what}, first in frame {at[0]}, camera {clip.rig.names[at[1]]}, "
        f"{person_name(at[2])}, joint {clip.truth.skeleton.joints[at[3]]}"
        for what, found in wrong.items()
        if found.any()
        for at in (np.argwhere(found)[0],)
    ]


def check_detections(clip: Clip) -> Iterator[str]:
    """Check that detections are inside their image, and near their person."""
    xy = clip.detections.xy
    outside = clip.detections.observed & ~clip.rig.inside(xy)
    if outside.any():
        yield f"{int(outside.sum())} detected joints lie outside their image"
    labels = clip.detection_labels
    if clip.truth is None or labels is None:
        return
    columns = clip.truth.skeleton.index_of_part(clip.detections.skeleton)
    if columns is None:
        return
    frame, view, place = np.nonzero(labels.person >= 0)
    true = clip.actual_rig.project(clip.truth.xyz[:, :, columns])[0][frame, view, labels.person[frame, view, place]]
    distance = np.linalg.norm(xy[frame, view, place] - true, axis=-1)
    if labels.offset_px is not None:
        wrong = np.abs(labels.offset_px[frame, view, place] - distance) > _EDGE
        if wrong.any():
            yield f"offset_px is not the distance from the true joint: {int(wrong.sum())} of {wrong.size}"
        return
    some = np.isfinite(distance).any(-1)
    height = np.ptp(np.where(np.isnan(true[some]), np.nanmean(true[some], 1, keepdims=True), true[some]), 1).max(-1)
    off = np.nanmedian(distance[some], -1) > _FAR_OFF * height
    if some.any() and off.mean() > _MAX_OFF:
        yield f"{off.mean():.0%} of the detections lie far from the person that they are labelled with"


# Verify clips and data sets: files, numbers, labels, images, and their consistency.

DATA_SET = "data set"
"""Name used in place of a clip for problems of the whole data set."""


class Problem(NamedTuple):
    """A problem: the folder name of its clip, or "data set"; the check of `CHECKS` that found it; and a description."""

    clip: str
    check: str
    what: str


class Verification(NamedTuple):
    """The result of a verification."""

    clips: list[str]  # Names of the checked folders
    problems: list[Problem]  # All problems
    again: list[str]  # Names of the clips that must be generated again
    number: str | None  # One checksum of all files: the SHA-256 of `checksums.json`; None if there is no such file
    # Names of the clips without checksums. In these, only changes that cause a contradiction are found.
    without: list[str]


def verify(path: Path, *, fast: bool = False) -> Verification:
    """Check a clip, or all clips of a data set and its manifest. If `fast`, compare only the sizes of files, and the
    contents of JSON files with their checksums. Raises FileNotFoundError if the path is neither."""
    path = Path(path)
    has_manifest = (path / MANIFEST).is_file()
    if (path / "clip.json").is_file() or ((path / "arrays.safetensors").is_file() and not has_manifest):
        return _result(path.parent, [path.name], verify_clip(path, fast=fast)[1], number_of(path))
    if not has_manifest and not (path / CHECKSUMS).is_file():
        raise FileNotFoundError(f"{path}: expected a clip (clip.json) or a data set ({MANIFEST}), found neither")
    lines, problems = _manifest(path)
    config, found = _config(path)
    names = [line["id"] for line in lines if line["status"] == "ok"]
    problems += found + [
        Problem(clip or DATA_SET, "checksums", what) for clip, what in find_data_set_damage(path, names)
    ]
    problems += [Problem(DATA_SET, "manifest", what) for what in _check_data_set(path, lines)]
    lost = {problem.clip for problem in problems}
    for line in progress(lines, "verifying clips", len(lines)):
        # Clips with known damage are not read.
        if line["status"] != "ok" or line["id"] in lost:
            continue
        clip, found = verify_clip(path / line["id"], fast=fast)
        problems += found
        if clip is not None:
            problems += [
                Problem(line["id"], "manifest", what)
                for what in _guarded("clip.json", lambda: _check_line(clip, line, config))  # noqa: B023
            ]
    return _result(path, names, problems, number_of(path))


def verify_clip(folder: Path, *, fast: bool = False) -> tuple[Clip | None, list[Problem]]:
    """Return a clip and its problems. The clip is None if it was not read."""
    damage = find_damage(folder, fast=fast)
    if damage:
        # All further problems would be consequences of the damage.
        return None, [Problem(folder.name, "checksums", what) for what in damage]
    if fast and ((folder / CHECKSUMS).is_file()):
        return None, []
    try:
        clip = load_clip(folder)
    except (FileNotFoundError, ValueError) as error:
        return None, [Problem(folder.name, "files", str(error))]
    except Exception as error:
        return None, [Problem(folder.name, "files", _error_text(folder / "clip.json", error))]
    if fast:
        return None, []
    problems = []
    for check, find in _OF_A_CLIP.items():
        problems += [Problem(folder.name, check, what) for what in _guarded("clip.json", lambda: find(clip))]  # noqa: B023
    if clip.images and clip.images.folder.resolve().is_relative_to(folder.resolve()):
        # A clip may also refer to some frames of another clip.
        problems += [Problem(folder.name, "images", what) for what in check_surplus(clip)]
    return clip, problems


def _result(path: Path, names: list[str], problems: list[Problem], number: str | None) -> Verification:
    again = sorted({problem.clip for problem in problems} - {DATA_SET})
    without = [name for name in names if not (path / name / CHECKSUMS).is_file() and name not in again]
    return Verification(names, problems, again, number, without)


def _guarded(name: str, check: Callable[[], Iterable[str]]) -> list[str]:
    """Return the problems that a check finds. Damaged files can cause any error, so each error is a problem as well."""
    try:
        return list(check())
    except Exception as error:
        return [_error_text(name, error)]


def _error_text(name: object, error: Exception) -> str:
    """Return the description of an error that a file caused: a missing key, or a value of another kind."""
    lacks = isinstance(error, KeyError) and error.args
    what = f"lacks {error.args[0]!r}" if lacks else f"holds what cannot be read, {type(error).__name__}: {error}"
    return f"{name}: {what}; check keys and values for typing errors"


def _manifest(path: Path) -> tuple[list[dict], list[Problem]]:
    """Return the lines of a manifest and its problems. If it is damaged, lines are made from the folders of clips."""
    try:
        lines = read_manifest(path)
        for line in lines:
            if not isinstance(line["id"], str) or Path(line["id"]).name != line["id"]:
                raise ValueError(f"{path / MANIFEST}: expected the name of a folder as id, found {line['id']!r}")
        return lines, []
    except (ValueError, OSError) as error:
        there = [{"id": folder.parent.name, "status": "ok"} for folder in sorted(path.glob("*/clip.json"))]
        return there, [Problem(DATA_SET, "manifest", f"{error}; the clips are checked without it")]


def _config(path: Path) -> tuple[dict | None, list[Problem]]:
    """Return the configuration of a data set and its problems. It is None if there is no usable configuration."""
    if not (path / CONFIG).is_file():
        return None, []
    try:
        config = read_json(path / CONFIG)
        image_kinds(config["images"]), config["scene"]["fps"], config["seed"] + 0
    except Exception as error:
        what = str(error) if isinstance(error, ValueError) else _error_text(path / CONFIG, error)
        return None, [Problem(DATA_SET, "manifest", what)]
    return config, []


def _check_data_set(path: Path, lines: list[dict]) -> Iterator[str]:
    names = [line["id"] for line in lines]
    made = {line["id"] for line in lines if line["status"] == "ok"}
    there = {folder.parent.name for folder in path.glob("*/clip.json")}
    yield from (f"{MANIFEST}: clip {name} is listed twice" for name in sorted(set(names)) if names.count(name) > 1)
    yield from (f"{name}: a clip that is not ok in {MANIFEST}" for name in sorted(there - made))
    for line in lines:
        if line["status"] != "ok" and not line.get("reason"):
            yield f"{MANIFEST}: clip {line['id']} has status {line['status']!r} and no reason"


def _check_line(clip: Clip, line: dict, config: dict | None) -> Iterator[str]:
    if clip.id != line["id"]:
        yield f"its id in clip.json is {clip.id!r}"
    if clip.poses is not None:
        # This is a captured clip. Its data set has a manifest and a configuration of another kind.
        return
    own = clip.provenance.get("manifest", line)
    if line.keys() == {"id", "status"}:
        # The manifest could not be read.
        line = own
    for key in sorted({*line, *own}):
        if line.get(key) != own.get(key):
            yield f"{key}: {line.get(key)!r} in {MANIFEST}, {own.get(key)!r} in clip.json"
    expected = {"frames": len(clip)} | ({} if clip.truth is None else {"persons": clip.truth.xyz.shape[1]})
    for key, found in expected.items():
        if line.get(key, found) != found:
            yield f"{key}: {line[key]} in {MANIFEST}, {found} in the arrays"
    if config is None:
        return
    fps, kinds = config["scene"]["fps"], image_kinds(config["images"])
    if clip.fps != fps:
        yield f"fps: {fps} in {CONFIG}, {clip.fps} in the clip"
    found = clip.images.kinds if clip.images else ()
    if found != kinds:
        there, here = (", ".join(each) or "none" for each in (kinds, found))
        make = "; synth generate for all clips makes the others" if set(kinds) > set(found) else ""
        yield f"images: {there} in {CONFIG}, {here} in the clip{make}"
    if {"seed", "attempts"} <= line.keys() and line["seed"] != (
        seed := attempt_seed(config["seed"], line["attempts"] - 1)
    ):
        yield f"seed: {line['seed']}, but attempt {line['attempts']} with the seed of {CONFIG} has {seed}"


_OF_A_CLIP: dict[str, Callable[[Clip], Iterable[str]]] = {
    "numbers": check_numbers,
    "labels": check_labels,
    "projection": check_projection,
    "detections": check_detections,
    "images": check_images,
}
CHECKS = {
    "checksums": "all files as they were written, no others",
    "files": "exist, undamaged, of matching shapes; finite numbers",
    "numbers": "points whole or NaN; confidences from 0 to 1",
    "labels": "codes and occluders that exist and match",
    "projection": "visibility matches the projections of joints",
    "detections": "in the image, near their person",
    "images": "exist, no others do, readable, of the right size, as labelled",
    "manifest": "lists the clips that exist, as they are",
}
"""The checks, in the order of printing, and what each requires."""
