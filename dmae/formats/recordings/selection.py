"""Select frames and views of a clip, and shift views in time."""

import re
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from dmae.data.clip import Clip, Detections2D
from dmae.data.labels import NOT_DETECTED, DetectionLabels


def offsets_of_all(offsets: Sequence[int | str] | None, names: Sequence[str]) -> list[int] | None:
    """Return the number of frames by which each camera started late.

    Args:
        offsets: One number per camera in the order of `names`, or entries `name:frames`. None returns None.
        names: Names of the cameras.

    Raises:
        ValueError: an entry is malformed, names an unknown camera, or names a camera for the second time.
    """
    if offsets is None or all(isinstance(each, int) for each in offsets):
        return None if offsets is None else list(offsets)
    found = {}
    for each in offsets:
        name, _, frames = str(each).rpartition(":")
        if name not in names or name in found or not re.fullmatch(r"[+-]?\d{1,9}", frames):
            raise ValueError(
                f"data.offsets={list(offsets)}: expected a number for each camera, or entries as {names[0]}:3 of some "
                f"of {', '.join(names)}, each once; got {each!r}"
            )
        found[name] = int(frames)
    return [found.get(name, 0) for name in names]


def shift_views(clip: Clip, offsets: list[int] | None) -> Clip:
    """Return the clip with the detections of each camera moved later by `offsets` (V,) frames; None moves nothing.

    Detections are absent in frames for which the clip contains none. Images cannot be moved, so they are removed.

    Raises:
        ValueError: the number of offsets is not the number of cameras.
    """
    if offsets is None or not any(offsets):
        return clip
    if len(offsets) != len(clip.rig):
        raise ValueError(
            f"data.offsets={list(offsets)}: expected a number of frames for each camera of clip {clip.id!r}, "
            f"{', '.join(clip.rig.names)}"
        )

    def shifted(array: np.ndarray, absent) -> np.ndarray:
        late = np.full_like(array, absent)
        for view, offset in enumerate(offsets):
            start, end = max(offset, 0), max(len(array) + min(offset, 0), 0)
            late[start:end, view] = array[max(-offset, 0) : max(len(array) - max(offset, 0), 0), view]
        return late

    found, labels = clip.detections, clip.detection_labels
    if labels is not None:
        arrays = {name: getattr(labels, name) for name in NOT_DETECTED}
        known = {name: array for name, array in arrays.items() if array is not None}
        labels = DetectionLabels(**{name: shifted(array, NOT_DETECTED[name]) for name, array in known.items()})
    return replace(
        clip,
        detections=Detections2D(found.skeleton, shifted(found.xy, np.nan), shifted(found.score, np.nan)),
        detection_labels=labels,
        images=None,
        provenance=clip.provenance | {"offsets": list(offsets)},
    )


def select_frames(clip: Clip, frames: list[int] | None) -> Clip:
    """Return the clip with only the frames [first, end); None selects all.

    Raises:
        ValueError: the clip lacks some of the frames.
    """
    if frames is None:
        return clip
    if len(frames) != 2 or not 0 <= frames[0] < frames[1] <= len(clip):
        raise ValueError(
            f"data.frames={list(frames)}: expected [first, end] within the {len(clip)} frames of clip {clip.id!r}"
        )
    first = clip.provenance.get("first_frame", 0) + frames[0]
    selected = clip.select(frames=slice(*frames))
    return replace(selected, provenance=clip.provenance | {"first_frame": first, "frames": list(frames)})


def select_views(clip: Clip, cameras: Sequence[int | str] | None) -> Clip:
    """Return the clip with only some cameras, given by name or by index from 0; None selects all.

    A whole number is an index. It is a name only if each of `cameras` is the name of a camera and at least one of them
    is given as text.

    Raises:
        ValueError: the clip lacks one of the cameras, or one is given twice.
    """
    if cameras is None:
        return clip
    names = clip.rig.names
    if all(str(camera) in names for camera in cameras) and any(isinstance(camera, str) for camera in cameras):
        index = [names.index(str(camera)) for camera in cameras]
    else:
        index = [names.index(camera) if camera in names else camera for camera in cameras]
    unknown = [camera for camera in index if not isinstance(camera, int) or not 0 <= camera < len(names)]
    if unknown or not index or len(set(index)) != len(index):
        there = ", ".join(f"{i} ({name})" for i, name in enumerate(names))
        raise ValueError(
            f"data.cameras={list(cameras)}: expected different cameras of clip {clip.id!r}, which has {there}"
        )
    return clip.select(views=index)


def camera_subsets(clip: Clip, sizes: Sequence[int]) -> list[list[int]]:
    """Return all subsets of the cameras of a clip with these sizes; without sizes, only the set of all cameras.

    Raises:
        ValueError: there are not enough cameras, or a size is less than two.
    """
    views = len(clip.rig)
    sizes = list(dict.fromkeys(sizes)) or [views]
    if not all(2 <= size <= views for size in sizes):
        raise ValueError(f"views={sizes}: expected numbers from 2 to {views}, the cameras of clip {clip.id!r}")
    return [list(cameras) for size in sizes for cameras in combinations(range(views), size)]
