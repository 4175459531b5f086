"""Data of the page's player: cameras, poses, truth and detections of a clip, compressed and inlined in the page."""

import base64
import io
import zlib
from collections.abc import Iterator, Sequence
from fractions import Fraction
from math import isfinite

import av
import cv2
import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.data.cameras import CameraRig, camera_label
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.conversion import convert
from dmae.numerics.paths import neighbours
from dmae.numerics.statistics import mean_known
from dmae.progress import progress
from dmae.reporting.figures import PERSONS

_UNIT_M = 0.001
_UNIT_PX = 0.5
_UNIT_SPREAD_M = 0.0005
_LARGEST = 32000
_FAR = 20  # Multiple of the longest side of the images; detections farther away are not shown


def window(frames: int, most: int, centre: int) -> slice:
    """Return the slice of the `most` frames around a centre, or of all frames if the clip has no more."""
    start = min(max(0, centre - most // 2), max(0, frames - most))
    return slice(start, min(frames, start + most))


def player_data(clip: Clip, first: int = 0, error: np.ndarray | None = None, notes: Sequence[str] = ()) -> dict:
    """Return the JSON-able data of a short clip, with or without poses and images. `window` cuts a long one.

    `first` is the number of its first frame in the clip that it was cut from; `error` (F,) the mean error of the joints
    of each frame, mm, NaN where unknown, None without truth; `notes` are sentences about missing data. Arrays are
    compressed and in base64, see `packed`.
    """
    videos, problem = small_videos(clip)
    poses, truth = clip.poses, clip.truth
    if truth is not None:
        # Of a fused skeleton, the part that the poses have, or else the first
        parts, wanted = truth.skeleton.parts, (poses or clip.detections).skeleton.name
        truth = convert(truth, next((part for part in parts if part.name == wanted), parts[0]))
    errors = None if error is None else [round(value, 1) if isfinite(value) else None for value in error.tolist()]
    return {
        "id": clip.id,
        "fps": clip.fps,
        "frames": len(clip),
        "first": first,
        "colours": PERSONS,
        "cameras": [_camera(clip.rig, view) | {"video": videos[view]} for view in range(len(clip.rig))],
        "poses": None if poses is None else _poses(poses, with_source=True),
        "truth": None if truth is None else _poses(truth, with_source=False),
        "detections": _detections(clip.detections, _FAR * int(clip.rig.size.max())),
        "error": errors,
        "notes": [*notes, *([problem] if problem else [])],
    }


def packed(values: np.ndarray) -> str:
    """Return numbers (F, ...) rounded to 16-bit integers, compressed, in base64. Values that are not finite are absent.

    The numbers are one series over time for each index after F. The compressed bytes are the differences over time of
    all series: first all low bytes, then all high bytes, then one flag per number that is 1 if it is known. An absent
    number repeats the previous value, so that gaps compress well.
    """
    series = values.reshape(len(values), -1).astype(np.float64)
    known = np.isfinite(series)
    whole = np.where(known, np.clip(np.round(np.where(known, series, 0)), -_LARGEST, _LARGEST), 0).astype(np.int16)
    before, _ = neighbours(known)
    held = np.where(before < 0, 0, np.take_along_axis(whole, np.maximum(before, 0), 0)).T.view(np.uint16)
    steps = np.diff(held, axis=1, prepend=np.zeros((len(held), 1), np.uint16))
    planes = np.stack([steps & 0xFF, steps >> 8, known.T]).astype(np.uint8)
    return base64.b64encode(zlib.compress(planes.tobytes())).decode()


def _poses(poses: Poses3D, *, with_source: bool) -> dict:
    xyz = poses.xyz.astype(np.float64)
    known = xyz[np.isfinite(xyz).all(-1)]
    low, high = (known.min(0), known.max(0)) if len(known) else (np.zeros(3), np.zeros(3))
    origin = (low + high) / 2
    unit = max(_UNIT_M, float((high - low).max()) / 2 / _LARGEST)
    data = {
        "joints": poses.skeleton.joints,
        "bones": poses.skeleton.bones,
        "persons": xyz.shape[1],
        "origin": origin.tolist(),
        "unit": unit,
        "xyz": packed((xyz - origin) / unit),
    }
    if with_source:
        data["source"] = packed(poses.source)
        data |= {"spreadUnit": _UNIT_SPREAD_M, "spread": packed(_spread(poses) / _UNIT_SPREAD_M)}
    return data


def _spread(poses: Poses3D) -> np.ndarray:
    """Return the symmetric square roots (F, P, J, 6) of the covariances, m: xx xy xz yy yz zz; NaN where unknown."""
    roots = np.full((*poses.cov.shape[:3], 3, 3), np.nan)
    known = np.isfinite(poses.cov).all((-1, -2)) & np.isfinite(poses.xyz).all(-1)
    if known.any():
        values, vectors = np.linalg.eigh(poses.cov[known].astype(np.float64))
        roots[known] = (vectors * np.sqrt(np.maximum(values, 0))[:, None]) @ vectors.swapaxes(-1, -2)
    rows, columns = np.triu_indices(3)
    return roots[..., rows, columns]


def _detections(detections: Detections2D, reach: int) -> dict:
    """Return detections within `reach` px: a joint far outside the images would take the precision of all others."""
    with np.errstate(invalid="ignore"):
        places = _steady(np.where((np.abs(detections.xy) <= reach).all(-1, keepdims=True), detections.xy, np.nan))
    unit = max(_UNIT_PX, float(np.nanmax(np.abs(places), initial=0)) / _LARGEST)
    return {
        "joints": detections.skeleton.joints,
        "bones": detections.skeleton.bones,
        "number": places.shape[2],
        "unit": unit,
        "xy": packed(places / unit),
    }


def _steady(xy: np.ndarray) -> np.ndarray:
    """Reorder detections (F, V, D, J, 2) to series of the nearest one, which compress well; drop unused indices."""
    centre = mean_known(xy, 3)
    order = np.zeros(xy.shape[:3], int)
    for view in range(xy.shape[1]):
        last = np.full((xy.shape[2], 2), -1e6)  # places without a detection are far from everything
        for frame in range(len(xy)):
            known = np.isfinite(centre[frame, view]).all(-1)
            here = np.where(known[:, None], centre[frame, view], 1e6)
            places, detections = linear_sum_assignment(np.abs(here[None] - last[:, None]).sum(-1))
            order[frame, view, places] = detections
            filled = known[detections]
            last[places[filled]] = here[detections[filled]]
    placed = np.take_along_axis(xy, order[..., None, None], 2)
    return placed[:, :, np.isfinite(placed).any((0, 1, 3, 4))]


def _camera(rig: CameraRig, view: int) -> dict:
    reach = float(rig.reach[view])
    return {
        "name": rig.names[view],
        "K": [float(rig.K[view, row, column]) for row, column in ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2))],
        "dist": np.pad(rig.dist[view], (0, 8 - rig.dist.shape[1])).tolist(),
        "fisheye": bool(rig.fisheye[view]),
        "reach": reach if isfinite(reach) else None,
        "R": rig.cam_from_world[view, :3, :3].ravel().tolist(),
        "t": rig.cam_from_world[view, :3, 3].tolist(),
        "size": rig.size[view].tolist(),
    }


