"""Images and videos, their size checked before memory is allocated. Videos that refer to others are not decoded."""

import os
import warnings
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, lru_cache
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageOps, UnidentifiedImageError

from dmae.files.contents import check_file

MOST_PIXELS = 1 << 26
"""Largest number of pixels of an image; phones take images of 50 million."""
_DECODED, _UPRIGHT = ("PNG", "JPEG", "BMP"), ("PNG", "JPEG", "BMP", "WebP", "TIFF")
_ORIENTATION = 0x0112  # EXIF tag; from 5 on, the image is rotated by a quarter turn


def check_image(path: Path) -> tuple[int, int]:
    """Return width and height of a PNG, JPEG or BMP file, px, from its header.

    Raises FileNotFoundError, or ValueError if it is none of these, or has more than `MOST_PIXELS` pixels.
    """
    with _opened(path, _DECODED) as image:
        return image.size


def read_image(path: Path, channels: tuple[int, ...] = ()) -> np.ndarray:
    """Return an image (H, W) or (H, W, C), C one of `channels`, in OpenCV's order, or without them its colours.

    Colours are (H, W, 3) uint8 RGB as viewers show them. Raises as `check_image`.
    """
    check_image(path)
    try:
        image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED if channels else cv2.IMREAD_COLOR_RGB)
    except cv2.error as error:
        raise ValueError(f"{path}: this image is damaged, {error}") from None
    found = None if image is None else 1 if image.ndim == 2 else image.shape[2]
    if image is None or found not in (channels or (3,)):
        wanted = " or ".join(map(str, channels or (3,)))
        raise ValueError(f"{path}: expected a readable image of {wanted} channels, found {found or 'none'}")
    return image


def upright_size(path: Path) -> tuple[int, int]:
    """Return width and height of a PNG, JPEG, BMP, WebP or TIFF file, px, as shown; errors as in `read_upright`."""
    with _opened(path, _UPRIGHT) as image:
        width, height = image.size
        turned = _has_exif(image) and image.getexif().get(_ORIENTATION, 1) >= 5
        return (height, width) if turned else (width, height)


def read_upright(path: Path) -> np.ndarray:
    """Return an image (H, W, 3) uint8 RGB as viewers show it: phones record their orientation in the EXIF data.

    Raises FileNotFoundError, or ValueError if it is damaged, of another format, or has more than `MOST_PIXELS` pixels.
    """
    with _opened(path, _UPRIGHT) as image:
        upright = ImageOps.exif_transpose(image) if _has_exif(image) else image
        if upright.mode.startswith("I"):
            grey = np.clip(np.asarray(upright).astype(np.int64) >> 8, 0, 255).astype(np.uint8)
            return np.repeat(grey[..., None], 3, -1)
        return np.array(upright.convert("RGB"))


def _has_exif(image: Image.Image) -> bool:
    """Return whether EXIF data may be there; Pillow would decode a whole PNG to search for them at its end."""
    return image.format != "PNG" or "exif" in image.info


@contextmanager
def _opened(path: Path, formats: tuple[str, ...]) -> Iterator[Image.Image]:
    """Open an image with Pillow, which reads its header; its errors become ValueErrors that name the file."""
    check_file(path)
    try:
        # Pillow warns of images that are refused here.
        with warnings.catch_warnings(action="ignore"), Image.open(path, formats=[*map(str.upper, formats)]) as image:
            if not 0 < image.size[0] * image.size[1] <= MOST_PIXELS:
                raise ValueError(
                    f"expected an image of at most {MOST_PIXELS} pixels, found {image.size[0]} x {image.size[1]}"
                )
            yield image
    except UnidentifiedImageError:
        raise ValueError(f"{path}: expected a {', '.join(formats[:-1])} or {formats[-1]} image") from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise ValueError(f"{path}: this image cannot be used, {error}") from None


def upright_frame(frame) -> np.ndarray:
    """Return a frame of a video, (H, W, 3) uint8 RGB, as players show it: phones record their orientation in it."""
    image = frame.to_ndarray(format="rgb24")
    quarters = round((getattr(frame, "rotation", 0) or 0) / 90)
    return np.ascontiguousarray(np.rot90(image, quarters)) if quarters % 4 else image


