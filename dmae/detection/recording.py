"""A recording made of videos: cameras matched, sizes fitted, images aligned, people detected, a clip made."""

import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D
from dmae.data.conversion import convert_detections
from dmae.data.images import Images, write_video
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.detection.across_views import compare_views
from dmae.detection.alignment import Alignment, align
from dmae.detection.picture_size import Fitting, fit_pictures
from dmae.detection.pictures import CameraPictures, cameras_of, find_cameras
from dmae.detection.pipeline import Found, detect_people, make_detector, to_detections
from dmae.detection.registry import PoseDetectorConfig
from dmae.files.checks import child
from dmae.formats.recordings import match_cameras
from dmae.parallel import in_parallel
from dmae.progress import progress

_SAMPLED = 5
"""Number of images of a camera, evenly spread, in which black borders are searched."""
_LISTED = 8


@dataclass(frozen=True)
class Recording:
    """Videos that belong together.

    Attributes:
        cameras: V cameras with images.
        alignment: The frame of each image.
        rig: Their calibration; None if there is none.
        fittings: Scale and margin of the images of each camera, relative to the images of its calibration.
        notes: Decisions that can be wrong.
    """

    cameras: tuple[CameraPictures, ...]
    alignment: Alignment
    rig: CameraRig | None
    fittings: tuple[Fitting, ...]
    notes: tuple[str, ...]


def open_recording(
    videos: Path, rig: CameraRig | None = None, fps: float | None = None, offsets: Sequence[int] | None = None
) -> Recording:
    """Find the videos of a recording, and match them to its calibration.

    Args:
        videos: Folder of a video, or a folder of images, for each camera, named as in the calibration.
        rig: The calibration; None for 2D detections alone.
        fps: Frames per second; by default what the videos say.
        offsets: Frames by which each camera started late, in the order of the calibration; by default read from the
            videos.

    Raises:
        FileNotFoundError: there are no videos.
        ValueError: a video cannot be read, has no calibration, or differs from it in more than scale and margin.
    """
    cameras, notes = find_cameras(videos), []
    fittings = [Fitting()] * len(cameras)
    if rig is not None:
        index, note = match_cameras([camera.name for camera in cameras], rig, videos, "pictures", "calibration=...")
        notes += [note] if note else []
        order = np.argsort(index)
        cameras, rig = [cameras[i] for i in order], rig[sorted(index)]
        fittings = [_fitting(camera, rig[[view]]) for view, camera in enumerate(cameras)]
        notes += [
            f"{camera.name}: {each.note}" for camera, each in zip(cameras, fittings, strict=True) if not each.is_same
        ]
    alignment = align(cameras, fps, offsets)
    return Recording(tuple(cameras), alignment, rig, tuple(fittings), (*notes, *alignment.notes))


def _fitting(camera: CameraPictures, one: CameraRig) -> Fitting:
    calibrated = tuple(map(int, one.size[0]))
    if camera.size == calibrated:
        return Fitting()
    numbers = np.unique(np.linspace(0, len(camera) - 1, _SAMPLED).astype(int))
    sample = [picture for i in numbers for picture in camera.read(int(i), int(i) + 1) if picture is not None]
    return fit_pictures(camera.name, camera.size, calibrated, np.stack(sample) if sample else np.empty((0, 1, 1, 3)))


def detect_recording(
    recording: Recording, config: PoseDetectorConfig, pieces: Path, skeleton: str | None = None, workers: int = 1
) -> tuple[Detections2D, tuple[str, ...]]:
    """Return the detections (F, V, D, J) of a recording in the pixels of its calibration, and notes on them.

    Args:
        recording: As `open_recording` returns it.
        config: The detector.
        pieces: As for `detect_people`.
        skeleton: Skeleton to convert to; by default that of the detector.
        workers: Processes; -1 for one per core.

    Raises:
        ValueError: as `detect_people`, or there is no such skeleton.
    """
    target, own = output_skeleton(skeleton), make_detector(config).skeleton
    found = detect_people(recording.cameras, config, pieces, workers)
    notes = _notes(found, "picture")
    fitted = _calibrated([found[camera.name] for camera in recording.cameras], recording.fittings)
    frames, count = recording.alignment.frames, recording.alignment.count
    detections = to_detections(fitted, frames, count, own)
    if recording.rig is not None:
        first = [found[camera.name] for camera in recording.cameras]
        more = compare_views(
            first, recording.cameras, recording.rig, detections, frames, recording.fittings, recording.alignment.fps,
            config, pieces, workers,
        )  # fmt: skip
        detections = to_detections(_calibrated(more, recording.fittings), frames, count, own)
    return convert_detections(detections, target or own), notes


def detect_clip(
    clip: Clip, config: PoseDetectorConfig, pieces: Path, skeleton: str | None = None, workers: int = 1
) -> Clip:
    """Return a clip with images with new detections in them; truth and occlusion labels stay.

    Labels of the previous detections, and poses made from them, are dropped. Other arguments and errors are those of
    `detect_recording`.

    Raises:
        ValueError: the clip has no colour images.
    """
    if clip.images is None or "rgb" not in clip.images.kinds:
        raise ValueError(f"clip {clip.id!r} has no colour images; make it with images=rgb")
    target, own = output_skeleton(skeleton), make_detector(config).skeleton
    cameras = {camera.name: camera for camera in cameras_of(clip.images, clip.rig.size)}
    found = detect_people(tuple(cameras.values()), config, pieces, workers)
    first, frames = [found[name] for name in clip.rig.names], [np.arange(len(clip))] * len(clip.rig)
    more = compare_views(
        first, [cameras[name] for name in clip.rig.names], clip.rig, to_detections(first, frames, len(clip), own),
        frames, [Fitting()] * len(clip.rig), clip.fps, config, pieces, workers,
    )  # fmt: skip
    detections = to_detections(more, frames, len(clip), own)
    provenance = clip.provenance | {
        "detector": config.name,
        "notes": [*clip.provenance.get("notes", ()), *_notes(found)],
    }
    converted = convert_detections(detections, target or own)
    return replace(clip, detections=converted, poses=None, detection_labels=None, provenance=provenance)


