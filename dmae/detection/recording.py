"""What `dmae detect` makes of videos, of the images of a clip and of photographs: clips, and files of 2D keypoints."""

import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Detections2D
from dmae.data.conversion import convert_detections
from dmae.data.images import Images, write_video
from dmae.data.skeleton import COCO17, Skeleton, option_skeleton
from dmae.detection.images import (
    Alignment,
    CameraImages,
    Recording,
    align,
    cameras_of,
    find_cameras,
    images_in,
    images_of,
    part_of,
    read_files,
)
from dmae.detection.pipeline import compare_views, detect_people, in_calibration, make_detector, to_detections
from dmae.detection.registry import FlatFormat, OutputConfig, PoseDetectorConfig
from dmae.files.checks import IMAGES, child
from dmae.files.contents import write_atomic, written_whole
from dmae.files.images import read_upright, upright_size
from dmae.formats.footage import Fitting, fit_images
from dmae.formats.openpose import write_detections, write_people
from dmae.formats.recordings import by_name, match_cameras, natural, offsets_of_all, plain
from dmae.numerics.filling import STILLS, are_stills
from dmae.numerics.statistics import evenly_spaced
from dmae.parallel import in_parallel
from dmae.progress import progress
from dmae.reconstruction.pipeline import check_origin
from dmae.reporting.tables import counted, listed
from dmae.viewing.overlay import Mark, draw_line, draw_mark, person_colour

_SAMPLED = 5  # Number of images of a camera, evenly spread, in which black borders are searched
_LISTED = 8
_STILLS_RATE = 0.1  # 1/s; of photographs in sets, where it is not known


def open_recording(
    videos: Path,
    rig: CameraRig | None = None,
    fps: float | None = None,
    offsets: Sequence[int | str] | None = None,
    frames: Sequence[int] | None = None,
) -> Recording:
    """Find the videos of a recording, and match them to its calibration.

    Args:
        videos: Folder of a video, or a folder of images, for each camera, named as in the calibration.
        rig: The calibration; None for 2D detections alone.
        fps: Frames per second; by default what the videos say.
        offsets: Frames by which cameras started late: a number for each, in the order of the calibration, or
            "name:frames" for some; by default read from the videos.
        frames: First frame and end; by default all.

    Raises:
        FileNotFoundError: there are no videos.
        ValueError: a video cannot be read, has no calibration, or differs from it in more than scale and margin; or
            there are no such frames.
    """
    cameras, notes = find_cameras(videos), []
    fittings = [Fitting()] * len(cameras)
    if rig is not None:
        cameras, rig, fittings, notes = _calibrated(cameras, rig, videos)
        # Messages name cameras as the calibration does.
        named = [replace(camera, name=name) for camera, name in zip(cameras, rig.names, strict=True)]
    else:
        named = cameras
    alignment = align(named, fps, offsets_of_all("offsets", offsets, [camera.name for camera in named]))
    return part_of(Recording(tuple(cameras), alignment, rig, tuple(fittings), (*notes, *alignment.notes)), frames)


def open_sets(path: Path, rig: CameraRig, fps: float | None = None, frames: Sequence[int] | None = None) -> Recording:
    """Find photographs that calibrated cameras took together, in sets: stills, as nothing connects two sets.

    Args:
        path: A folder for each camera, with photographs numbered by set; or a folder for each set, with a photograph of
            each camera. Either are named as in the calibration.
        fps: Sets per second, where they were taken at a steady rate, less than one.
        frames: First set and end; by default all.

    Raises:
        FileNotFoundError: there are no photographs.
        ValueError: as `open_recording`, or the rate is not below one a second.
    """
    if fps is not None and not are_stills(fps):
        raise ValueError(f"fps={fps:g}: photos=... are stills, less than {STILLS:g} a second; give videos=... instead")
    if not path.is_dir():
        raise FileNotFoundError(f"photos={path}: expected a folder of photographs for each camera, or for each set")
    sets = {folder.name: images_in(folder) for folder in by_name(path.iterdir()) if folder.is_dir()}
    calibrated = {plain(name) for name in rig.names}
    photographs = {plain(file.stem) for files in sets.values() for file in files}
    by_folder = len(photographs & calibrated) > len({plain(name) for name in sets} & calibrated)
    cameras, how = _from_folders_of_sets(path, list(sets.values())) if by_folder else _from_folders_of_cameras(path)
    cameras, rig, fittings, more = _calibrated(cameras, rig, path)
    numbers = tuple(camera.times.astype(int) for camera in cameras)
    alignment = Alignment(fps or _STILLS_RATE, numbers, max(int(each.max()) for each in numbers) + 1, ())
    return part_of(Recording(tuple(cameras), alignment, rig, tuple(fittings), (how, *more)), frames)


