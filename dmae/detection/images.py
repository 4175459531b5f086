"""The images of cameras: videos, folders or a clip; their sizes beside the calibration, and their alignment in time."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.images import Images
from dmae.files.checks import IMAGES, VIDEOS, check_rate
from dmae.files.images import check_times, open_video, read_upright, upright_frame, upright_size
from dmae.formats.footage import Fitting
from dmae.formats.recordings import by_name, frame_number


@dataclass(frozen=True)
class CameraImages:
    """The N images of a camera."""

    name: str  # Name of the camera
    path: Path  # Video, or folder with images
    size: tuple[int, int]  # Width and height, px, upright
    # (N,) s, when each image was taken by the clock of its file; for a folder, the numbers of the images
    times: np.ndarray
    rate: float | None  # Images per second; None if the files do not state it
    # Takes `start` and `stop`; yields these images, (H, W, 3) uint8 RGB, None for an image that cannot be read
    read: Callable[[int, int], Iterator[np.ndarray | None]]
    codec: str = ""  # Codec of a video, for instance "h264"
    timecode: str | None = None  # Start of a video, as the camera wrote it

    def __len__(self) -> int:
        return len(self.times)

    def part(self, start: int, stop: int) -> "CameraImages":
        """Return the camera with only some of its images; without a codec, as they are not the whole video."""
        read = partial(_read_from, self.read, start)
        return replace(self, times=self.times[start:stop], read=read, codec="")


def _read_from(
    read: Callable[[int, int], Iterator[np.ndarray | None]], first: int, start: int, stop: int
) -> Iterator[np.ndarray | None]:
    return read(first + start, first + stop)


def find_cameras(path: Path) -> list[CameraImages]:
    """Return the cameras of a folder, each a video or a folder of images, in the order of their names.

    Args:
        path: The folder; or a single video.

    Raises:
        FileNotFoundError: there is nothing, or neither a video nor a folder of images.
        ValueError: a video cannot be read, or two are of one camera.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"videos={path}: no such folder")
    places = [path] if path.is_file() else by_name(path.iterdir())
    places = [each for each in places if not each.name.startswith(".")]
    found = [_video(each) for each in places if each.is_file() and each.suffix.lower() in VIDEOS]
    found += [_folder(each) for each in places if each.is_dir() and images_in(each)]
    if not found and path.is_dir() and images_in(path):
        found = [_folder(path)]
    if not found:
        there = ", ".join(each.name for each in places[:6]) or "nothing"
        for inner in (each for each in places if each.is_dir()):
            if any(file.suffix.lower() in VIDEOS or (file.is_dir() and images_in(file)) for file in inner.iterdir()):
                there = f"them in a folder of it; name that, as videos={inner}"
        raise FileNotFoundError(
            f"videos={path}: expected for each camera a video ({', '.join(VIDEOS)}) or a folder of images "
            f"({', '.join(IMAGES)}), found {there}"
        )
    names = [camera.name for camera in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"videos={path}: expected one video or folder for each camera, found two of {twice}")
    return by_name(found)


def cameras_of(images: Images, sizes: np.ndarray) -> list[CameraImages]:
    """Return the cameras of a clip with images; `sizes` (V, 2) px are the sizes in its rig."""
    numbers = np.arange(len(images.frames), dtype=float)
    return [
        CameraImages(name, images.folder, (int(width), int(height)), numbers, None, partial(_read_images, images, name))
        for name, (width, height) in zip(images.views, sizes, strict=True)
    ]


def _read_images(images: Images, name: str, start: int, stop: int) -> Iterator[np.ndarray]:
    for frame in range(start, stop):
        yield images.at("rgb", name, frame)


def images_in(folder: Path) -> list[Path]:
    """Return the image files of a folder by their numbers and names."""
    found = [each for each in folder.iterdir() if each.suffix.lower() in IMAGES and not each.name.startswith(".")]
    return by_name(found)