def make_clip(name: str, recording: Recording, detections: Detections2D, notes: Sequence[str], detector: str) -> Clip:
    """Return the clip of a calibrated recording, without images."""
    provenance = {"notes": [*recording.notes, *notes], "detector": detector}
    provenance["videos"] = {camera.name: camera.path.name for camera in recording.cameras}
    return Clip(name, recording.alignment.fps, recording.rig, detections, provenance=provenance)


def write_images(recording: Recording, folder: Path, workers: int = 1) -> Images:
    """Put the videos of a recording into `<folder>/rgb`, with one image per frame of the clip, in the calibration's
    size.

    Videos that already fit are linked, or copied if the file system has no links. Others are encoded again.
    """
    (folder / "rgb").mkdir(parents=True, exist_ok=True)
    rig, alignment = recording.rig, recording.alignment
    tasks = []
    for view, camera in enumerate(recording.cameras):
        to = child(folder / "rgb", f"{rig.names[view]}.mp4", "camera")
        if to.is_file():
            continue
        as_is = camera.codec in ("h264", "vp9", "hevc", "av1") and camera.path.suffix.lower() == ".mp4"
        frames = alignment.frames[view]
        whole = len(frames) == alignment.count and (np.diff(frames) == 1).all()
        if as_is and whole and camera.size == tuple(rig.size[view]):
            _link(camera.path, to)
        else:
            size = tuple(map(int, rig.size[view]))
            tasks.append((camera, frames, alignment, recording.fittings[view], size, to))
    for _ in progress(in_parallel(_encode, tasks, min(workers, max(len(tasks), 1))), "writing videos", len(tasks)):
        pass
    return Images(folder, rig.names, tuple(range(alignment.count)), ("rgb",))


def _link(path: Path, to: Path) -> None:
    try:
        os.link(path.resolve(), to)
    except OSError:
        shutil.copyfile(path, to)


def _encode(
    camera: CameraPictures, frames: np.ndarray, alignment: Alignment, fitting: Fitting, size: tuple[int, int], to: Path
) -> None:
    partial_file = to.with_name(f".{to.name}.partial.mp4")
    write_video(
        partial_file, _in_frames(camera, frames, alignment.count, partial(_resized, fitting, size)), alignment.fps
    )
    partial_file.replace(to)


def _in_frames(
    camera: CameraPictures, frames: np.ndarray, count: int, fit: Callable[[np.ndarray | None], np.ndarray]
) -> Iterator[np.ndarray]:
    """Yield an image for each frame; for a frame without one the previous image, or a black one at the start."""
    shown, done = fit(None), 0
    for frame, picture in zip(frames, camera.read(0, len(camera)), strict=True):
        if frame < 0:
            continue
        for _ in range(done, frame):
            yield shown
        shown = fit(picture) if picture is not None else shown
        yield shown
        done = frame + 1
    for _ in range(done, count):
        yield shown


def _resized(fitting: Fitting, size: tuple[int, int], picture: np.ndarray | None) -> np.ndarray:
    """Return an image in the pixels of the calibration, with even width and height, as H.264 requires."""
    even = tuple(side + side % 2 for side in size)
    if picture is None:
        return np.zeros((even[1], even[0], 3), np.uint8)
    left, top = fitting.margin
    scale = fitting.scale
    # Pixel i of the calibration is pixel (i + 0.5) scale + margin - 0.5 of the image.
    shift = ((0.5 * scale + left - 0.5), (0.5 * scale + top - 0.5))
    affine = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    return cv2.warpAffine(picture, affine, even, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


def _calibrated(found: Sequence[Found], fittings: Sequence[Fitting]) -> list[Found]:
    """Return what was found in the images of cameras in the pixels of the calibration."""

    def fitted(people: np.ndarray, fitting: Fitting) -> np.ndarray:
        return np.concatenate([fitting.to_calibration(people[..., :2]), people[..., 2:]], -1)

    return [
        Found([None if people is None else fitted(people, fitting) for people in camera.people])
        for camera, fitting in zip(found, fittings, strict=True)
    ]


def output_skeleton(skeleton: str | None) -> Skeleton | None:
    """Return the skeleton of that name; None for that of the detector.

    Raises:
        ValueError: there is no such skeleton.
    """
    if skeleton is None:
        return None
    try:
        return get_skeleton(skeleton)
    except KeyError as error:
        raise ValueError(f"output.skeleton={skeleton}: {error.args[0]}") from None


def _notes(found: dict[str, Found], what: str = "frame") -> tuple[str, ...]:
    """Say which images cannot be read, and which cameras see no people."""
    notes = []
    for name, camera in found.items():
        if lost := camera.unreadable:
            listed = ", ".join(map(str, lost[:_LISTED])) + (", ..." if len(lost) > _LISTED else "")
            notes.append(f"{name}: {len(lost)} of {len(camera.people)} {what}s cannot be read ({listed})")
        if not any(people is not None and len(people) for people in camera.people):
            notes.append(f"{name}: no people detected")
    return tuple(notes)
