"""Videos of the page's player: images of a clip, compressed so that the page can contain them."""

import base64
import io
from collections.abc import Iterator
from fractions import Fraction

import av
import cv2
import numpy as np

from dmae.data.clip import Clip
from dmae.progress import progress

_BITS_OF_RIG = 1_000_000
"""bit/s of all cameras together: one minute of five cameras takes about 10 MB in base64."""
_BITS_OF_CAMERA = 400_000
_WIDTH = 480
"""px; smaller if many cameras share the bit rate."""


def small_videos(clip: Clip) -> tuple[list[str | None], str | None]:
    """Return an H.264 video in base64 for each view, and a sentence on images that cannot be read.

    The video is None for a view without images. The sentence is None if all images can be read. Frame i of a video is
    frame i of the clip. Keyframes are half a second apart, so that a player can seek quickly.
    """
    if clip.images is None or "rgb" not in clip.images.kinds or not len(clip):
        return [None] * len(clip.rig), None
    videos: list[str | None] = []
    lost = []
    for name, size in zip(progress(clip.rig.names, f"pictures of {clip.id}"), clip.rig.size, strict=True):
        try:
            frames = (convert() for convert in clip.images.video(name))
            video = _encoded(frames, clip.fps, _fitted(size, len(clip.rig)), len(clip.rig))
            videos.append(base64.b64encode(video).decode())
        except (OSError, KeyError, av.FFmpegError):
            videos.append(None)
            lost.append(name)
    if not lost:
        return videos, None
    return (
        videos,
        f"The pictures of {_listed(lost)} cannot be read in the folder that the clip names.",
    )


def _listed(names: list[str]) -> str:
    return f"camera {names[0]}" if len(names) == 1 else f"cameras {', '.join(names)}"


def _fitted(size: np.ndarray, views: int) -> tuple[int, int]:
    """Return the width and height of a video, px. Both are even, as H.264 requires."""
    width, height = (int(side) for side in size)
    scale = min(1, (_WIDTH if views <= 8 else _WIDTH * 2 // 3) / max(width, height * 4 / 3))
    return max(2, round(width * scale / 2) * 2), max(2, round(height * scale / 2) * 2)


def _encoded(frames: Iterator[np.ndarray], fps: float, size: tuple[int, int], views: int) -> bytes:
    rate = min(_BITS_OF_CAMERA, _BITS_OF_RIG // views)
    buffer = io.BytesIO()
    with av.open(buffer, "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        stream.options = {
            "crf": "27",
            "preset": "veryfast",
            "g": str(max(1, round(fps / 2))),
            "bf": "0",  # frames in the order of time, so that the player can count them
            "maxrate": str(rate),
            "bufsize": str(rate),
        }
        stream.codec_context.thread_count = 1
        for image in frames:
            small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(small, format="rgb24")))
        container.mux(stream.encode())
    return buffer.getvalue()
