"""Alignment in time: which images of the cameras belong to one frame, by the frame rates and offsets of the videos."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dmae.detection.pictures import CameraPictures
from dmae.files.checks import check_rate

_SAME_RATE = 1e-3
"""Relative difference of frame rates above which a note is written."""
_MOST_SPAN = 20
"""Largest span of the numbers in a folder, per image. With a larger span the numbers are not frame numbers."""


@dataclass(frozen=True)
class Alignment:
    """The frames of a recording.

    Attributes:
        fps: Frames per second.
        frames: For each camera (N,) the frame of each of its images; -1 for an image that is not used.
        count: F, the number of frames.
        notes: Decisions that can be wrong.
    """

    fps: float
    frames: tuple[np.ndarray, ...]
    count: int
    notes: tuple[str, ...]


def align(cameras: Sequence[CameraPictures], fps: float | None, offsets: Sequence[int] | None) -> Alignment:
    """Assign each image to the frame that is nearest in time.

    The frame rate is the highest of the cameras. A camera with a lower rate has no image in some frames. The clip ends
    with the camera that ends last.

    Args:
        cameras: V cameras.
        fps: Frames per second; None to take it from the videos. Folders of images do not state it.
        offsets: (V,) frames by which each camera started late; None to take them from the videos.

    Raises:
        ValueError: the frame rate is not known, or the number of offsets differs from the number of cameras.
    """
    notes: list[str] = []
    if offsets is not None and len(offsets) != len(cameras):
        raise ValueError(f"offsets={list(offsets)}: expected one for each of the {len(cameras)} cameras")
    rates = [camera.rate for camera in cameras]
    known = [rate for rate in rates if rate]
    given = fps is not None
    if fps is None:
        if not known:
            raise ValueError(
                "expected fps=...: folders of pictures do not say how many frames a second they have; photographs that "
                "do not belong together are given as photos=<folder>"
            )
        fps = max(known)
        if min(known) < fps * (1 - _SAME_RATE):
            listed = ", ".join(f"{camera.name} {camera.rate:.5g}" for camera in cameras if camera.rate)
            notes.append(f"cameras have other frame rates ({listed}); those of fewer have no picture in some frames")
    fastest = next((camera for camera in cameras if camera.rate == fps), None)
    check_rate("fps" if given or fastest is None else f"{fastest.path}: fps", fps)
    late = _offsets(cameras, fps, notes) if offsets is None else np.asarray(offsets, float)
    late = late - late.min()
    numbered = [camera for camera in cameras if camera.rate is None]
    first = min((camera.times[0] for camera in numbered), default=0)
    frames = []
    for camera, rate, delay in zip(cameras, rates, late, strict=True):
        if rate is None:
            span = camera.times[-1] - first + 1
            counts = span <= _MOST_SPAN * len(camera)
            place = camera.times - first if counts else np.arange(len(camera))
            if not counts:
                notes.append(f"the numbers of the pictures of {camera.name} do not count frames; taken in their order")
        elif given and len({round(each, 3) for each in known}) == 1:
            place = np.arange(len(camera))
        else:
            place = (camera.times - camera.times[0]) * fps
        frames.append(_unique(np.round(place + delay).astype(int)))
    start = min((each[each >= 0].min() for each in frames if (each >= 0).any()), default=0)
    frames = [np.where(each >= 0, each - start, -1) for each in frames]
    for camera, each in zip(cameras, frames, strict=True):
        if unused := int((each < 0).sum()):
            notes.append(
                f"{camera.name}: {unused} of {len(each)} pictures were taken in the frame of another, not used"
            )
    count = max(int(each.max()) + 1 for each in frames)
    ends = [int(each.max()) + 1 for each in frames]
    if min(ends) < count:
        listed = ", ".join(f"{camera.name} {end}" for camera, end in zip(cameras, ends, strict=True))
        notes.append(f"cameras end at different frames ({listed}); nothing is detected beyond their ends")
    return Alignment(float(fps), tuple(frames), count, tuple(notes))


def _unique(frames: np.ndarray) -> np.ndarray:
    """Return the frames, with -1 for each image that has the same frame as an earlier image."""
    _, first = np.unique(frames, return_index=True)
    kept = np.zeros(len(frames), bool)
    kept[first] = True
    return np.where(kept, frames, -1)


def _offsets(cameras: Sequence[CameraPictures], fps: float, notes: list[str]) -> np.ndarray:
    """Return the number of frames by which each camera started late: from the timecodes, else from the first times."""
    starts = np.array([np.nan if each.timecode is None else _seconds(each.timecode, fps) for each in cameras])
    how = "timecodes"
    if np.isnan(starts).any():
        starts, how = np.array([each.times[0] if each.rate else 0.0 for each in cameras]), "times of the first pictures"
    late = np.round((starts - starts.min()) * fps)
    longest = max(len(each) / (each.rate or fps) for each in cameras) * fps
    if not late.any():
        return late
    listed = ", ".join(f"{camera.name} {offset:+.0f}" for camera, offset in zip(cameras, late, strict=True))
    if late.max() >= longest:
        notes.append(f"{how} in the videos do not overlap ({listed} frames): not used; offsets=[...] gives others")
        return np.zeros(len(cameras))
    notes.append(f"cameras start late by the {how} in the videos: {listed} frames; offsets=[...] gives others")
    return late


def _seconds(timecode: str, fps: float) -> float:
    found = re.fullmatch(r"(\d+):(\d+):(\d+)[:;.](\d+)", timecode.strip())
    if not found:
        return np.nan
    hours, minutes, seconds, frames = map(int, found.groups())
    return hours * 3600 + minutes * 60 + seconds + frames / fps