def _from_folders_of_sets(path: Path, sets: Sequence[Sequence[Path]]) -> tuple[list[CameraImages], str]:
    """Return the cameras of folders of a set each, and a note."""
    cameras = []
    for name in sorted({file.stem for files in sets for file in files}, key=natural):
        there = [(number, file) for number, files in enumerate(sets) for file in files if file.stem == name]
        cameras.append(images_of(name, path, [file for _, file in there], [number for number, _ in there]))
    return cameras, f"{len(sets)} sets of photographs, a folder each"


def _from_folders_of_cameras(path: Path) -> tuple[list[CameraImages], str]:
    """Return the cameras of folders of a camera each, and a note. Photographs with the same number are a set."""
    cameras = find_cameras(path)
    if films := [camera.name for camera in cameras if camera.rate is not None]:
        raise ValueError(f"photos={path}: expected photographs, found a video, {films[0]}; give videos=... instead")
    numbers = np.unique(np.concatenate([camera.times for camera in cameras]))
    # However far the numbers are apart, the sets follow each other.
    cameras = [replace(camera, times=np.searchsorted(numbers, camera.times).astype(float)) for camera in cameras]
    return cameras, f"{len(numbers)} sets of photographs, by the numbers in their names"


def _calibrated(
    cameras: list[CameraImages], rig: CameraRig, path: Path
) -> tuple[list[CameraImages], CameraRig, list[Fitting], list[str]]:
    """Return the cameras in the order of their calibration, that calibration, how images fit it, and notes."""
    index, note = match_cameras([camera.name for camera in cameras], rig, path, "images", "calibration=...")
    notes = [note] if note else []
    cameras, rig = [cameras[i] for i in np.argsort(index)], rig[sorted(index)]
    fittings = [_fitting(camera, rig[[view]]) for view, camera in enumerate(cameras)]
    notes += [f"{name}: {each.note}" for name, each in zip(rig.names, fittings, strict=True) if not each.is_same]
    return cameras, rig, fittings, notes


def _fitting(camera: CameraImages, one: CameraRig) -> Fitting:
    calibrated = (int(one.size[0, 0]), int(one.size[0, 1]))
    if camera.size == calibrated:
        return Fitting()
    numbers = evenly_spaced(len(camera), _SAMPLED).tolist()
    sample = [image for i in numbers for image in camera.read(i, i + 1) if image is not None]
    return fit_images(camera.name, camera.size, calibrated, np.stack(sample) if sample else np.empty((0, 1, 1, 3)))


_NOBODY = "no people detected"


def detect_recording(
    recording: Recording,
    config: PoseDetectorConfig,
    pieces: Path,
    skeleton: str | None = None,
    workers: int = 1,
    image: str = "image",
) -> tuple[Detections2D, tuple[str, ...]]:
    """Return the detections (F, V, D, J) of a recording in the pixels of its calibration, and notes on them.

    Args:
        pieces: As for `detect_people`.
        skeleton: Skeleton to convert to; by default the detector's.
        workers: Processes; -1 for one per core.
        image: What the notes call an image.

    Raises:
        ValueError: as `detect_people`, there is no such skeleton, or cameras are too far from the origin to compare
            what they see (`check_origin`).
    """
    target, own = output_skeleton(skeleton), make_detector(config).skeleton
    if recording.rig is not None and config.across_views:
        check_origin(recording.rig, "calibration")
    detect = _detect_alone if are_stills(recording.alignment.fps) else detect_people
    found = detect(recording.cameras, config, pieces, workers)
    notes = []
    for name, people in found.items():
        if lost := [number for number, each in enumerate(people) if each is None]:
            listed = ", ".join(map(str, lost[:_LISTED])) + (", ..." if len(lost) > _LISTED else "")
            notes.append(f"{name}: {len(lost)} of {len(people)} {image}s cannot be read ({listed})")
    views = compare_views([found[camera.name] for camera in recording.cameras], recording, config, pieces, workers)
    for camera, people in zip(recording.cameras, views, strict=True):
        if not any(each is not None and len(each) for each in people):
            notes.append(f"{camera.name}: {_NOBODY}")
    return convert_detections(in_calibration(views, recording, own), target or own), tuple(notes)


