"""What must be true of any clip: each check returns what is wrong in words, nothing where nothing is."""

from dataclasses import fields
from itertools import repeat
from pathlib import Path

import av
import numpy as np

from dmae.clip import Clip, JointError, Poses3D, Visibility
from dmae.images import FIRST_OBJECT_ID
from synth.pixels import agreement

_EDGE = 0.05
"""How far a pixel may lie off because truth is kept in single precision, px."""
_NEAR_CAMERA = 1e-3
"""The same of a distance from the camera's plane, m."""
_FAR_OFF = 0.15
"""A detection whose median joint lies farther than that from its person, in heights of the person, is off. Asked where
a clip does not say how far each joint is off."""
_MOST_OFF = 0.05
"""Share of a clip's detections that may be off: detectors make such mistakes."""
_LEAST_AGREEMENT = 0.99


def check_numbers(clip: Clip) -> list[str]:
    """Whole points or none, nothing infinite, confidences from 0 to 1."""
    parts = {name: getattr(clip, name) for name in ("detections", "truth", "poses")}
    arrays = {
        f"{name}.{f.name}": getattr(part, f.name)
        for name, part in parts.items()
        if part is not None
        for f in fields(part)
        if f.name != "skeleton"
    }
    problems = []
    for name, array in arrays.items():
        if np.isinf(array).any():
            problems.append(f"{name}: {int(np.isinf(array).sum())} infinite numbers")
        if name.endswith((".xy", ".xyz")):
            torn = np.isnan(array).any(-1) != np.isnan(array).all(-1)
            if torn.any():
                problems.append(f"{name}: {int(torn.sum())} points of which some coordinates are NaN and others not")
    with np.errstate(invalid="ignore"):
        beyond = (clip.detections.score < 0) | (clip.detections.score > 1)
    if beyond.any():
        problems.append(f"detections.score: {int(beyond.sum())} confidences outside 0..1")
    return problems


def check_labels(clip: Clip) -> list[str]:
    """Codes that exist, causes that are there, margins where something hides."""
    problems = []

    def count(wrong: np.ndarray, what: str) -> None:
        if wrong.any():
            problems.append(f"{what}: {int(wrong.sum())} of {wrong.size}")

    persons = 0 if clip.truth is None else clip.truth.xyz.shape[1]
    if clip.visibility is not None and clip.hidden_by is not None:
        code, by = clip.visibility, clip.hidden_by
        absent = np.broadcast_to(np.isnan(clip.truth.xyz).any(-1)[:, None], code.shape)
        person = np.arange(persons)[:, None]
        count(code > max(Visibility), "visibility holds codes that there are not")
        count((code == Visibility.ABSENT) != absent, "visibility is not ABSENT exactly where the truth is NaN")
        least = np.select(
            [
                code == Visibility.HIDDEN_BY_SELF,
                np.isin(code, (Visibility.HIDDEN_BY_PERSON, Visibility.HIDDEN_BY_OBJECT)),
            ],
            [np.broadcast_to(person, code.shape), 0],
            -1,
        )
        greatest = np.select(
            [code == Visibility.HIDDEN_BY_PERSON, code == Visibility.HIDDEN_BY_OBJECT],
            [persons - 1, len(clip.objects) - 1],
            least,
        )
        oneself = (code == Visibility.HIDDEN_BY_PERSON) & (by == person)
        count((by < least) | (by > greatest) | oneself, "hidden_by names nobody and nothing that its visibility means")
        if clip.depth_margin is not None:
            hidden = (code >= Visibility.HIDDEN_BY_SELF) & (code <= Visibility.HIDDEN_BY_OBJECT)
            count(np.isnan(clip.depth_margin) == hidden, "depth_margin is not known exactly where something hides")
            count(clip.depth_margin <= 0, "depth_margin is not in front of the joint")
    if clip.detected_person is not None:
        who = clip.detected_person
        count((who < -1) | (who >= persons), "detected_person names nobody")
        count(
            (who >= 0) & ~clip.detections.observed.any(-1), "detected_person names somebody where nothing is detected"
        )
    if clip.detected_joint_person is not None:
        who = clip.detected_joint_person
        count((who < -1) | (who >= persons), "detected_joint_person names nobody")
        count((who >= 0) & ~clip.detections.observed, "detected_joint_person names somebody where nothing is detected")
    if clip.detected_error is not None:
        count(clip.detected_error > max(JointError), "detected_error holds codes that there are not")
        absent = clip.detected_error == JointError.ABSENT
        count(absent == clip.detections.observed, "detected_error is not ABSENT exactly where nothing is detected")
    if clip.amodal_pixels is not None:
        area = clip.rig.size.prod(1)[:, None]
        wrong = (clip.visible_pixels < 0) | (clip.visible_pixels > clip.amodal_pixels) | (clip.amodal_pixels > area)
        count(wrong, "visible_pixels exceed amodal_pixels, or those the image")
    return problems


