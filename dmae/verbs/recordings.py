"""Recordings: read, detect, load, save and write them, or go from videos to completed people in one call."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, overload

from dmae.completion.config import TrainConfig
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert as convert_poses
from dmae.data.resources import read_preset
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.data.store import load_clip, save_clip
from dmae.data.typed import check_arguments, with_changes
from dmae.detection.recording import detect_clip, detect_recording, make_clip, open_recording, recording_name
from dmae.detection.registry import PoseDetectorConfig
from dmae.formats import poses as pose_files
from dmae.formats.calibrations import read_calibration
from dmae.formats.config import DataConfig, LengthUnit, UpDirection
from dmae.formats.poses import PoseFile
from dmae.formats.reading import Clips
from dmae.formats.writing import write_poses, write_recording
from dmae.reconstruction.config import CaptureConfig


@check_arguments
def read(
    path: str | Path,
    fps: float | None = None,
    format: str | None = None,
    *,
    calibration: str | Path | None = None,
    detections: str | Path | None = None,
    truth: str | Path | None = None,
    videos: str | Path | None = None,
    images: str | Path | None = None,
    size: Sequence[int] | None = None,
    skeleton: str | None = None,
    unit: LengthUnit | None = None,
    up: UpDirection | None = None,
    inverse: bool | None = None,
    offsets: Sequence[int | str] | Mapping[str, int] | None = None,
    cameras: Sequence[int | str] | None = None,
    frames: Sequence[int] | None = None,
) -> Clip:
    """Read a recording that any supported program wrote.

        clip = dmae.read("recordings/session", fps=60)
        clip = dmae.read("shelf", format="shelf", cameras=[0, 1, 3], frames=[0, 100])

    Args:
        path: Folder of the recording, or its file.
        fps: Frames per second, if the files do not state it.
        format: A format of `dmae convert`; by default recognised by the files in the folder.
        calibration: Its file, a folder with one, or a clip with these cameras; by default the one found in `path`.
        detections: Folder of the detections, or file of COCO's; by default found in `path`.
        truth: True poses to score with: a file that `read_poses` reads.
        videos: Folder of the videos that people were detected in, <camera>.mp4: backgrounds of reports and figures.
        images: Folder of the images that people were detected in, a folder of PNG or JPEG files for each camera.
        size: Image width and height, px, if the files do not state them.
        skeleton: Skeleton of the detections, if the files do not state it or are wrong.
        unit: Unit of lengths in the calibration; by default that of its format.
        up: Axis that points up in the calibration; by default that of its format.
        inverse: Whether extrinsics of the calibration are world_from_cam; by default as in its format.
        offsets: Frames by which cameras started late: a number for each, in the order of the calibration, or a
            dictionary, frames by camera. Frame k of a camera is frame k + offset.
        cameras: Names of the cameras to use; by default all.
        frames: First frame to use, and the one after the last; by default all.

    Returns:
        A clip of F frames and V views. `clip.provenance["notes"]` lists what was missing or guessed.

    Raises:
        FileNotFoundError: the recording, or a file that it needs, does not exist.
        ValueError: the format is not recognised, a file is malformed, an option is missing, or there are several
            clips (use `load_dataset`).

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> dmae.save(clip, "walk")
        >>> dmae.read("walk", cameras=[0, 2]).rig.names
        ('0', '2')
    """
    path = Path(path)
    options: dict[str, Any] = {
        "calibration": calibration, "detections": detections, "truth": truth, "videos": videos, "images": images,
        "size": size, "skeleton": skeleton, "unit": unit, "up": up, "inverse": inverse, "offsets": offsets,
        "cameras": cameras, "frames": frames,
    }  # fmt: skip
    if isinstance(offsets, Mapping):
        options["offsets"] = [f"{camera}:{late}" for camera, late in offsets.items()]
    try:
        clips = Clips(DataConfig(name=format, path=str(path), fps=fps, **options))
        if len(clips) != 1:
            raise ValueError(f"{path}: expected one recording, found a data set of {len(clips)}; use dmae.load_dataset")
        return clips[0]
    except (ValueError, FileNotFoundError) as error:
        # Errors name the options of commands, as `data.fps=...`, and `data=...` for the format.
        error.args = tuple(_OPTION.sub(lambda option: option[1] or "format", str(each)) for each in error.args)
        raise


_FIELDS = [each.name for each in fields(DataConfig) if each.name != "name"]
_OPTION = re.compile(rf"(?<![\w/.])(?:data|DataConfig)(?:\.({'|'.join(_FIELDS)})\b|\.name\b|(?==\.\.\.))")


@check_arguments
def detect(
    source: str | Path | Clip,
    calibration: str | Path | CameraRig | None = None,
    *,
    detector: str = "blazepose",
    fps: float | None = None,
    offsets: Sequence[int | str] | None = None,
    frames: Sequence[int] | None = None,
    skeleton: str | None = None,
    workers: int = 1,
) -> Clip:
    """Detect people in the videos of calibrated cameras, or in the images of a clip.

        clip = dmae.detect("session/videos", "session/calibration.toml", workers=4)

    Args:
        source: Folder with a video, or a folder of images, for each camera, named as in the calibration; or a clip
            with colour images. The result keeps its truth and occlusion labels.
        calibration: Cameras, or their file; None if `source` is a clip, which contains its cameras.
        detector: `blazepose`, or `package.module:function`.
        fps: Frames per second of the videos, if the files do not state it.
        offsets: Frames by which cameras started late: a number for each, or "name:frames" for some; by default
            as the videos state.
        frames: First frame of the videos to take, and end, as (0, 500); by default all.
        skeleton: Skeleton to convert to; by default that of the detector.
        workers: Processes; -1 for one per core.

    Returns:
        A clip of F frames and V views; without images if `source` are videos. `clip.provenance["notes"]` lists the
        decisions that were made.

    Raises:
        FileNotFoundError: there are no videos.
        ValueError: a video cannot be read, has no calibration, or is of another size; the clip has no colour images.

    Examples:
        >>> clip = next(synth.generate(seconds=0.1, clips=1, persons=[1, 1], out="walks"))
        >>> seen = next(synth.render("walks", quality="draft", images=["rgb"], out="seen"))
        >>> found = dmae.detect(seen.select(views=[0, 2]), skeleton="body25")
        >>> found.detections.xy.shape[:2] == (len(seen), 2)
        True
    """
    return detect_in(source, calibration, detector, fps, offsets, frames, skeleton, workers)


def detect_in(
    source: str | Path | Clip,
    calibration: str | Path | CameraRig | None,
    detector: str,
    fps: float | None,
    offsets: Sequence[int | str] | None,
    frames: Sequence[int] | None,
    skeleton: str | None,
    workers: int,
    least: int = 1,
) -> Clip:
    """Return what `detect` does. Raises ValueError as well if videos are of fewer than `least` cameras."""
    config = PoseDetectorConfig(name=detector)
    with TemporaryDirectory() as pieces:
        if isinstance(source, Clip):
            if calibration is not None or fps is not None or offsets is not None:
                raise ValueError("a clip contains its calibration, fps and offsets; leave them out")
            if frames is not None:
                raise ValueError("frames are of videos; of a clip, clip.select(frames=slice(0, 500)) takes some")
            return detect_clip(source, config, Path(pieces), skeleton, workers)
        if calibration is None:
            raise ValueError("expected a calibration; without one, dmae detect writes files of 2D keypoints")
        rig = calibration if isinstance(calibration, CameraRig) else read_calibration(Path(calibration))
        recording = open_recording(Path(source), rig, fps, offsets, frames)
        if len(recording.cameras) < least:
            raise ValueError(f"{source}: capture needs at least {least} cameras, found {len(recording.cameras)}")
        detections, notes = detect_recording(recording, config, Path(pieces), skeleton, workers)
        return make_clip(recording_name(Path(source)), recording, detections, notes, detector)


@check_arguments
def read_poses(path: str | Path) -> PoseFile:
    """Read poses that any supported program wrote: `.npz`, `.trc`, movement's `.nc`, a clip, CMU Panoptic's folder.

    Args:
        path: The file or folder. If each person has a TRC file, `<name>_P1.trc`, `<name>_P2.trc`, ..., give
            `<name>.trc`.

    Returns:
        `poses` (F, P, J, 3) m, world; `fps` and `clip`, the id of the clip, if the file states them.

    Raises:
        FileNotFoundError: the path does not exist.
        ValueError: the format is not recognised, or the file is malformed.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> files = dmae.export(clip, "poses.npz", poses=dmae.capture(clip))
        >>> read = dmae.read_poses("poses.npz")
        >>> read.fps, read.poses.skeleton.name
        (25.0, 'body25')
    """
    return pose_files.read_poses(Path(path))


@check_arguments
def load(folder: str | Path) -> Clip:
    """Read one clip that `save`, or any command, wrote.

    Args:
        folder: Contains `clip.json` and `arrays.safetensors`.

    Raises:
        FileNotFoundError: there is no clip in the folder.
        ValueError: a file is malformed, damaged, or of another format version.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> dmae.save(clip, "walk")
        >>> np.array_equal(dmae.load("walk").truth.xyz, clip.truth.xyz)
        True
    """
    return load_clip(Path(folder))


@check_arguments
def save(clip: Clip, folder: str | Path) -> None:
    """Write a clip to a folder: `clip.json` and `arrays.safetensors`.

    Args:
        clip: Any clip. Its images are not copied: the folder refers to them.
        folder: A clip that is already in it is replaced.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> dmae.save(clip, "walk")
        >>> sorted(path.name for path in Path("walk").iterdir())
        ['arrays.safetensors', 'clip.json']
    """
    save_clip(clip, Path(folder))


@check_arguments
def load_dataset(path: str | Path) -> Clips:
    """Open a data set: a sequence of clips, each read when it is accessed, by its number or its name.

    Args:
        path: Folder that `synth generate`, `dmae capture` or `dmae complete` wrote. Clips that failed are left out.

    Raises:
        FileNotFoundError: there is no clip and no data set at the path.

    Examples:
        >>> for clip in synth.generate(seconds=1, clips=2, seed=7, out="walks"): pass
        >>> clips = dmae.load_dataset("walks")
        >>> len(clips), clips[1].id, clips["000000"].id
        (2, '000001', '000000')
    """
    return Clips(DataConfig(path=str(path)))


@check_arguments
def export(
    clip: Clip,
    out: str | Path,
    format: str | None = None,
    *,
    poses: Poses3D | None = None,
    skeleton: str | Path | Skeleton | None = None,
    unit: LengthUnit | str = LengthUnit.m,
    keep_mm: float | None = None,
    robot: str | None = None,
    people: Sequence[str] = (),
) -> list[Path]:
    """Write poses to a file that other programs read. Return the files.

    Args:
        clip: Its captured or completed poses are exported; its truth if it has no poses.
        out: The file; for `panoptic`, `openpose` and `lerobot` a folder. Formats of one person a file (`trc`, `mot`,
            `bvh`, `g1`) write several people as `<name>_P1` and so on.
        format: `npz`, `trc`, `mot`, `c3d`, `bvh`, `glb`, `movement`, `coco`, `panoptic`, `openpose`, `g1` or `lerobot`.
            Each marks completed joints in its own way. By default the suffix of `out` decides, else it is `npz`.
        poses: Export these instead.
        skeleton: Convert to this skeleton first.
        unit: `m`, `cm` or `mm`, for `trc` and `bvh`; of `g1` `m` with radians or `cm` with degrees.
        keep_mm: Leave out joints with a likely error above this, by their covariances, and completed joints without a
            covariance.
        robot: MJCF of the Unitree G1, for `g1` and `lerobot`; by default that of an installed mjlab.
        people: Persons to write and their names in files, as ["P1:anna", "P3"]; by default all, as P1, P2, ...

    Raises:
        ValueError: there are no poses, the folder is not empty, the file has another suffix than the format's, or
            `keep_mm` is not a positive number.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> files = dmae.export(clip, "poses.npz", poses=dmae.capture(clip), skeleton="shelf14")
        >>> np.load(files[0])["joints"].shape[-2:]
        (14, 3)
    """
    given = clip if poses is None else replace(clip, poses=poses)
    done = write_poses(
        given, Path(out), format, skeleton=skeleton, unit=LengthUnit(unit), keep_mm=keep_mm, robot=robot, people=people
    )
    return list(done.files)


@check_arguments
def convert(clip: Clip, out: str | Path, format: str = "clip") -> Path:
    """Write the detections and cameras of a clip in the format of another program. Return the folder.

    Args:
        clip: Any clip.
        out: Folder to write, empty or new.
        format: `clip`, `openpose`, `easymocap`, `coco`, or another recording writer.

    Raises:
        ValueError: there is no such format, the folder is not empty, or the format cannot represent the cameras.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> folder = dmae.convert(clip, "walk", "openpose")
        >>> dmae.read(folder, fps=25).rig.names == clip.rig.names
        True
    """
    write_recording(clip, Path(out), format)
    return Path(out)


@check_arguments
def to_skeleton(poses: Poses3D, skeleton: str | Path | Skeleton) -> Poses3D:
    """Return the same poses on another skeleton, as exports and scores convert them.

    Joints with the same name are copied, with source and covariance. `neck`, `mid_hip` and the ends of the head are
    derived if they are missing; all others are absent.

    Args:
        poses: (F, P, J) poses.
        skeleton: A skeleton, its name, or a skeleton file.

    Raises:
        KeyError: there is no such skeleton, or it has no joint that can be derived.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> dmae.to_skeleton(clip.truth, "coco17").xyz.shape[2]
        17
    """
    return convert_poses(poses, get_skeleton(skeleton))


@overload
def preset(group: Literal["capture"], name: str, **changes: Any) -> CaptureConfig: ...


@overload
def preset(group: Literal["train"], name: str, **changes: Any) -> TrainConfig: ...


@check_arguments
def preset(group: str, name: str, **changes: Any) -> Any:
    """Return a configuration as a preset of the command line sets it, with some fields changed.

    Args:
        group: `capture`, for `dmae.capture`; or `train`, for `dmae.train`, whose presets are those of `model=`.
        name: Name of the preset.
        changes: Fields of the configuration that differ. A dictionary changes some fields of a nested configuration.

    Raises:
        ValueError: there is no such preset; the message has the nearest name.

    Examples:
        >>> dmae.preset("capture", "paper", th_v=2).th_v
        2
        >>> dmae.preset("train", "paper", learning={"steps": 500}).learning.lr  # as model=paper learning.steps=500
        0.002
    """
    if group not in ("capture", "train"):
        raise ValueError(f"group={group!r}: expected capture or train")
    kind, folder = {"capture": (CaptureConfig, "capture"), "train": (TrainConfig, "model")}[group]
    return with_changes(read_preset(kind, folder, name), changes)


def configured(group: Literal["capture", "train"], given: Any) -> Any:
    """Return the configuration that was given, or the preset of this name; by default the default preset."""
    return preset(group, given or "default") if given is None or isinstance(given, str) else given