def detect_clip(
    clip: Clip, config: PoseDetectorConfig, pieces: Path, skeleton: str | None = None, workers: int = 1
) -> Clip:
    """Return a clip with images with new detections in them; truth and occlusion labels stay.

    Labels of the previous detections, and poses made from them, are dropped. Other arguments and errors: see
    `detect_recording`.

    Raises ValueError if the clip has no colour images.
    """
    if clip.images is None or not clip.has_images:
        raise ValueError(f"clip {clip.id!r} has no colour images; make it with images=rgb")
    cameras = {camera.name: camera for camera in cameras_of(clip.images, clip.rig.size)}
    frames = (np.arange(len(clip)),) * len(clip.rig)
    recording = Recording(
        tuple(cameras[name] for name in clip.rig.names),
        Alignment(clip.fps, frames, len(clip), ()),
        clip.rig,
        (Fitting(),) * len(clip.rig),
        (),
    )
    detections, added = detect_recording(recording, config, pieces, skeleton, workers, "frame")
    # Notes on the detections before are not of these.
    kept = [note for note in clip.provenance.get("notes", ()) if not note.endswith(f": {_NOBODY}")]
    notes = [*kept, *added]
    provenance = clip.provenance | {"detector": config.name, "notes": notes}
    return replace(clip, detections=detections, poses=None, detection_labels=None, provenance=provenance)


def _detect_alone(
    cameras: Sequence[CameraImages], config: PoseDetectorConfig, pieces: Path, workers: int
) -> dict[str, list[np.ndarray | None]]:
    """Return what `detect_people` does, each image by itself: none tells where people are in the next."""
    alone = [
        replace(camera.part(number, number + 1), name=f"{camera.name}/{number}")
        for camera in cameras
        for number in range(len(camera))
    ]
    found = detect_people(alone, replace(config, photographs=True), pieces, workers)
    return {camera.name: [found[f"{camera.name}/{number}"][0] for number in range(len(camera))] for camera in cameras}


_PLAIN_NAMES = {"videos", "video", "images", "pictures", "photos", "photographs", "frames", "sets"}


def recording_name(folder: Path) -> str:
    """Return the name of a folder with videos, or if it says only what is in it, the name of the folder around it."""
    folder = folder.resolve()
    around = folder.parent.name
    return around if around and folder.name.lower() in _PLAIN_NAMES else folder.name


def make_clip(name: str, recording: Recording, detections: Detections2D, notes: Sequence[str], detector: str) -> Clip:
    """Return the clip of a calibrated recording, without images."""
    assert recording.rig is not None
    provenance: dict = {"notes": [*recording.notes, *notes], "detector": detector}
    provenance["videos"] = {camera.name: camera.path.name for camera in recording.cameras}
    provenance |= {"first_frame": recording.first} if recording.first else {}
    return Clip(name, recording.alignment.fps, recording.rig, detections, provenance=provenance)


def write_images(recording: Recording, folder: Path, workers: int = 1) -> Images:
    """Put the videos of a recording into `<folder>/rgb`, with one image per frame of the clip, in the calibration's
    size.

    Videos that already fit are linked, or copied if the file system has no links. Others are encoded again.
    """
    (folder / "rgb").mkdir(parents=True, exist_ok=True)
    rig, alignment = recording.rig, recording.alignment
    assert rig is not None
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
    camera: CameraImages, frames: np.ndarray, alignment: Alignment, fitting: Fitting, size: tuple[int, int], to: Path
) -> None:
    with written_whole(to) as part:
        write_video(part, _in_frames(camera, frames, alignment.count, partial(_resized, fitting, size)), alignment.fps)


