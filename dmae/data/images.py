"""The images of a clip: colour as H.264, PNG or JPEG; depth, ids, body parts, normals, flow, whole persons as PNG."""

import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np

from dmae.data.array_fields import short_repr
from dmae.data.labels import KINDS as KINDS
from dmae.files.checks import child
from dmae.files.contents import cached_until_changed
from dmae.files.images import VideoFrames, kept_open, read_image

RGB_FILES = {"h264": "mp4", "png": "png", "jpeg": "jpg"}
"""Formats of colour images, and the suffixes of their files."""
FIRST_OBJECT_ID = 256
"""Ids in an image: 0 nothing, 1 + p person p, 256 + k object k of `OcclusionLabels.objects`."""
_NORMAL_STEPS, _FLOW_STEPS, _FLOW_ZERO = 127, 64, 32768
_JPEG_QUALITY = 95
_CHANNELS = {"normals": (3,), "flow": (3,), "amodal": (1, 3)}
"""Possible numbers of channels in the file of an image, by kind. Other kinds have one channel."""


@dataclass(frozen=True)
class Images:
    """Images on disk, read on demand."""

    # Contains `rgb/<view>.mp4`, or `rgb/<view>/<frame>.png` or `.jpg`, and for the other kinds
    # `<kind>/<view>/<frame>.png`
    folder: Path
    views: tuple[str, ...]  # Camera names
    frames: tuple[int, ...]  # Numbers of the frames in the files
    kinds: tuple[str, ...] = KINDS  # The kinds in `KINDS` that exist
    parts: tuple[str, ...] = ()  # Names of the parts of bodies. In images of parts, 0 is no person and 1 + i is part i.
    rgb: str = "h264"  # Format of colour images, a key of `RGB_FILES`
    # Names of the videos in `folder`, one per view, if they are not `rgb/<view>.mp4`. If `rgb` is `png`, names of
    # folders of image files instead. Frame n is then the n-th file, sorted by the numbers in their names.
    files: tuple[str, ...] = ()
    # (left, top) px of the black border around colour images, one per view, that is cut off on all sides; () for none
    borders: tuple[tuple[int, int], ...] = ()

    __repr__ = short_repr

    def __post_init__(self):
        if self.files and len(self.files) != len(self.views):
            raise ValueError(f"images: expected a file for each of {len(self.views)} views, found {len(self.files)}")
        if self.borders and (len(self.borders) != len(self.views) or min(map(min, self.borders)) < 0):
            raise ValueError(f"images: expected borders from 0 on for {len(self.views)} views, found {self.borders}")
        if self.rgb not in RGB_FILES:
            raise ValueError(f"images: expected colour as one of {', '.join(RGB_FILES)}, found {self.rgb!r}")

    def select(self, frames, views: tuple[str, ...]) -> "Images":
        """Return the images of some frames (a slice or a list of indices) and of the given views (names)."""
        files = tuple(self.files[self.views.index(view)] for view in views) if self.files else ()
        chosen = tuple(int(i) for i in np.asarray(self.frames)[frames])
        borders = tuple(self.borders[self.views.index(view)] for view in views) if self.borders else ()
        return replace(self, views=views, frames=chosen, files=files, borders=borders)

    def read(self, kind: str, view: str) -> Iterator[np.ndarray]:
        """Yield the images of one kind and one view, in the order of frames, as `at` reads each."""
        self._check(kind, view)
        read = self.opened(view) if kind == "rgb" else partial(self.at, kind, view)
        yield from map(read, range(len(self.frames)))

    def opened(self, view: str) -> Callable[[int], np.ndarray]:
        """Return a function from an index into `frames` to a colour image, as `at`, which keeps its video open.

        However many views are read in turn, each is then decoded once if its frames are read in their order.
        """
        return partial(self._colour, cache(VideoFrames), view)

    def at(self, kind: str, view: str, frame: int) -> np.ndarray:
        """Return one image of a kind and view, at an index into `frames`.

        Each process keeps a few videos open. A video is decoded from the keyframe before the frame, or from the frame
        that was read last.

        Returns:
            rgb (H, W, 3) uint8; depth (H, W) float32, m along the optical axis; ids (H, W) uint16; parts (H, W) uint8;
            normals (H, W, 3) float32, unit vectors, world; flow (H, W, 2) float32, px, motion of the surface at a pixel
            until the next frame, even if the surface is then hidden; amodal (H, W) uint32, bit p is 1 at pixels that
            would show person p if nothing else were there. Depth, normals and flow are NaN where there is no surface or
            the flow is unknown.

        Raises KeyError for another kind or view, IndexError for another frame, FileNotFoundError if it is missing on
        disk, and ValueError if a file is damaged, or has more pixels than `dmae.files.images` allows.
        """
        self._check(kind, view)
        if not -len(self.frames) <= frame < len(self.frames):
            raise IndexError(f"no frame {frame} of images; there are {len(self.frames)}, from 0")
        if kind == "rgb":
            return self._colour(kept_open, view, frame)
        return _read_image(kind, self.path(kind, view, self.frames[frame]))

    def _colour(self, opened: Callable[[Path], VideoFrames], view: str, frame: int) -> np.ndarray:
        number = self.frames[frame]
        path = self.path("rgb", view, number)
        image = opened(path).read(number) if self.rgb == "h264" else read_image(path)
        left, top = self.borders[self.views.index(view)] if self.borders else (0, 0)
        height, width = image.shape[:2]
        return image[top : height - top, left : width - left]

    def path(self, kind: str, view: str, frame: int = 0) -> Path:
        """Return the path of an image; `frame` is the number of the frame in the files, as in `frames`."""
        if kind == "rgb" and self.files:
            found = child(self.folder, self.files[self.views.index(view)], "video")
            return found if self.rgb == "h264" else _numbered(found, frame)
        if kind == "rgb" and self.rgb == "h264":
            return child(self.folder / "rgb", f"{view}.mp4", "camera")
        ending = RGB_FILES[self.rgb] if kind == "rgb" else "png"
        return child(self.folder / kind, view, "camera") / f"{frame:06d}.{ending}"

    def _check(self, kind: str, view: str) -> None:
        if kind not in self.kinds or view not in self.views:
            there = f"{', '.join(self.kinds)} of the cameras {', '.join(map(repr, self.views))}"
            raise KeyError(f"no {kind} images of view {view!r}; there are {there}")