def _folder(path: Path) -> CameraImages:
    files = images_in(path)
    try:
        numbers = [frame_number(file, file.stem) for file in files]
    except ValueError:
        numbers = list(range(len(files)))
    if len(set(numbers)) < len(numbers):
        numbers = list(range(len(files)))
    return images_of(path.name, path, files, numbers)


def images_of(name: str, path: Path, files: list[Path], numbers: list[int]) -> CameraImages:
    """Return the camera with these image files, each with its number, in their order.

    Raises ValueError if not one can be read, or they are not of one size.
    """
    sizes, error = {}, None
    for file in files:
        try:
            sizes.setdefault(upright_size(file), file)
        except ValueError as damaged:
            error = error or damaged
    if not sizes:
        raise ValueError(f"{path}: not one image can be read; {error}")
    size, *others = sizes
    if others:
        (width, height), (other_width, other_height) = size, others[0]
        raise ValueError(
            f"{path}: expected the images of one camera, all of one size; {sizes[size].name} has {width} x {height} "
            f"px, {sizes[others[0]].name} {other_width} x {other_height}. Photographs that do not belong together: "
            f"dmae detect photos={path}"
        )
    order = np.argsort(numbers, kind="stable")
    ordered = [files[i] for i in order]
    return CameraImages(name, path, size, np.array(numbers, float)[order], None, partial(read_files, ordered))


def read_files(files: list[Path], start: int, stop: int) -> Iterator[np.ndarray | None]:
    """Yield the images of files, (H, W, 3) uint8 RGB; None for one that cannot be read."""
    for file in files[start:stop]:
        try:
            yield read_upright(file)
        except (ValueError, OSError):
            yield None


def _video(path: Path) -> CameraImages:
    import av

    with open_video(path) as container:
        stream = container.streams.video[0]
        base = float(stream.time_base)
        packets = [packet.pts for packet in container.demux(video=0) if packet.size]
        stamps = sorted(stamp for stamp in packets if stamp is not None)
        stated = [float(rate) for rate in (stream.average_rate, stream.base_rate) if rate]
        codec = stream.codec_context.name
        timecode = stream.metadata.get("timecode") or container.metadata.get("timecode")
    check_times(path, packets)
    try:
        first = next((each for each in _read_video(path, stamps, 0, min(len(stamps), 50)) if each is not None), None)
    except av.FFmpegError as error:
        raise ValueError(f"{path}: this video is damaged, {error}") from None
    if first is None:
        raise ValueError(f"{path}: expected a video, found no image that can be decoded")
    times = np.array(stamps, float) * base
    rate = stated[0] if stated else None
    if len(times) > 1:
        counted, span = _by_clock(times), times[-1] - times[0]
        if counted[-1] >= len(times):
            # The average rate counts images, and some were dropped.
            rate = min(stated, key=lambda each: abs(each * span - counted[-1]), default=None)
        if not (rate and 0.5 < rate * span / counted[-1] < 2):
            rate = counted[-1] / span
    return CameraImages(
        path.stem, path, first.shape[1::-1], times, rate, partial(_read_video, path, stamps), codec, timecode
    )


_REGULAR = 0.25  # Largest difference of a step in time from a whole number of frames, in frames


def _by_clock(times: np.ndarray) -> np.ndarray:
    """Return (N,) the frame of each image of a camera, by the clock of its file, whatever rate that clock has.

    Steps of two frames and more are frames that were dropped. Where steps are no whole numbers of frames, times say
    when images arrived rather than when they were taken, and images are counted in their order.
    """
    steps = np.diff(times)
    if not len(steps) or steps.min() <= 0:
        return np.arange(len(times))
    steps = steps / steps[steps < 1.5 * np.median(steps)].mean()
    whole = np.round(steps).astype(int)
    if whole.min() < 1 or (np.abs(steps - whole) > np.maximum(_REGULAR, 0.01 * whole)).any():
        return np.arange(len(times))
    return np.concatenate([[0], whole.cumsum()])