def check_projection(clip: Clip) -> list[str]:
    """Joints said to be in an image project into it, those outside outside, those behind behind."""
    if clip.truth is None or clip.visibility is None:
        return []
    rig = clip.rig if clip.true_rig is None else clip.true_rig
    xy, depth = rig.project(clip.truth.xyz)
    size = rig.size[:, None, None]
    with np.errstate(invalid="ignore"):
        inside = ((xy >= -0.5 - _EDGE) & (xy <= size - 0.5 + _EDGE)).all(-1)
        well_inside = ((xy >= -0.5 + _EDGE) & (xy <= size - 0.5 - _EDGE)).all(-1)
        wrong = {
            "in an image project outside it": (clip.visibility <= Visibility.HIDDEN_BY_OBJECT) & ~inside,
            "outside an image project into it": (clip.visibility == Visibility.OUTSIDE_IMAGE) & well_inside,
            "outside an image are behind its camera": (clip.visibility == Visibility.OUTSIDE_IMAGE)
            & (depth < -_NEAR_CAMERA),
            "behind a camera are before it": (clip.visibility == Visibility.BEHIND_CAMERA) & (depth > _NEAR_CAMERA),
        }
    return [
        f"{int(found.sum())} joints said to be {what}, first in frame {at[0]}, camera {clip.rig.names[at[1]]}, "
        f"person {at[2]}, joint {clip.truth.skeleton.joints[at[3]]}"
        for what, found in wrong.items()
        if found.any()
        for at in (np.argwhere(found)[0],)
    ]


def check_detections(clip: Clip) -> list[str]:
    """Detections lie in their image; those of a person about where that person is."""
    problems, rig = [], clip.rig if clip.true_rig is None else clip.true_rig
    xy = clip.detections.xy
    outside = clip.detections.observed & ~clip.rig.inside(xy)
    if outside.any():
        problems.append(f"{int(outside.sum())} detected joints lie outside their image")
    if clip.truth is None or clip.detected_person is None:
        return problems
    columns = _columns(clip.truth, clip.detections.skeleton.joints, clip.detections.skeleton.name)
    frame, view, place = np.nonzero(clip.detected_person >= 0)
    person = clip.detected_person[frame, view, place]
    valid = person < clip.truth.xyz.shape[1]
    frame, view, place, person = (index[valid] for index in (frame, view, place, person))
    if columns is None:
        return problems
    true, found = rig.project(clip.truth.xyz[:, :, columns])[0][frame, view, person], xy[frame, view, place]
    distance = np.linalg.norm(found - true, axis=-1)
    if clip.detected_off is not None:
        wrong = np.abs(clip.detected_off[frame, view, place] - distance) > _EDGE
        if wrong.any():
            problems.append(f"detected_off is not the distance from the true joint: {int(wrong.sum())} of {wrong.size}")
        return problems
    some = np.isfinite(distance).any(-1)
    height = np.ptp(np.where(np.isnan(true[some]), np.nanmean(true[some], 1, keepdims=True), true[some]), 1).max(-1)
    off = np.nanmedian(distance[some], -1) > _FAR_OFF * height
    if some.any() and off.mean() > _MOST_OFF:
        problems.append(f"{off.mean():.0%} of the detections lie far from the person that they are said to be of")
    return problems


def _columns(truth: Poses3D, joints: tuple[str, ...], skeleton: str) -> list[int] | None:
    """Where the detected joints are among the true ones; None where they are of another skeleton."""
    for prefix in ("", f"{skeleton}."):
        if set(names := [prefix + joint for joint in joints]) <= set(truth.skeleton.joints):
            return truth.skeleton.index(*names)
    return None