@cached_until_changed(64)
def image_files(folder: Path) -> tuple[Path, ...]:
    """Return the PNG and JPEG files of a folder, sorted by the numbers in their names."""
    files = (file for file in folder.glob("*") if file.suffix.lower() in (".png", ".jpg", ".jpeg"))
    numbered = ((tuple(int(part) for part in re.findall(r"\d+", file.stem)), file.name, file) for file in files)
    return tuple(file for *_, file in sorted(numbered))


def _numbered(folder: Path, frame: int) -> Path:
    files = image_files(folder)
    if not 0 <= frame < len(files):
        raise FileNotFoundError(f"{folder}: expected an image of frame {frame}, found {len(files)}")
    return files[frame]


def _read_image(kind: str, path: Path) -> np.ndarray:
    # The order of OpenCV's channels is blue, green, red.
    image = read_image(path, _CHANNELS.get(kind, (1,)))
    if kind == "depth":
        return np.where(image > 0, image / np.float32(1000), np.float32(np.nan))
    if kind == "normals":
        normals = (image[..., ::-1].astype(np.float32) - 1) / _NORMAL_STEPS - 1
        normals[image[..., 0] == 0] = np.nan
        length = np.linalg.norm(normals, axis=-1, keepdims=True)
        if (length == 0).any():
            raise ValueError(f"{path}: expected directions of surfaces, found a pixel of length 0")
        return normals / length
    if kind == "flow":
        flow = (image[..., :0:-1].astype(np.float32) - _FLOW_ZERO) / np.float32(_FLOW_STEPS)
        flow[image[..., 0] == 0] = np.nan
        return flow
    if kind == "amodal":
        planes = np.atleast_3d(image).astype(np.uint32)
        return planes[..., -1] if planes.shape[-1] == 1 else planes[..., 2] | planes[..., 1] << 16
    return image


