"""The images of a camera: a video, a folder of images, or those of a clip."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from dmae.data.images import Images
from dmae.files.checks import PICTURES, VIDEOS
from dmae.files.pictures import open_video, read_upright, upright_size
from dmae.formats.recordings import frame_number, natural


@dataclass(frozen=True)
class CameraPictures:
    """The N images of a camera.

    Attributes:
        name: Of the camera.
        path: Video, folder of images, or folder of the images of a clip.
        size: Width and height, px, upright.
        times: (N,) s, when each image was taken by the clock of its file; for a folder, the numbers of the images.
        rate: Images per second; None if the files do not state it.
        read: Takes `start` and `stop`; yields these images, (H, W, 3) uint8 RGB, None for an image that cannot be read.
        codec: Codec of a video, for instance "h264".
        timecode: Start of a video, as the camera wrote it.
    """

    name: str
    path: Path
    size: tuple[int, int]
    times: np.ndarray
    rate: float | None
    read: Callable[[int, int], Iterator[np.ndarray | None]]
    codec: str = ""
    timecode: str | None = None

    def __len__(self) -> int:
        return len(self.times)


def find_cameras(path: Path) -> list[CameraPictures]:
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
    places = [path] if path.is_file() else sorted(path.iterdir(), key=lambda each: natural(each.name))
    places = [each for each in places if not each.name.startswith(".")]
    found = [_video(each) for each in places if each.is_file() and each.suffix.lower() in VIDEOS]
    found += [_folder(each) for each in places if each.is_dir() and pictures_in(each)]
    if not found and path.is_dir() and pictures_in(path):
        found = [_folder(path)]
    if not found:
        raise FileNotFoundError(
            f"videos={path}: expected for each camera a video ({', '.join(VIDEOS)}) or a folder of pictures "
            f"({', '.join(PICTURES)}), found {', '.join(each.name for each in places[:6]) or 'nothing'}"
        )
    names = [camera.name for camera in found]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"videos={path}: expected one video or folder for each camera, found two of {twice}")
    return sorted(found, key=lambda camera: natural(camera.name))


def cameras_of(images: Images, sizes: np.ndarray) -> list[CameraPictures]:
    """Return the cameras of the images of a clip of F frames; `sizes` (V, 2) px are those of its rig."""
    numbers = np.arange(len(images.frames), dtype=float)
    return [
        CameraPictures(name, images.folder, tuple(map(int, size)), numbers, None, partial(_read_images, images, name))
        for name, size in zip(images.views, sizes, strict=True)
    ]


def _read_images(images: Images, name: str, start: int, stop: int) -> Iterator[np.ndarray]:
    for frame in range(start, stop):
        yield images.at("rgb", name, frame)


def pictures_in(folder: Path) -> list[Path]:
    """Return the image files of a folder by their numbers and names."""
    found = [each for each in folder.iterdir() if each.suffix.lower() in PICTURES and not each.name.startswith(".")]
    return sorted(found, key=lambda each: natural(each.name))


def _folder(path: Path) -> CameraPictures:
    files, sizes, error = pictures_in(path), {}, None
    for file in files:
        try:
            sizes.setdefault(upright_size(file), file)
        except ValueError as damaged:
            error = error or damaged
    if not sizes:
        raise ValueError(f"{path}: not one picture can be read; {error}")
    size, *others = sizes
    if others:
        (width, height), (other_width, other_height) = size, others[0]
        raise ValueError(
            f"{path}: expected the pictures of one camera, all of one size; {sizes[size].name} has {width} x {height} "
            f"px, {sizes[others[0]].name} {other_width} x {other_height}. Photographs that do not belong together: "
            f"dmae detect photos={path}"
        )
    try:
        numbers = [frame_number(file, file.stem) for file in files]
    except ValueError:
        numbers = list(range(len(files)))
    if len(set(numbers)) < len(numbers):
        numbers = list(range(len(files)))
    order = np.argsort(numbers, kind="stable")
    ordered = [files[i] for i in order]
    return CameraPictures(path.name, path, size, np.array(numbers, float)[order], None, partial(read_files, ordered))


def read_files(files: list[Path], start: int, stop: int) -> Iterator[np.ndarray | None]:
    """Yield the images of files, (H, W, 3) uint8 RGB; None for one that cannot be read."""
    for file in files[start:stop]:
        try:
            yield read_upright(file)
        except (ValueError, OSError):
            yield None


def _video(path: Path) -> CameraPictures:
    import av

    with open_video(path) as container:
        stream = container.streams.video[0]
        base = float(stream.time_base)
        stamps = sorted(packet.pts for packet in container.demux(video=0) if packet.pts is not None)
        rate = float(stream.average_rate) if stream.average_rate else None
        codec = stream.codec_context.name
        timecode = stream.metadata.get("timecode") or container.metadata.get("timecode")
    try:
        first = next((each for each in _read_video(path, stamps, 0, min(len(stamps), 50)) if each is not None), None)
    except av.FFmpegError as error:
        raise ValueError(f"{path}: this video is damaged, {error}") from None
    if first is None:
        raise ValueError(f"{path}: expected a video, found no picture that can be decoded")
    times = np.array(stamps, float) * base
    if len(times) > 1 and not (rate and 0.5 < rate * (times[-1] - times[0]) / (len(times) - 1) < 2):
        rate = (len(times) - 1) / max(times[-1] - times[0], 1e-9)
    return CameraPictures(
        path.stem, path, first.shape[1::-1], times, rate, partial(_read_video, path, stamps), codec, timecode
    )


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
                yield _upright(frame)
                expected = number + 1
            if expected >= stop:
                break
    yield from [None] * (stop - expected)


def _upright(frame) -> np.ndarray:
    """Return the image of a frame, rotated as players show it: phones record their orientation in the video."""
    picture = frame.to_ndarray(format="rgb24")
    quarters = round((getattr(frame, "rotation", 0) or 0) / 90)
    return np.ascontiguousarray(np.rot90(picture, quarters)) if quarters % 4 else picture
