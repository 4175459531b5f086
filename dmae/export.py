"""Poses and recordings to files that others read."""

from dataclasses import dataclass, field, replace
from enum import StrEnum
from pathlib import Path

import numpy as np

from dmae.cameras import CameraRig
from dmae.clip import Clip, Poses3D, Source, Visibility
from dmae.conventions import Unit
from dmae.data import DataConfig, is_data_set, load
from dmae.formats import easymocap, panoptic
from dmae.formats.calibration import CalibrationFormat, write_calibration
from dmae.formats.coco import write_coco
from dmae.formats.npz import export_npz
from dmae.formats.openpose import reproject, write_openpose
from dmae.formats.trc import write_trc
from dmae.mapping import convert
from dmae.progress import progress
from dmae.skeleton import PANOPTIC19, Skeleton, get_skeleton
from dmae.store import load_clip, save_clip, write_manifest

CALIBRATION = "calibration.toml"
"""Beside formats that have none of their own: Pose2Sim's."""
KEYPOINTS = "keypoints.json"


class ExportFormat(StrEnum):
    """What poses are exported as."""

    npz = "npz"
    trc = "trc"
    """OpenSim's, a file for each person."""
    panoptic = "panoptic"
    """A folder of CMU Panoptic's, always of its skeleton."""
    coco = "coco"
    """Poses as the cameras see them, labelled."""
    openpose = "openpose"
    """A folder of poses as the cameras see them."""


@dataclass(frozen=True)
class ExportCommand:
    """`dmae export`."""

    clip: str = "???"
    """A clip; its captured or completed poses are exported, its truth where it has none."""
    format: ExportFormat = ExportFormat.npz
    skeleton: str | None = None
    """By default the one the poses are in; of two fused the first, but for npz."""
    unit: Unit = Unit.m
    """Of a TRC."""
    out: str = "???"
    """The file to write; of panoptic and openpose the folder."""


def run_export(config: ExportCommand, out: Path) -> None:
    clip = load_clip(Path(config.clip))
    poses = clip.truth if clip.poses is None else clip.poses
    if poses is None:
        raise ValueError(f"{config.clip}: has neither poses nor truth to export; run dmae capture on it first")
    skeleton = _skeleton(config, poses)
    if config.format in (ExportFormat.panoptic, ExportFormat.openpose):
        _check_empty(out)
    written, first = convert(poses, skeleton), clip.provenance.get("first_frame", 0)
    # Where a calibration in error was simulated, truth is seen by the cameras as they are.
    rig = clip.true_rig if clip.true_rig is not None and poses is clip.truth else clip.rig
    if config.format == ExportFormat.npz:
        export_npz(written, clip.fps, out)
    elif config.format == ExportFormat.trc:
        write_trc(written, clip.fps, out, config.unit)
    elif config.format == ExportFormat.panoptic:
        write_calibration(rig, out / f"calibration_{clip.id}.json", CalibrationFormat.panoptic)
        panoptic.write_poses(written, clip.fps, out, first)
    elif config.format == ExportFormat.openpose:
        write_calibration(rig, out / CALIBRATION, CalibrationFormat.pose2sim)
        write_openpose(reproject(written, rig), rig.names, out, first, written.source)
    else:
        xy, flags = labels(clip, poses, rig, skeleton)
        write_coco(out, rig, clip.fps, skeleton, xy, flags, sources=written.source, first=first)
    frames, persons = written.xyz.shape[:2]
    print(f"{out}: {frames} frames, {persons} persons, {skeleton.name}")