def write_video(path: Path, frames: Iterable[np.ndarray], fps: float) -> None:
    """Write an H.264 video that browsers can play, of images (H, W, 3) uint8 RGB; stills are shown for a second each.

    Raises ValueError if there are no frames, or width or height is odd.
    """
    import av

    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w") as container:
        stream = None
        for image in frames:
            if stream is None:
                stream = container.add_stream("libx264", rate=Fraction(max(fps, 1)).limit_denominator(1000))
                stream.height, stream.width = image.shape[:2]
                if stream.height % 2 or stream.width % 2:
                    raise ValueError(
                        f"{path}: H.264 needs even width and height, found {stream.width} x {stream.height}"
                    )
                stream.pix_fmt, stream.options = "yuv420p", {"crf": "20", "preset": "veryfast"}
                # One keyframe per second, for random access.
                stream.options |= {"g": str(max(1, round(fps)))}
                # The bytes must not depend on the number or the type of CPU cores. Without this option, x264 encodes
                # the same images differently from run to run if the width is not a multiple of 16.
                stream.codec_context.thread_count = 1
                stream.options |= {"x264-params": "cpu-independent=1"}
            for packet in stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")):
                container.mux(packet)
        if stream is None:
            raise ValueError(f"{path}: no frames to write")
        for packet in stream.encode():
            container.mux(packet)


def depth_steps(depth: np.ndarray) -> np.ndarray:
    """Return depth (H, W), m, as uint16 mm; 0 where it is NaN or at least 65.5 m."""
    known = np.isfinite(depth) & (depth < 65.5)
    return np.where(known, np.round(np.where(known, depth, 0) * 1000), 0).astype(np.uint16)


def write_image(kind: str, path: Path, image: np.ndarray) -> None:
    """Write an image of a kind in `KINDS`, as `Images.at` returns it; its folder is made.

    rgb: PNG or, if the path ends in .jpg, JPEG.
    depth: 16-bit PNG of `depth_steps`.
    ids, parts: PNG of 16 and 8 bits.
    normals: 8-bit PNG of 1 + 127 (n + 1) for a unit vector n, to half a degree; 0 where it is NaN.
    flow: KITTI's format, a 16-bit PNG of 64 u + 32768, 64 v + 32768, and 1 where (u, v) is known, which is not NaN and
        at most 511 px.
    amodal: 16-bit PNG of the bits of up to 32 persons; green contains bits 16 to 31, if any is set.
    """
    # The order of OpenCV's channels is blue, green, red.
    if kind == "rgb":
        image = np.ascontiguousarray(image[..., ::-1])
    elif kind == "depth":
        image = depth_steps(image)
    elif kind == "ids":
        image = image.astype(np.uint16)
    elif kind == "parts":
        image = image.astype(np.uint8)
    elif kind == "normals":
        known = np.isfinite(image).all(-1, keepdims=True)
        steps = 1 + np.round((np.where(known, image, 0) + 1) * _NORMAL_STEPS)
        image = (steps * known)[..., ::-1].astype(np.uint8)
    elif kind == "flow":
        known = (np.abs(image) < _FLOW_ZERO / _FLOW_STEPS - 1).all(-1)
        steps = np.round(np.where(known[..., None], image, 0) * _FLOW_STEPS + _FLOW_ZERO) * known[..., None]
        image = np.dstack([known, steps[..., 1], steps[..., 0]]).astype(np.uint16)
    elif kind == "amodal":
        low, high = image & 0xFFFF, image >> 16
        image = (np.dstack([0 * low, high, low]) if high.any() else low).astype(np.uint16)
    how = [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY] if path.suffix == ".jpg" else [cv2.IMWRITE_PNG_COMPRESSION, 1]
    if kind in ("ids", "parts"):
        # This takes a third of the time of OpenCV's default, for the same file size.
        how += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_UP]
    path.parent.mkdir(parents=True, exist_ok=True)
    if not cv2.imwrite(str(path), image, how):
        raise OSError(f"{path}: could not write the image")
