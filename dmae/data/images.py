"""The images of a clip: H.264 video for colour, 16-bit PNGs for depth and ids, 8-bit ones for parts of bodies."""

import os
from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, lru_cache, partial
from pathlib import Path

import cv2
import numpy as np

from dmae.files.names import child
from dmae.files.pictures import read_grey_png
from dmae.files.videos import open_video

KINDS = ("rgb", "depth", "ids", "parts")
FIRST_OBJECT_ID = 256
"""Ids in an image: 0 nothing, 1 + p person p, 256 + k object k of `OcclusionLabels.objects`."""


@dataclass(frozen=True)
class Images:
    """Images on disk, read on demand.

    Attributes:
        folder: Holds `rgb/<view>.mp4`, and `depth/<view>/<frame>.png`, `ids/...` and `parts/...` likewise.
        views: Camera names.
        frames: Numbers of the frames in the files.
        kinds: Those of `KINDS` that exist.
        parts: Names of the parts of bodies. In images of parts, 0 is no person and 1 + i is part i.
    """

    folder: Path
    views: tuple[str, ...]
    frames: tuple[int, ...]
    kinds: tuple[str, ...] = KINDS
    parts: tuple[str, ...] = ()

    def select(self, frames, views: tuple[str, ...]) -> "Images":
        """Return the images of some frames (a slice or a list of indices) and of the named views."""
        return replace(self, views=views, frames=tuple(int(i) for i in np.asarray(self.frames)[frames]))

    def read(self, kind: str, view: str) -> Iterator[np.ndarray]:
        """Yield the frames of one view in order.

        Yields:
            rgb (H, W, 3) uint8; depth (H, W) float32 m along the optical axis, NaN where no surface is;
            ids (H, W) uint16; parts (H, W) uint8.

        Raises:
            KeyError: no such kind or view.
            FileNotFoundError: a frame is missing on disk.
            ValueError: a file is damaged, or has more pixels than a picture can.
        """
        self._check(kind, view)
        if kind == "rgb":
            for convert in self.video(view):
                yield convert()
            return
        for frame in self.frames:
            yield self._png(kind, view, frame)

    def at(self, kind: str, view: str, frame: int) -> np.ndarray:
        """Return one image, as `read` yields it.

        Videos are kept open, a few in each process, and decoded from the keyframe before the frame, or on from the
        frame that was read last.

        Args:
            frame: Index into `frames`.

        Raises:
            KeyError: no such kind or view.
            IndexError: no such frame.
            FileNotFoundError: the frame is missing on disk.
        """
        self._check(kind, view)
        number = self.frames[frame]
        if kind == "rgb":
            return _kept_open(child(self.folder / "rgb", f"{view}.mp4", "camera")).read(number)
        return self._png(kind, view, number)

    def _check(self, kind: str, view: str) -> None:
        if kind not in self.kinds or view not in self.views:
            raise KeyError(f"no {kind} images of view {view!r}; there are {self.kinds} of {self.views}")

    def _png(self, kind: str, view: str, frame: int) -> np.ndarray:
        image = read_grey_png(child(self.folder / kind, view, "camera") / f"{frame:06d}.png")
        return np.where(image > 0, image / np.float32(1000), np.float32(np.nan)) if kind == "depth" else image

    def video(self, view: str) -> Iterator[Callable[[], np.ndarray]]:
        """Yield functions that return the images of `read("rgb", view)`: frames that are skipped are not converted."""
        import av

        path, wanted, last = child(self.folder / "rgb", f"{view}.mp4", "camera"), set(self.frames), max(self.frames)
        found = 0
        with open_video(path) as container:
            try:
                for number, frame in enumerate(container.decode(video=0)):
                    if number in wanted:
                        found += 1
                        yield partial(frame.to_ndarray, format="rgb24")
                    if number == last:
                        break
            except (av.FFmpegError, ValueError) as error:
                raise ValueError(f"{path}: this video is damaged, {error}") from None
        if found != len(self.frames):
            raise FileNotFoundError(f"{path}: expected {len(self.frames)} frames, up to {last}; found {found}")


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
        # Whoever reads in parallel does so in several processes.
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


def _kept_open(path: Path) -> VideoFrames:
    """Return a video, which stays open until a few others were opened."""
    return _videos_of(os.getpid())(path, path.stat().st_mtime_ns if path.is_file() else 0)


@cache
def _videos_of(process: int) -> Callable[[Path, int], VideoFrames]:
    """Return what keeps the open videos of a process.

    A process that was forked opens its own, for a file is read from one place at a time. It leaves those of its parent
    alone: to close them it would wait for threads of the decoder, which do not live on in it.
    """
    return lru_cache(maxsize=4)(lambda path, modified: VideoFrames(path))


def write_video(path: Path, frames: Iterable[np.ndarray], fps: float) -> None:
    """Write H.264 that a browser plays, from (H, W, 3) uint8 RGB frames of even width and height.

    Raises:
        ValueError: no frames, or an odd width or height.
    """
    import av

    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = None
        for image in frames:
            if stream is None:
                stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
                stream.height, stream.width = image.shape[:2]
                if stream.height % 2 or stream.width % 2:
                    raise ValueError(
                        f"{path}: H.264 needs even width and height, found {stream.width} x {stream.height}"
                    )
                stream.pix_fmt, stream.options = "yuv420p", {"crf": "20", "preset": "veryfast"}
                # A whole frame a second, for random access.
                stream.options |= {"g": str(max(1, round(fps)))}
                # The bytes must not depend on the number of cores.
                stream.codec_context.thread_count = 1
            for packet in stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")):
                container.mux(packet)
        if stream is None:
            raise ValueError(f"{path}: no frames to write")
        for packet in stream.encode():
            container.mux(packet)


def write_depth(path: Path, depth: np.ndarray) -> None:
    """Write depth (H, W), m, as a 16-bit PNG of millimetres; 0 where it is NaN or beyond 65 m."""
    known = np.isfinite(depth) & (depth < 65.5)
    _write_png(path, np.where(known, np.round(np.where(known, depth, 0) * 1000), 0).astype(np.uint16))


def write_ids(path: Path, ids: np.ndarray) -> None:
    """Write ids (H, W) as a 16-bit PNG."""
    _write_png(path, ids.astype(np.uint16))


def write_parts(path: Path, parts: np.ndarray) -> None:
    """Write parts (H, W) as an 8-bit PNG."""
    _write_png(path, parts.astype(np.uint8))


def _write_png(path: Path, image: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, 1]):
        raise OSError(f"{path}: could not write PNG")
