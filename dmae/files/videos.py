"""Videos. Those with more pixels than a picture may have, or that refer to other files, are not decoded."""

import os
from bisect import bisect_right
from collections.abc import Callable
from functools import cache, lru_cache
from pathlib import Path

import numpy as np

from dmae.files.contents import check_file
from dmae.files.pictures import MOST_PIXELS


def open_video(path: Path):
    """Return the PyAV container of a video file; other files that it names are not opened.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it contains no readable video, or one with too many pixels.
    """
    import av

    check_file(path)
    try:
        container = av.open(str(path), options={"protocol_whitelist": "file"})
    except (av.FFmpegError, ValueError) as error:
        raise ValueError(f"{path}: expected a video, {error}") from None
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


class VideoFrames:
    """The frames of an open video, in any order.

    Args:
        path: The video.

    Raises:
        FileNotFoundError: there is no such video.
    """

    def __init__(self, path: Path):
        self._path = path
        self._container = open_video(path)
        # Videos are read in parallel by several processes, not threads.
        self._container.streams.video[0].codec_context.thread_count = 1
        packets = [packet for packet in self._container.demux(video=0) if packet.pts is not None]
        self._times = sorted(packet.pts for packet in packets)
        self._keyframes = sorted(packet.pts for packet in packets if packet.is_keyframe)
        self._decoded = iter(())
        self._last: int | None = None
        """Time of the frame that was decoded last."""

    def read(self, number: int) -> np.ndarray:
        """Return frame `number`, (H, W, 3) uint8.

        Raises:
            FileNotFoundError: the video has fewer frames, or is cut short.
        """
        if number >= len(self._times):
            raise FileNotFoundError(f"{self._path}: expected a frame {number}, found {len(self._times)} frames")
        wanted = self._times[number]
        start = self._keyframes[bisect_right(self._keyframes, wanted) - 1]
        if self._last is None or not start <= self._last < wanted:
            self._container.seek(start, stream=self._container.streams.video[0])
            self._decoded = self._container.decode(video=0)
        for frame in self._decoded:
            self._last = frame.pts
            if frame.pts == wanted:
                return frame.to_ndarray(format="rgb24")
        self._last = None
        raise FileNotFoundError(f"{self._path}: frame {number} cannot be decoded; the video is damaged")


def kept_open(path: Path) -> VideoFrames:
    """Return a video that stays open until a few others are opened."""
    return _videos_of(os.getpid())(path, path.stat().st_mtime_ns if path.is_file() else 0)


@cache
def _videos_of(process: int) -> Callable[[Path, int], VideoFrames]:
    """Return the cache of the open videos of a process.

    A forked process opens its own videos, because an open file has one position. It does not close those of its parent:
    that would wait for threads of the decoder, which do not exist in the forked process.
    """
    return lru_cache(maxsize=4)(lambda path, modified: VideoFrames(path))
