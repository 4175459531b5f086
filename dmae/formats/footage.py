"""Videos and images of a recording, one file or folder per camera, as the images of its clip.

They can have another size than the calibration: scaling and black borders are found and undone.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dmae.data.cameras import camera_label
from dmae.data.clip import Clip
from dmae.data.images import Images, image_files
from dmae.files.checks import VIDEOS, check_rate
from dmae.files.images import kept_open, open_video, read_image, upright_frame, upright_size
from dmae.formats.recordings import by_name, match_cameras, plain


def video_rate(folder: Path) -> float | None:
    """Return the frames per second of the first video in a folder that states its rate; None if no video does."""
    for path in sorted(folder.glob("*")):
        try:
            with open_video(path) as video:
                rate = video.streams.video[0].average_rate
        except (ValueError, FileNotFoundError, IsADirectoryError):
            continue
        if rate:
            return check_rate(f"{path}: frame rate", float(rate))
    return None


def with_videos(clip: Clip, folder: Path) -> Clip:
    """Return the clip with the videos of a folder, one per camera as in `match_cameras`, as its colour images.

    Frame n of a video, counted from 0, is frame number n of the detections. If the videos are too short for this but
    long enough for the clip, they start at its first frame. If images have another size than the calibration, a black
    border is cut off and the rest scaled, as `dmae run` does; if that does not fit either, they are stretched when they
    are drawn. A note in `provenance["notes"]` reports each of these cases.

    Raises:
        FileNotFoundError: the folder contains no videos.
        ValueError: a camera has no video, or a video is damaged or has too few frames.
    """
    files = [file for file in Path(folder).glob("*") if file.suffix.lower() in VIDEOS]
    if not files:
        raise FileNotFoundError(f"{folder}: expected a video for each camera, <camera>.mp4, found none")
    matching = {"what": "videos", "options": "data.videos=..."}
    ordered, notes = _by_camera(clip, Path(folder), files, "a video for each camera", **matching)
    counts: list[int] = []
    borders: list[tuple[int, int]] = []
    for file, size, name in zip(ordered, clip.rig.size.tolist(), clip.rig.names, strict=True):
        with open_video(file) as video:
            # Some containers do not state the number.
            counts.append(video.streams.video[0].frames or len(kept_open(file)))
            found = _size_of_frames(video)
        at = {0, counts[-1] // 2} if found != size else ()
        borders.append(_border(name, file.name, found, size, [kept_open(file).read(frame) for frame in at], notes))
    first = clip.provenance.get("first_frame", 0)
    least = min(counts)
    if least < first + len(clip):
        if least < len(clip):
            short = ordered[counts.index(least)]
            raise ValueError(f"{short}: expected {len(clip)} frames or more, as the detections have, found {least}")
        notes.append(f"the first frame of the videos is assumed to be frame {first}, as they have {least} frames")
        first = 0
    return _with_images(clip, Path(folder), ordered, first, notes, borders)


def with_images(clip: Clip, folder: Path) -> Clip:
    """Return the clip with a folder's image files, in one folder per camera as in `match_cameras`, as colour images.

    A file is the first frame of the clip if its name ends with the number of that frame, and if it has the same
    position in every folder. Otherwise the first file is frame 0 or, if there are too few files for this, the first
    frame of the clip; a note states the assumption. Another note says if images have another size than in the
    calibration.

    Raises:
        FileNotFoundError: the folder contains no folders of images.
        ValueError: a camera has no images or too few of them, or an image is damaged.
    """
    folders = [each for each in Path(folder).glob("*") if each.is_dir() and image_files(each)]
    if not folders:
        raise FileNotFoundError(f"{folder}: expected a folder of PNG or JPEG files for each camera, found none")
    matching = {"what": "images", "options": "data.images=..."}
    ordered, notes = _by_camera(clip, Path(folder), folders, "images of each camera", **matching)
    files = [image_files(each) for each in ordered]
    borders: list[tuple[int, int]] = []
    for each, size, name in zip(files, clip.rig.size.tolist(), clip.rig.names, strict=True):
        found = list(upright_size(each[0]))
        sample = [read_image(each[0])] if found != size else []
        borders.append(_border(name, each[0].name, found, size, sample, notes))
        if len(each) < len(clip):
            parent = each[0].parent
            raise ValueError(f"{parent}: expected {len(clip)} images or more, one for each frame, found {len(each)}")
    first, least = clip.provenance.get("first_frame", 0), min(map(len, files))
    places = {_index_of_number(each, first) for each in files}
    start = places.pop() if len(places) == 1 else None
    if start is None or least < start + len(clip):
        start = first if least >= first + len(clip) else 0
        notes.append(f"the first of the {least} images is assumed to be frame {first - start}")
    return _with_images(clip, Path(folder), ordered, start, notes, borders, rgb="png")


def _size_of_frames(video) -> list[int]:
    """Return width and height, px, of the frames of an open video as players show them."""
    import av

    try:
        height, width, _ = upright_frame(next(video.decode(video=0))).shape
    except (av.FFmpegError, StopIteration):
        stream = video.streams.video[0]
        return [stream.width, stream.height]
    return [width, height]


def _border(
    camera: str, file: str, found: list[int], size: list[int], sample: list[np.ndarray], notes: list[str]
) -> tuple[int, int]:
    """Return (left, top) px of the black border of a camera's images, and note another size than the calibration's."""
    if found == size:
        return 0, 0
    try:
        fitting = fit_images(camera, (found[0], found[1]), (size[0], size[1]), np.stack(sample))
    except ValueError:
        images, calibrated = (" x ".join(map(str, each)) for each in (found, size))
        notes.append(
            f"{camera_label(camera)}: {file} has images of {images} px, the calibration says {calibrated}; they "
            "are stretched, so that people can be drawn beside where they are seen"
        )
        return 0, 0
    notes.append(f"{camera_label(camera)}: {fitting.note}")
    left, top = fitting.margin
    return round(left), round(top)


def _by_camera(
    clip: Clip, folder: Path, items: Iterable[Path], expected: str, **matching: str
) -> tuple[list[Path], list[str]]:
    """Return the video or folder of each camera, and a note if they are not matched by name."""
    items = by_name(items)
    names = [item.name if item.is_dir() else item.stem for item in items]
    wanted = set(map(plain, clip.rig.names))
    if wanted <= set(map(plain, names)):
        # A clip of some cameras (`data.cameras`) needs not all images.
        used = [place for place, name in enumerate(names) if plain(name) in wanted]
        items, names = [items[place] for place in used], [names[place] for place in used]
    index, how = match_cameras(names, clip.rig, folder, **matching)
    lacking = [name for view, name in enumerate(clip.rig.names) if view not in index]
    if lacking:
        raise ValueError(f"{folder}: expected {expected}, found none of {', '.join(lacking)}")
    return [items[index.index(view)] for view in range(len(clip.rig))], [how] if how else []


def _with_images(
    clip: Clip, folder: Path, ordered: list[Path], start: int, notes: list[str], borders: list, **options
) -> Clip:
    frames, names = tuple(range(start, start + len(clip))), tuple(item.name for item in ordered)
    cut = tuple(borders) if any(map(any, borders)) else ()
    images = Images(folder, clip.rig.names, frames, ("rgb",), files=names, borders=cut, **options)
    provenance = clip.provenance | {"notes": [*clip.provenance.get("notes", ()), *notes]}
    return replace(clip, images=images, provenance=provenance)


def _index_of_number(files: tuple[Path, ...], number: int) -> int | None:
    """Return the index of the file with this number as the last number in its name; None if there is none."""
    numbers = [re.findall(r"\d+", file.stem) for file in files]
    return next((place for place, found in enumerate(numbers) if found and int(found[-1]) == number), None)


# Images of another size than the calibration.

_RATIO = 0.003
"""Largest relative difference between the scales of width and height of an image that was scaled without margins."""
_BLACK = 40  # Largest mean brightness of a margin, of 255; compressed black is not quite black


@dataclass(frozen=True)
class Fitting:
    """Scale and margin of images relative to the images of the calibration."""

    scale: float = 1.0  # Pixels of the image per pixel of the calibration
    margin: tuple[float, float] = (0.0, 0.0)  # (left, top) black border of the image, px

    @property
    def is_same(self) -> bool:
        """True if the pixels are the same as in the calibration."""
        return self == Fitting()

    def to_calibration(self, xy: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) of the calibration for pixels of the image."""
        return xy if self.is_same else (xy + 0.5 - np.array(self.margin)) / self.scale - 0.5

    def from_calibration(self, xy: np.ndarray) -> np.ndarray:
        """Return pixels (..., 2) of the image for pixels of the calibration."""
        return xy if self.is_same else (xy + 0.5) * self.scale + np.array(self.margin) - 0.5

    @property
    def note(self) -> str:
        """The text of a note, to be printed after the name of the camera."""
        left, top = self.margin
        border = f" and have a black border of {left:.2g} px at the sides" if left >= 0.5 else ""
        border += f" and have a black border of {top:.2g} px above and below" if top >= 0.5 else ""
        return f"images are {self.scale:.4f} times the size of the calibration{border}; this is undone"