# Videos, so small that the page can contain them

_BITS_OF_CLIP = 60_000_000
"""Bits of all cameras of a clip together, 10 MB in base64: one minute of five cameras at the least rate."""
_BITS = 200_000, 1_200_000
"""Bits/s of a camera: the least, for long clips, and the greatest, for clips of a few seconds."""
_WIDTHS = {200_000: 480, 400_000: 640, 800_000: 960}
"""Longer side in px, by the least rate at which it is used. Of 480 to 1138 px it shows ankles most like the original at
that rate (in Pose2Sim's videos 26.1, 29.1 and 31.8 dB; at 200 kbit/s 640 px reach 25.7)."""


def small_videos(clip: Clip) -> tuple[list[str | None], str | None]:
    """Return an H.264 video in base64 for each view, None without images, and a sentence on unreadable images, if any.

    Frame i of a video is frame i of the clip. Keyframes are half a second apart, so that a player can seek quickly.
    """
    if clip.images is None or not clip.has_images or not len(clip):
        return [None] * len(clip.rig), None
    videos: list[str | None] = []
    lost = []
    least, most = _BITS
    rate = int(np.clip(_BITS_OF_CLIP * clip.fps / len(clip) / len(clip.rig), least, most))
    greatest = max(width for bits, width in _WIDTHS.items() if bits <= rate)
    for name, size in zip(progress(clip.rig.names, f"images of {clip.id}"), clip.rig.size, strict=True):
        width, height = (int(side) for side in size)
        scale = min(1, greatest / max(width, height))
        width, height = (max(2, round(side * scale / 2) * 2) for side in (width, height))  # as H.264 requires
        try:
            video = _encoded(clip.images.read("rgb", name), clip.fps, (width, height), rate)
            videos.append(base64.b64encode(video).decode())
        except (OSError, KeyError, av.FFmpegError):
            videos.append(None)
            lost.append(name)
    if not lost:
        return videos, None
    cameras = camera_label(lost[0]) if len(lost) == 1 else f"cameras {', '.join(lost)}"
    return videos, f"The images of {cameras} cannot be read in the folder that the clip names."


def _encoded(frames: Iterator[np.ndarray], fps: float, size: tuple[int, int], rate: int) -> bytes:
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
            small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(small, format="rgb24")))
        container.mux(stream.encode())
    return buffer.getvalue()