def _in_frames(
    camera: CameraImages, frames: np.ndarray, count: int, fit: Callable[[np.ndarray | None], np.ndarray]
) -> Iterator[np.ndarray]:
    """Yield an image for each frame; for a frame without one the previous image, or a black one at the start."""
    shown, done = fit(None), 0
    for frame, image in zip(frames, camera.read(0, len(camera)), strict=True):
        if frame < 0:
            continue
        for _ in range(done, frame):
            yield shown
        shown = fit(image) if image is not None else shown
        yield shown
        done = frame + 1
    for _ in range(done, count):
        yield shown


def _resized(fitting: Fitting, size: tuple[int, int], image: np.ndarray | None) -> np.ndarray:
    """Return an image in the pixels of the calibration, with even width and height, as H.264 requires."""
    even = tuple(side + side % 2 for side in size)
    if image is None:
        return np.zeros((even[1], even[0], 3), np.uint8)
    left, top = fitting.margin
    scale = fitting.scale
    # Pixel i of the calibration is pixel (i + 0.5) scale + margin - 0.5 of the image.
    shift = ((0.5 * scale + left - 0.5), (0.5 * scale + top - 0.5))
    affine = np.array([[scale, 0, shift[0]], [0, scale, shift[1]]])
    return cv2.warpAffine(image, affine, even, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)


def output_skeleton(skeleton: str | None) -> Skeleton | None:
    """Return the skeleton with this name, or None to keep the detector's. Raises ValueError if the name is unknown."""
    return None if skeleton is None else option_skeleton("output.skeleton", skeleton)


# Files of 2D keypoints, for cameras without a calibration


def write_flat(recording: Recording, detections: Detections2D, config: OutputConfig, out: Path) -> None:
    """Write detections (F, V, D, J) of cameras without a calibration, in pixels of their images, to a folder."""
    names = tuple(camera.name for camera in recording.cameras)
    if config.format == FlatFormat.openpose:
        write_detections(detections, names, out)
        return
    if config.skeleton is None:
        detections = convert_detections(detections, COCO17)
    for view, (name, camera) in enumerate(zip(names, recording.cameras, strict=True)):
        frames = range(len(detections.xy))
        entries = [(frame, view, f"{name}/{frame:06d}.jpg", camera.size) for frame in frames]
        write_atomic(out / f"{name}.json", json.dumps(coco(detections, entries)))


def coco(detections: Detections2D, entries: Sequence[tuple[int, int, str, tuple[int, int]]]) -> dict:
    """Return detections as COCO's keypoints: category 1, the number of the entry as `image_id`.

    Args:
        detections: (F, V, D, J).
        entries: Frame, view, name and size of each image.
    """
    skeleton, annotations = detections.skeleton, []
    images = [
        {"id": image, "file_name": name, "width": size[0], "height": size[1]}
        for image, (_, _, name, size) in enumerate(entries)
    ]
    there = np.any(detections.observed, -1)
    people = [
        (image, frame, view, number)
        for image, (frame, view, _, _) in enumerate(entries)
        for number in np.flatnonzero(there[frame, view])
    ]
    for image, frame, view, number in people:
        xy, score = detections.xy[frame, view, number], detections.score[frame, view, number]
        known = ~np.isnan(score)
        low, high = xy[known].min(0), xy[known].max(0)
        keypoints = np.where(known[:, None], np.column_stack([xy, score]), 0)
        annotations.append(
            {
                "id": len(annotations) + 1,
                "image_id": image,
                "category_id": 1,
                "keypoints": [round(float(value), 3) for value in keypoints.ravel()],
                "num_keypoints": int(known.sum()),
                "bbox": [round(float(value), 2) for value in (*low, *(high - low))],
                "area": round(float(np.prod(high - low)), 1),
                "iscrowd": 0,
                "score": round(float(score[known].mean()), 4),
            }
        )
    bones = [[a + 1, b + 1] for a, b in skeleton.bones]
    category = {"id": 1, "name": "person", "keypoints": list(skeleton.joints), "skeleton": bones}
    return {"images": images, "annotations": annotations, "categories": [category]}


# Photographs that do not belong together: people are detected in each by itself

KEYPOINTS, DRAWN = "keypoints.json", "drawn"
"""COCO's file of all photographs; folder of the photographs with the people drawn over them."""
_THIN = 400  # Pixels of the longer side of a photograph for each pixel of the width of a line
_QUALITY = 90