def check_images(clip: Clip) -> list[str]:
    """Files that are there, can be read and have the size of the images; ids and parts that exist, go together and
    bear out the labels."""
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
    if "ids" in clip.images.kinds and clip.visibility is not None and not problems:
        compared, agreeing = (counts.sum() for counts in agreement(clip))
        expected, luck = _LEAST_AGREEMENT * compared, np.sqrt(compared * _LEAST_AGREEMENT * (1 - _LEAST_AGREEMENT))
        if agreeing < expected - 3 * luck:
            problems.append(f"visibility is what the ids show at {agreeing} of {compared} joints, less than 99%")
    return problems


def _check_view(clip: Clip, kind: str, view: int, name: str) -> list[str]:
    """One kind of images of one view, read once."""
    width, height = clip.rig.size[view].tolist()
    persons = clip.truth.xyz.shape[1] if clip.truth is not None else FIRST_OBJECT_ID - 1
    for frame, image in enumerate(clip.images.read(kind, name)):
        if image.shape[:2] != (height, width):
            found = f"{image.shape[1]} x {image.shape[0]}"
            return [f"{kind} of camera {name}: expected {width} x {height} px, found {found}"]
        if kind != "ids":
            continue
        shown = np.bincount(image.ravel(), minlength=FIRST_OBJECT_ID)
        unknown = np.flatnonzero(shown)
        unknown = unknown[(unknown > persons) & ~np.isin(unknown - FIRST_OBJECT_ID, np.arange(len(clip.objects)))]
        if len(unknown):
            return [f"ids of camera {name}, frame {frame}: {unknown[:5].tolist()} stand for nobody and nothing"]
        if clip.visible_pixels is not None:
            said = clip.visible_pixels[frame, view]
            if not np.array_equal(shown[1 : 1 + len(said)], said):
                return [f"ids of camera {name}, frame {frame}: {shown[1 : 1 + len(said)].tolist()} pixels show the "
                        f"persons, visible_pixels says {said.tolist()}"]  # fmt: skip
    return []


def _check_parts(clip: Clip, name: str) -> list[str]:
    """Parts of one view: those that have names, on the pixels of persons and on no others."""
    persons = clip.images.read("ids", name) if "ids" in clip.images.kinds else repeat(None)
    for frame, (parts, ids) in enumerate(zip(clip.images.read("parts", name), persons, strict=False)):
        if parts.max() > len(clip.images.parts):
            return [f"parts of camera {name}, frame {frame}: {parts.max()} stands for none of the "
                    f"{len(clip.images.parts)} parts that clip.json names"]  # fmt: skip
        if ids is not None:
            apart = np.count_nonzero((parts > 0) != ((ids > 0) & (ids < FIRST_OBJECT_ID)))
            if apart:
                return [f"parts of camera {name}, frame {frame}: {apart} pixels show a part of a person and no person "
                        "in the ids, or a person of whom no part"]  # fmt: skip
    return []


def check_surplus(clip: Clip) -> list[str]:
    """No images beside those that a clip knows of, in a folder that holds its own and no other's."""
    if clip.images is None:
        return []
    images, problems = clip.images, []
    expected = {
        images.folder / kind / view / f"{frame:06d}.png"
        for kind in images.kinds
        if kind != "rgb"
        for view in images.views
        for frame in images.frames
    }
    if "rgb" in images.kinds:
        expected |= {images.folder / "rgb" / f"{view}.mp4" for view in images.views}
        for path in filter(Path.is_file, sorted(images.folder.glob("rgb/*.mp4"))):
            problems += _check_length(path, len(images.frames))
    surplus = sorted({*images.folder.rglob("*.png"), *images.folder.rglob("*.mp4")} - expected)
    if surplus:
        first = surplus[0].relative_to(images.folder)
        problems.append(f"files of images that the clip does not know of: {len(surplus)}, first {first}")
    return problems


def _check_length(path: Path, frames: int) -> list[str]:
    """A video holds no more frames than it should, as far as it can be read."""
    try:
        with av.open(str(path)) as container:
            found = container.streams.video[0].frames
    except (OSError, IndexError, av.FFmpegError):
        # Said where it is read.
        return []
    return [f"rgb/{path.name}: expected {frames} frames, found {found}"] if found > frames else []