def _check_empty(folder: Path) -> None:
    """Frames of another recording left in a folder would be read as this one's."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise ValueError(f"{folder}: expected no such folder yet, or an empty one, to write a file for each frame into")


def _skeleton(config: ExportCommand, poses: Poses3D) -> Skeleton:
    if config.format == ExportFormat.panoptic:
        if config.skeleton not in (None, PANOPTIC19.name):
            raise ValueError(
                f"skeleton={config.skeleton}: format=panoptic is always of {PANOPTIC19.name}; leave it out"
            )
        return PANOPTIC19
    if config.skeleton:
        return get_skeleton(config.skeleton)
    whole = config.format == ExportFormat.npz
    return poses.skeleton if whole else get_skeleton(poses.skeleton.name.split("+")[0])


def labels(clip: Clip, poses: Poses3D, rig: CameraRig, skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    """Poses of a clip as COCO labels them.

    Joints in the image are 2, visible, where the truth of a simulated clip says so, or of other poses where they
    were measured; 1 where they are hidden, or were completed. A joint derived from others is as visible as the
    least visible of them. Joints out of the image are 0.

    Returns:
        xy: (F, V, P, J, 2) px.
        flags: (F, V, P, J) int.
    """
    if poses is clip.truth and clip.visibility is not None:
        seen = np.where(clip.visibility == Visibility.VISIBLE, 2, 1)
    else:
        seen = np.where(poses.source == Source.COMPLETED, 1, 2)[:, None]
        seen = np.broadcast_to(seen, (len(seen), len(rig), *seen.shape[2:]))
    # `views` of derived joints is the least of those they are made of, which is what is wanted here.
    flags = np.stack([convert(replace(poses, views=seen[:, v]), skeleton).views for v in range(len(rig))], 1)
    xy, _ = rig.project(convert(poses, skeleton).xyz)
    return xy, np.where(rig.inside(xy), flags, 0)


class ConvertFormat(StrEnum):
    """What recordings are converted to."""

    clip = "clip"
    openpose = "openpose"
    easymocap = "easymocap"
    coco = "coco"


@dataclass(frozen=True)
class ConvertCommand:
    """`dmae convert`."""

    data: DataConfig = field(default_factory=DataConfig)
    format: ConvertFormat = ConvertFormat.clip
    out: str = "???"
    """The folder to write; of a data set a folder for each clip is made in it."""


def run_convert(config: ConvertCommand, out: Path) -> None:
    clips, several = load(config.data), is_data_set(config.data)
    manifest = []
    for clip, source in progress(zip(clips, clips.folders, strict=True), "converting", len(clips)):
        folder = out / source.name if several else out
        _write(clip, config.format, folder)
        manifest.append({"id": source.name, "status": "ok"})
        print(f"{folder}: {len(clip)} frames, {len(clip.rig)} cameras, {clip.detections.skeleton.name}")
        for note in clip.provenance.get("notes", ()):
            print(f"  {note}")
        if config.format in (ConvertFormat.openpose, ConvertFormat.easymocap):
            skeleton = clip.detections.skeleton.name
            print(f"  read it with data.fps={clip.fps:g} data.skeleton={skeleton}, which the format does not hold")
    if several and config.format == ConvertFormat.clip:
        write_manifest(out, manifest)


def _write(clip: Clip, format: ConvertFormat, folder: Path) -> None:
    """Detections and cameras of a clip; as a clip, all of it."""
    detections, first = clip.detections, clip.provenance.get("first_frame", 0)
    if format == ConvertFormat.clip:
        save_clip(clip, folder)
        return
    _check_empty(folder)
    if format == ConvertFormat.easymocap:
        write_calibration(clip.rig, folder, CalibrationFormat.easymocap)
        easymocap.write_detections(detections, clip.rig, folder, first)
        return
    write_calibration(clip.rig, folder / CALIBRATION, CalibrationFormat.pose2sim)
    if format == ConvertFormat.openpose:
        write_openpose(detections, clip.rig.names, folder, first)
    else:
        flags = np.where(detections.observed, 2, 0)
        path = folder / KEYPOINTS
        write_coco(
            path, clip.rig, clip.fps, detections.skeleton, detections.xy, flags, scores=detections.score, first=first
        )