def find_photographs(path: Path) -> tuple[list[CameraImages], list[str]]:
    """Return the N photographs of a folder, or a single one, each as a camera; and notes on files that are left out.

    Raises:
        FileNotFoundError: there are none.
        ValueError: not one can be read, or two have the same name with different suffixes.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"photos={path}: no such folder")
    files = [path] if path.is_file() else images_in(path)
    if not files:
        raise FileNotFoundError(f"photos={path}: expected photographs ({', '.join(IMAGES)}), found none")
    stems = [file.stem.lower() for file in files]
    if twice := [file.name for file in files if stems.count(file.stem.lower()) > 1]:
        raise ValueError(f"photos={path}: expected photographs of different names, found {', '.join(twice[:_LISTED])}")
    cameras, damaged = [], []
    for file in files:
        try:
            size = upright_size(file)
        except ValueError as error:
            damaged.append(str(error))
            continue
        cameras.append(CameraImages(file.name, file, size, np.zeros(1), None, partial(read_files, [file])))
    if not cameras:
        raise ValueError(f"photos={path}: not one photograph can be read; {damaged[0]}")
    return cameras, [f"left out: {why}" for why in damaged]


def detect_photographs(
    photographs: Sequence[CameraImages],
    config: PoseDetectorConfig,
    pieces: Path,
    skeleton: str | None = None,
    workers: int = 1,
) -> tuple[Detections2D, list[str]]:
    """Return the people of N photographs, (1, N, D, J), and notes on them.

    Each is searched as `detector.photographs=true` says. For other arguments and errors see `detect_recording`.
    """
    target, own = output_skeleton(skeleton), make_detector(config).skeleton
    found = detect_people(photographs, replace(config, photographs=True), pieces, workers)
    each = [found[photograph.name] for photograph in photographs]
    detections = to_detections(each, [np.zeros(1, int)] * len(each), 1, own)
    unreadable = [name for name, (people,) in found.items() if people is None]
    empty = [name for name, (people,) in found.items() if people is not None and not len(people)]
    notes = [
        f"{what} {counted(len(names), 'photograph')}: {listed(names, _LISTED)}"
        for what, names in (("no people detected in", empty), ("left out, cannot be read:", unreadable))
        if names
    ]
    return convert_detections(detections, target or own), notes


def write_photographs(
    photographs: Sequence[CameraImages], detections: Detections2D, config: OutputConfig, out: Path
) -> None:
    """Write the people (1, N, D, J) of N photographs, in pixels of these, to a folder.

    In OpenPose's format each has a file `<photograph>_keypoints.json`, in COCO's one file is for all. With
    `config.images` the photographs are written as well, with the people drawn over them.
    """
    if config.format == FlatFormat.openpose:
        for number, each in enumerate(photographs):
            write_people(detections, 0, number, child(out, f"{each.path.stem}_keypoints.json", "photograph"))
    else:
        if config.skeleton is None:
            detections = convert_detections(detections, COCO17)
        entries = [(0, number, each.name, each.size) for number, each in enumerate(photographs)]
        write_atomic(out / KEYPOINTS, json.dumps(coco(detections, entries)))
    if config.images:
        (out / DRAWN).mkdir(exist_ok=True)
        for number, each in enumerate(progress(photographs, "drawing", len(photographs))):
            _draw(each.path, detections, number, child(out / DRAWN, f"{each.path.stem}.jpg", "photograph"))


def _draw(path: Path, detections: Detections2D, number: int, to: Path) -> None:
    """Write a photograph with its people, people of low confidence included."""
    try:
        canvas = read_upright(path)
    except ValueError:
        return
    thick = max(1, round(max(canvas.shape[:2]) / _THIN))
    for person, joints in enumerate(detections.xy[0, number].astype(np.float64)):
        known, colour = np.isfinite(joints).all(-1), person_colour(person)
        for bone in detections.skeleton.bones:
            if known[list(bone)].all():
                draw_line(canvas, joints[list(bone)], colour, thick, outlined=True)
        for joint in np.flatnonzero(known):
            draw_mark(canvas, joints[joint], Mark.DISC, colour, max(1, thick // 2))
    encoded = cv2.imencode(".jpg", canvas[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])[1]
    write_atomic(to, encoded.tobytes())
