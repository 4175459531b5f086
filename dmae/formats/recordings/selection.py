"""Select frames and views of a clip, and shift views in time."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np

from dmae.data.clip import Clip, Detections2D
from dmae.data.labels import NOT_DETECTED, DetectionLabels


def shift_views(clip: Clip, offsets: list[int] | None) -> Clip:
    """Return the clip with the detections of each camera moved later by `offsets` (V,) frames; None moves nothing.

    Detections that would come from outside the clip are absent. Images, which cannot be moved, are left out.

    Raises:
        ValueError: there is not one offset for each camera.
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
    """Return the clip of the frames [first, end); None selects all.

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


def select_views(clip: Clip, cameras: list[int] | None) -> Clip:
    """Return the clip of some cameras, counted from 0; None selects all.

    Raises:
        ValueError: the clip lacks one of the cameras, or one is named twice.
    """
    if cameras is None:
        return clip
    unknown = [camera for camera in cameras if not 0 <= camera < len(clip.rig)]
    if unknown or not cameras or len(set(cameras)) != len(cameras):
        there = ", ".join(f"{i} ({name})" for i, name in enumerate(clip.rig.names))
        raise ValueError(f"data.cameras={cameras}: expected different cameras of clip {clip.id!r}, which has {there}")
    return clip.select(views=list(cameras))


def camera_subsets(clip: Clip, sizes: Sequence[int]) -> list[list[int]]:
    """Return all subsets of a clip's cameras of each size; without sizes, all cameras.

    Raises:
        ValueError: there are not so many cameras, or a size is less than two.
    """
    views = len(clip.rig)
    sizes = list(dict.fromkeys(sizes)) or [views]
    if not all(2 <= size <= views for size in sizes):
        raise ValueError(f"views={sizes}: expected numbers from 2 to {views}, the cameras of clip {clip.id!r}")
    return [list(cameras) for size in sizes for cameras in combinations(range(views), size)]