def _read_video(path: Path, stamps: list[int], start: int, stop: int) -> Iterator[np.ndarray | None]:
    """Yield frames of a video. A frame that cannot be decoded is None, and the next frames are still read."""
    import av

    position = {stamp: number for number, stamp in enumerate(stamps)}
    expected = start
    with open_video(path) as container:
        stream = container.streams.video[0]
        stream.codec_context.thread_count = 1
        if start:
            container.seek(stamps[start], stream=stream)
        for packet in container.demux(stream):
            try:
                frames = packet.decode()
            except (av.FFmpegError, ValueError):
                continue
            for frame in frames:
                number = position.get(frame.pts, -1)
                if number < expected or number >= stop:
                    if number >= stop:
                        break
                    continue
                yield from [None] * (number - expected)
                yield upright_frame(frame)
                expected = number + 1
            if expected >= stop:
                break
    yield from [None] * (stop - expected)


# Which images belong to one frame, by the frame rates and offsets of the videos

_SAME_RATE = 1e-3  # Relative difference of frame rates above which a note is written
_MOST_SPAN = 20
"""Largest span of the numbers in a folder, per image. With a larger span the numbers are not frame numbers."""


@dataclass(frozen=True)
class Alignment:
    """The frames of a recording."""

    fps: float  # Frames per second
    # For each camera (N,) the frame of each of its images; -1 for an image that is not used
    frames: tuple[np.ndarray, ...]
    count: int  # F, the number of frames
    notes: tuple[str, ...]  # Decisions that can be wrong


@dataclass(frozen=True)
class Recording:
    """Videos that belong together."""

    cameras: tuple[CameraImages, ...]  # V cameras with images
    alignment: Alignment  # The frame of each image
    rig: CameraRig | None  # Their calibration; None if there is none
    # Scale and margin of the images of each camera, relative to the images of its calibration
    fittings: tuple[Fitting, ...]
    notes: tuple[str, ...]  # Decisions that can be wrong
    first: int = 0  # Number of its first frame in the videos


def part_of(recording: Recording, frames: Sequence[int] | None) -> Recording:
    """Return the recording with only the frames [first, end), or all for None; ValueError if it lacks some."""
    if frames is None:
        return recording
    alignment = recording.alignment
    if len(frames) != 2 or not 0 <= frames[0] < frames[1] <= alignment.count:
        raise ValueError(
            f"frames={list(frames)}: expected [first, end] within the {alignment.count} frames of the recording"
        )
    first, end = frames
    cameras, placed = [], []
    for camera, place in zip(recording.cameras, alignment.frames, strict=True):
        inside = np.flatnonzero((place >= first) & (place < end))
        images = slice(inside[0], inside[-1] + 1) if len(inside) else slice(0, 0)
        cameras.append(camera.part(images.start, images.stop))
        placed.append(np.where(place[images] >= 0, place[images] - first, -1))
    alignment = replace(alignment, frames=tuple(placed), count=end - first)
    return replace(recording, cameras=tuple(cameras), alignment=alignment, first=first)


