"""Write poses and recordings in any format."""

from dataclasses import replace
from pathlib import Path

from dmae.data.clip import Clip, Poses3D
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.data.skeleton_conversion import convert
from dmae.data.store import check_vacant
from dmae.files.names import child
from dmae.formats.calibrations.conventions import LengthUnit
from dmae.formats.registry import PoseWriter, pose_writer, recording_writer
from dmae.numerics.likely_error import without_unlikely

_SUFFIXES = {"coco": ".json", "movement": ".nc"}
"""Of files that are not called like their format."""


def export_path(path: Path, format: str) -> Path:
    """Return the path that `write_poses` writes: with the suffix of the format, where it has none and is a file."""
    writer, path = pose_writer.find(format), Path(path)
    if writer.folder or path.suffix or writer.name not in pose_writer:
        return path
    return path.with_suffix(_SUFFIXES.get(writer.name, f".{writer.name}"))


def write_poses(
    clip: Clip,
    path: Path,
    format: str = "npz",
    *,
    skeleton: str | None = None,
    unit: LengthUnit = LengthUnit.m,
    keep_mm: float | None = None,
) -> Poses3D:
    """Write the captured or completed poses of a clip, or its truth where it has none.

    Args:
        clip: Has poses or truth.
        path: File to write, see `export_path`; for some formats a folder, which must be empty or not exist.
        format: Name of a pose writer, or `package.module:function`.
        skeleton: Skeleton to write; by default that of the poses, of two fused the first unless the format has both.
        unit: Unit of lengths, for formats that have one.
        keep_mm: Leave out joints that are likely farther than this from the truth, by their covariances, see
            `dmae.numerics.likely_error.without_unlikely`; by default none.

    Returns:
        The poses on the skeleton that was written.

    Raises:
        ValueError: there are neither poses nor truth, no such format, the format does not have the skeleton or units,
            the folder is not empty, or `keep_mm` is not a positive number.
        KeyError: there is no such skeleton.
    """
    writer, path = pose_writer.find(format), export_path(path, format)
    poses = exported_poses(clip)
    if poses is None:
        raise ValueError(f"clip {clip.id!r} has neither poses nor truth to export; run dmae capture on it first")
    kept = without_unlikely(poses, keep_mm)
    written = convert(kept, _skeleton(writer, poses, skeleton))
    options = {}
    if "unit" in writer.options:
        options["unit"] = LengthUnit(unit)
    elif unit != LengthUnit.m:
        raise ValueError(f"unit={unit}: format={writer.name} is always in m; leave it out")
    if writer.folder:
        _check_folder(path, clip)
    if poses is clip.truth and clip.true_rig is not None:
        # Truth is seen by the true cameras, not by those of a calibration in error.
        clip = replace(clip, rig=clip.true_rig)
    if poses is clip.poses:
        # Some writers project the poses of the clip.
        clip = replace(clip, poses=kept)
    writer.function(written, clip, path, **options)
    return written


def write_recording(clip: Clip, path: Path, format: str = "clip") -> str:
    """Write the detections and cameras of a clip; as a clip, all of it.

    Args:
        clip: Any clip.
        path: Folder to write; except for clips it must be empty or not exist.
        format: Name of a recording writer, or `package.module:function`.

    Returns:
        The options of `DataConfig` that a reader has to be given, as the format does not hold them, as commands take
        them; empty where there are none.

    Raises:
        ValueError: there is no such format, the folder is not empty, or the format cannot hold the cameras.
    """
    writer, path = recording_writer.find(format), Path(path)
    if writer.name != "clip":
        _check_folder(path, clip)
    writer.function(clip, path)
    skeleton = clip.detections.skeleton
    values = {"fps": f"{clip.fps:g}", "skeleton": f"{skeleton.name}.yaml" if skeleton.defined else skeleton.name}
    return " ".join(f"data.{option}={values[option]}" for option in writer.lacks)


def exported_poses(clip: Clip) -> Poses3D | None:
    """Return the poses of a clip that `write_poses` writes: captured or completed ones, else the truth."""
    return clip.truth if clip.poses is None else clip.poses


def _skeleton(writer: PoseWriter, poses: Poses3D, wanted: str | None) -> Skeleton:
    only = writer.skeleton
    if only and wanted not in (None, only):
        raise ValueError(f"skeleton={wanted}: format={writer.name} is always of {only}; leave it out")
    if only or wanted:
        skeleton = get_skeleton(only or wanted)
        common = set(skeleton.joints) & set(poses.skeleton.joints)
        if only and poses.skeleton.defined and 2 * len(common) < len(skeleton):
            raise ValueError(
                f"format={writer.name} is always of {only}, and {poses.skeleton.name} has {len(common)} of its "
                f"{len(skeleton)} joints; npz, trc, c3d, coco and movement hold any skeleton"
            )
        return skeleton
    return poses.skeleton if writer.fused else poses.skeleton.parts[0]


def _check_folder(folder: Path, clip: Clip) -> None:
    """Refuse a folder with files, which would be read as part of the new recording, and cameras that cannot be names
    of folders in it.
    """
    check_vacant(folder, "a file for each frame")
    for name in clip.rig.names:
        child(folder, name, "camera")
