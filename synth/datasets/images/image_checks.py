"""Checks of the images of a clip. Each check returns descriptions of the problems that it finds."""

from itertools import repeat
from pathlib import Path

import av
import numpy as np

from dmae.data.clip import Clip
from dmae.data.images import FIRST_OBJECT_ID, Images
from synth.labels.silhouettes import agreement

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


def check_surplus(clip: Clip) -> list[str]:
    """Check that the image folder of a clip contains no other files."""
    if clip.images is None:
        return []
    images, problems = clip.images, []
    if "rgb" in images.kinds:
        for path in filter(Path.is_file, sorted(images.folder.glob("rgb/*.mp4"))):
            problems += _check_length(path, len(images.frames))
    found = {path for ending in ("png", "mp4", "jpg") for path in images.folder.rglob(f"*.{ending}")}
    surplus = sorted(found - _files(images))
    if surplus:
        first = surplus[0].relative_to(images.folder)
        problems.append(f"image files that do not belong to the clip: {len(surplus)}, first {first}")
    return problems


def missing_files(clip: Clip) -> list[Path]:
    """Return the image files that a clip refers to but that do not exist."""
    return [] if clip.images is None else sorted(path for path in _files(clip.images) if not path.is_file())


def _files(images: Images) -> set[Path]:
    """Return the files of images."""
    return {images.path(kind, view, frame) for kind in images.kinds for view in images.views for frame in images.frames}


def _check_length(path: Path, frames: int) -> list[str]:
    """Check that a video has no more frames than expected. An unreadable video is not reported here."""
    try:
        with av.open(str(path)) as container:
            found = container.streams.video[0].frames
    except (OSError, IndexError, av.FFmpegError):
        # `check_images` reports it.
        return []
    return [f"rgb/{path.name}: expected {frames} frames, found {found}"] if found > frames else []