def fit_images(camera: str, image: tuple[int, int], calibration: tuple[int, int], sample: np.ndarray) -> Fitting:
    """Return the scale and margin of images relative to the images of the calibration.

    Raises ValueError if the images cannot be smaller or larger copies of the images of the calibration.

    Args:
        camera: Name, for messages.
        image: Width and height of the images, px.
        calibration: Width and height that the calibration is for, px.
        sample: (N, H, W, 3) uint8, some images of the camera.
    """
    if tuple(image) == tuple(calibration):
        return Fitting()
    width, height = (a / b for a, b in zip(image, calibration, strict=True))
    scale = min(width, height)
    # Rounding to even numbers changes a side by less than 2 px.
    rounded = all(abs(a - scale * b) < 2 for a, b in zip(image, calibration, strict=True))
    if rounded and abs(width - height) <= _RATIO * scale:
        return Fitting((width + height) / 2)
    left, top = ((a - scale * b) / 2 for a, b in zip(image, calibration, strict=True))
    if _is_black(sample, round(left), round(top)):
        return Fitting(scale, (left, top))
    turned = (image[0] > image[1]) != (calibration[0] > calibration[1])
    advice = (
        "turn them by 90 degrees" if turned else "calibrate at this size, or give the images as they were calibrated"
    )
    raise ValueError(
        f"{camera_label(camera)}: its images have {image[0]} x {image[1]} px, its calibration is for "
        f"{calibration[0]} x {calibration[1]} px; they are no copy of that in another size, with or without black "
        f"borders; {advice}"
    )


def _is_black(sample: np.ndarray, left: int, top: int) -> bool:
    if not len(sample) or left + top == 0:
        return False
    height, width = sample.shape[1:3]
    borders = [sample[:, :top], sample[:, height - top :], sample[:, :, :left], sample[:, :, width - left :]]
    means = [border.mean() for border in borders if border.size]
    return bool(max(means) < _BLACK)