def open_video(path: Path):
    """Return the PyAV container of a video file; other files that it names are not opened.

    Raises FileNotFoundError, or ValueError if it contains no readable video, or one with too many pixels.
    """
    import av

    check_file(path)
    try:
        container = av.open(str(path), options={"protocol_whitelist": "file"})
    except (av.FFmpegError, ValueError) as error:
        raise ValueError(f"{path}: expected a video, found {getattr(error, 'strerror', None) or error}") from None
    try:
        context = container.streams.video[0].codec_context
        if context.width * context.height > MOST_PIXELS:
            raise ValueError(f"{path}: expected at most {MOST_PIXELS} pixels, found {context.width} x {context.height}")
        # A stream may become larger later.
        context.options = {"max_pixels": str(MOST_PIXELS)}
    except (IndexError, AttributeError, av.FFmpegError):
        container.close()
        raise ValueError(f"{path}: expected a video, found no stream that can be decoded") from None
    except ValueError:
        container.close()
        raise
    return container


def check_times(path: Path, times: Sequence[int | None]) -> None:
    """Raise ValueError if the images of a video have no times of their own: a raw stream has none, or all are equal."""
    if len(times) > 1 and len({*times}) < 2:
        # ffmpeg does not write a file onto itself.
        suffix = ".mkv" if path.suffix.lower() == ".mp4" else ".mp4"
        raise ValueError(
            f"{path}: its {len(times)} images have no times of their own, as in a stream that a camera wrote; write "
            f"them into a file that has times, with their rate: ffmpeg -r 25 -i {path.name} -c copy {path.stem}{suffix}"
        )


class VideoFrames:
    """The frames of an open video, in any order.

    Raises FileNotFoundError if there is no such file, and ValueError as `open_video` and `check_times`.
    """

    def __init__(self, path: Path):
        self._path = path
        self._container = open_video(path)
        # Videos are read in parallel by several processes, not threads.
        self._container.streams.video[0].codec_context.thread_count = 1
        packets = [packet for packet in self._container.demux(video=0) if packet.size]
        check_times(path, [packet.pts for packet in packets])
        packets = [packet for packet in packets if packet.pts is not None]
        self._times = sorted(packet.pts for packet in packets)
        self._keyframes = sorted(packet.pts for packet in packets if packet.is_keyframe)
        self._decoded: Iterator = iter(())
        self._last: int | None = None
        """Time of the frame that was decoded last."""

    def __len__(self) -> int:
        return len(self._times)

    def read(self, number: int) -> np.ndarray:
        """Return frame `number`, (H, W, 3) uint8.

        Raises FileNotFoundError if the video has fewer, or is cut short, and ValueError if it is damaged before.
        """
        import av

        if number >= len(self._times):
            raise FileNotFoundError(f"{self._path}: expected {number + 1} frames or more, found {len(self._times)}")
        wanted = self._times[number]
        before = bisect_right(self._keyframes, wanted)
        start = self._keyframes[before - 1] if before else self._times[0]  # no whole frame is before a damaged one
        if self._last is None or not start <= self._last < wanted:
            self._container.seek(start, stream=self._container.streams.video[0])
            self._decoded = self._container.decode(video=0)
        try:
            for frame in self._decoded:
                self._last = frame.pts
                if frame.pts == wanted:
                    return upright_frame(frame)
        except (av.FFmpegError, ValueError) as error:
            self._last = None
            raise ValueError(f"{self._path}: this video is damaged, {error}") from None
        self._last = None
        raise FileNotFoundError(f"{self._path}: frame {number} cannot be decoded; the video is damaged")


def kept_open(path: Path) -> VideoFrames:
    """Return a video that stays open until a few others are opened."""
    return _videos_of(os.getpid())(path, path.stat().st_mtime_ns if path.is_file() else 0)


@cache
def _videos_of(process: int) -> Callable[[Path, int], VideoFrames]:
    """Return the cache of the open videos of a process.

    A forked process opens its own, as an open file has one position, and leaves its parent's open: closing would wait
    for threads of the decoder, which it lacks.
    """
    return lru_cache(maxsize=4)(lambda path, modified: VideoFrames(path))
