"""`dmae detect`: videos of cameras, a clip with images, or photographs, to 2D detections."""

import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from dmae.commands.config import DetectCommand
from dmae.commands.data_sets import BAD_CLIP, ClipSet, check_apart, finished, settings_of
from dmae.data.clip import Clip, Detections2D
from dmae.data.resume import claim_folder
from dmae.data.skeleton import encode, option_skeleton
from dmae.data.store import clip_folders, load_clip, save_clip
from dmae.detection.pipeline import make_detector
from dmae.detection.recording import (
    Recording,
    detect_clip,
    detect_photographs,
    detect_recording,
    find_photographs,
    make_clip,
    open_recording,
    open_sets,
    output_skeleton,
    recording_name,
    write_flat,
    write_images,
    write_photographs,
)
from dmae.files.checks import IMAGES
from dmae.files.checksums import RECORD, checksum
from dmae.formats.calibrations import read_calibration
from dmae.formats.recordings import offsets_of_all
from dmae.registry import source_hash
from dmae.reporting.tables import counted

_PIECES = "pieces"
_CLAIM = "detect.json"
_TOO_FEW = "{}: pictures of {}; capture needs two or more"


def run(config: DetectCommand, out: Path, name: str | None = None, least: int = 1) -> tuple[str, ...]:
    """Detect people. Return the notes on the recording that were printed.

    The clip is called `name`, or as `recording_name` calls the recording.

    `least`: number of cameras that are needed; with fewer nothing is detected.
    """
    # A detector or skeleton that does not exist must not reserve the folder.
    make_detector(config.detector)
    output_skeleton(config.output.skeleton)
    if not any(path.is_file() and path.name not in (_CLAIM, RECORD) for path in out.rglob("*")):
        (out / _CLAIM).unlink(missing_ok=True)  # of a detector that failed in its first images
    if config.clip is not None:
        _detect_clips(config, Path(config.clip), out, least)
        return ()
    if config.photos is not None and config.calibration is None:
        _detect_photographs(config, Path(config.photos), out)
        return ()
    rig = None
    if config.calibration is not None:
        rig = read_calibration(Path(config.calibration), **asdict(config.world))
    source = Path(str(config.photos or config.videos))
    if config.photos is not None and rig is not None:
        recording = open_sets(source, rig, config.fps, config.frames)
    else:
        recording = open_recording(source, rig, config.fps, config.offsets, config.frames)
    name = name or recording_name(source)
    for note in recording.notes:
        print(note)
    if len(recording.cameras) < least:
        raise ValueError(_TOO_FEW.format(name, counted(len(recording.cameras), "camera")))
    _claim(config, recording, out)
    if (out / "clip.json").is_file():
        print(f"{out}: detected already")
        return recording.notes
    pieces = out / _PIECES
    detections, notes = detect_recording(recording, config.detector, pieces, config.output.skeleton, config.workers)
    for note in notes:
        print(note)
    if rig is None:
        write_flat(recording, detections, config.output, out)
    else:
        clip = make_clip(name, recording, detections, notes, config.detector.name)
        if config.output.images:
            clip = replace(clip, images=write_images(recording, out, config.workers))
        save_clip(clip, out)
    shutil.rmtree(pieces, ignore_errors=True)
    _print(name, detections)
    if len(recording.cameras) == 1:
        print("one camera: capture needs two or more")
    print(out)
    return (*recording.notes, *notes)


def interrupted(config: DetectCommand, out: Path) -> str:
    if config.clip is not None:
        return finished(config, out)
    pieces = len(list((Path(out) / _PIECES).glob("*.npz")))
    done = counted(pieces, "piece of the videos", "pieces of the videos")
    return f"done: {counted(pieces, 'photograph') if config.photos else done}; the same command continues"


def _detect_clips(config: DetectCommand, data: Path, out: Path, least: int) -> None:
    folders = clip_folders(data)
    several = folders != [data]
    check_apart(out, data)
    settings = settings_of("dmae detect", config, data)
    settings["options"] |= _settings(config)
    made = ClipSet(out, settings if several else None)
    if made.alone:
        # What is refused must not reserve the folder.
        _check_cameras(load_clip(folders[0]), folders[0], least)
        claim_folder(out / _CLAIM, _settings(config) | {"clip": settings["data"]}, "detections")
    with made:
        for name in made.left([folder.name for folder in folders]):
            folder, pieces = data / name, out / f".{name}.{_PIECES}"
            if made.alone:
                folder, pieces = data, out / _PIECES
            try:
                clip = load_clip(folder)
                _check_cameras(clip, folder, least)
                detected = detect_clip(clip, config.detector, pieces, config.output.skeleton, config.workers)
            except BAD_CLIP as error:
                made.fail(name, error)
            else:
                made.write(detected, name)
                _print(detected.id, detected.detections)
            shutil.rmtree(pieces, ignore_errors=True)
    print(out)