def align(cameras: Sequence[CameraImages], fps: float | None, offsets: Sequence[int] | None) -> Alignment:
    """Assign each image to the frame that is nearest in time.

    The frame rate is the highest of the cameras. A camera with a lower rate has no image in some frames. The clip ends
    with the camera that ends last.

    Raises ValueError if the frame rate is not known, or the number of offsets differs from the number of cameras.

    Args:
        cameras: V cameras.
        fps: Frames per second; None to take it from the videos. Folders of images do not state it.
        offsets: (V,) frames by which each camera started late; None to take them from the videos.
    """
    notes: list[str] = []
    if offsets is not None and len(offsets) != len(cameras):
        raise ValueError(f"offsets={list(offsets)}: expected one for each of the {len(cameras)} cameras")
    rates = {round(camera.rate, 3) for camera in cameras if camera.rate}
    # One rate that is given holds for all files, and their own can be wrong.
    by_clock = fps is not None and len(rates) == 1
    if fps is None:
        fps = _highest_rate(cameras, notes)
    else:
        check_rate("fps", fps)
    late = _offsets(cameras, fps, notes) if offsets is None else np.asarray(offsets, float)
    late = late - late.min()
    first = min((camera.times[0] for camera in cameras if camera.rate is None), default=0)
    frames = []
    for camera, delay in zip(cameras, late, strict=True):
        if camera.rate is None:
            place = _by_number(camera, first, notes)
        elif by_clock:
            place = _by_clock(camera.times)
        else:
            place = (camera.times - camera.times[0]) * fps
        frames.append(_unique(np.round(place + delay).astype(int)))
    start = min((each[each >= 0].min() for each in frames if (each >= 0).any()), default=0)
    frames = [np.where(each >= 0, each - start, -1) for each in frames]
    for camera, each in zip(cameras, frames, strict=True):
        if unused := int((each < 0).sum()):
            notes.append(f"{camera.name}: {unused} of {len(each)} images were taken in the frame of another, not used")
    ends = [int(each.max()) + 1 for each in frames]
    if min(ends) < max(ends):
        listed = ", ".join(f"{camera.name} {end}" for camera, end in zip(cameras, ends, strict=True))
        notes.append(f"cameras end at different frames ({listed}); nothing is detected beyond their ends")
    return Alignment(float(fps), tuple(frames), max(ends), tuple(notes))


def _highest_rate(cameras: Sequence[CameraImages], notes: list[str]) -> float:
    """Return the highest frame rate that videos state. Add a note if they state several."""
    fastest = max((camera for camera in cameras if camera.rate), key=lambda camera: camera.rate or 0, default=None)
    if fastest is None or not fastest.rate:
        raise ValueError(
            "expected fps=...: folders of images do not say how many frames a second they have; photographs that "
            "do not belong together are given as photos=<folder>"
        )
    if any(camera.rate and camera.rate < fastest.rate * (1 - _SAME_RATE) for camera in cameras):
        listed = ", ".join(f"{camera.name} {camera.rate:.5g}" for camera in cameras if camera.rate)
        notes.append(f"frame rates differ ({listed}); slower cameras have no image in some frames")
    check_rate(f"{fastest.path}: fps", fastest.rate)
    return fastest.rate


def _by_number(camera: CameraImages, first: float, notes: list[str]) -> np.ndarray:
    """Return frames (N,) by the numbers of a folder's images, from the `first` of all folders on.

    Numbers that cannot count frames, because they are too far apart, are not used; a note says so.
    """
    if camera.times[-1] - first + 1 <= _MOST_SPAN * len(camera):
        return camera.times - first
    notes.append(f"the numbers of the images of {camera.name} do not count frames; taken in their order")
    return np.arange(len(camera))


def _unique(frames: np.ndarray) -> np.ndarray:
    """Return the frames, with -1 for each image that has the same frame as an earlier image."""
    _, first = np.unique(frames, return_index=True)
    kept = np.zeros(len(frames), bool)
    kept[first] = True
    return np.where(kept, frames, -1)


def _offsets(cameras: Sequence[CameraImages], fps: float, notes: list[str]) -> np.ndarray:
    """Return the number of frames by which each camera started late: from the timecodes, else from the first times."""
    codes = [(each.timecode, each.rate or fps) for each in cameras]
    starts = np.array([np.nan if code is None else _seconds(code, rate) for code, rate in codes])
    how = "timecodes"
    if np.isnan(starts).any():
        starts, how = np.array([each.times[0] if each.rate else 0.0 for each in cameras]), "times of the first images"
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
    """Return the time of day, s, in a timecode of a video of `fps` frames a second; NaN if it is none."""
    found = re.fullmatch(r"(\d+):(\d+):(\d+)[:;.](\d+)", timecode.strip())
    if not found:
        return np.nan
    hours, minutes, seconds, frames = map(int, found.groups())
    return hours * 3600 + minutes * 60 + seconds + frames / fps