def _check_cameras(clip: Clip, folder: Path, least: int) -> None:
    if len(clip.rig) < least:
        raise ValueError(_TOO_FEW.format(folder, counted(len(clip.rig), "camera")))


def _detect_photographs(config: DetectCommand, photos: Path, out: Path) -> None:
    photographs, left_out = find_photographs(photos)
    files = {each.name: [str(each.path), *each.size, _bytes(each.path)] for each in photographs}
    claim_folder(out / _CLAIM, _settings(config) | {"photos": files}, "detections")
    detections, notes = detect_photographs(
        photographs, config.detector, out / _PIECES, config.output.skeleton, config.workers
    )
    write_photographs(photographs, detections, config.output, out)
    shutil.rmtree(out / _PIECES, ignore_errors=True)
    for note in (*left_out, *notes):
        print(note)
    people = int(detections.observed.any(-1).sum())
    found = f"{counted(len(files), 'photograph')}, {counted(people, 'person', 'people')}"
    print(f"{out}: {found}, {detections.skeleton.name}")


def _claim(config: DetectCommand, recording: Recording, out: Path) -> None:
    """Write what the detections depend on, or refuse a folder that holds detections of other videos or settings."""
    files = {each.name: [str(each.path), *each.size, _bytes(each.path)] for each in recording.cameras}
    rig = recording.rig and {name: np.asarray(value).tolist() for name, value in asdict(recording.rig).items()}
    names = recording.rig.names if recording.rig else [each.name for each in recording.cameras]
    offsets = offsets_of_all("offsets", config.offsets, names)
    given = {"videos": files, "fps": config.fps, "offsets": offsets, "calibration": rig}
    given |= {} if config.frames is None else {"frames": list(config.frames)}
    try:
        claim_folder(out / _CLAIM, _settings(config) | given, "detections")
    except ValueError as error:
        if not (out / "clip.json").is_file():
            raise
        world = "".join(f" data.{name}={value}" for name, value in asdict(config.world).items() if value is not None)
        by_capture = {
            "calibration": ("the calibration differs", f"data.calibration={config.calibration}{world}"),
            "offsets": ("offsets differ", "data.offsets=[<camera>:<frames later than here>]"),
        }
        for what, (differs, option) in by_capture.items():
            try:
                claim_folder(out / _CLAIM, _settings(config) | given, "detections", may_differ=(what,))
            except ValueError:  # the detector or the videos differ as well
                continue
            line = f"{error}. Only {differs}: dmae capture data={out} {option} uses these detections all the same"
            raise ValueError(line) from None
        raise


def _bytes(path: Path) -> int:
    """Return the size of a file, or of all images in a folder: other images of the same names hardly have the same."""
    files = path.rglob("*") if path.is_dir() else [path]
    return sum(file.stat().st_size for file in files if file == path or file.suffix.lower() in IMAGES)


def _settings(config: DetectCommand) -> dict:
    """Return the options that detections depend on, with what the files and the code that they name contain."""
    detector, output = asdict(config.detector), asdict(config.output)
    if config.detector.path is not None:
        detector["path"] = checksum(Path(config.detector.path)).sha256
    if (code := source_hash(config.detector.name)) is not None:
        detector["code"] = code
    for option, part in (("detector.skeleton", detector), ("output.skeleton", output)):
        if part["skeleton"] is not None:
            part["skeleton"] = encode(option_skeleton(option, part["skeleton"]))
    return {"detector": detector, "output": output}


def _print(name: str, detections: Detections2D) -> None:
    frames, views = detections.xy.shape[:2]
    there = detections.observed.any(-1).sum(-1)
    people = there.mean(0) if frames else [0] * views
    each = ", ".join(f"{count:.2f}" for count in people)
    size = f"{counted(frames, 'frame')}, {counted(views, 'camera')}"
    print(f"{name}: {size}, {detections.skeleton.name}; people per frame in each camera: {each}")
