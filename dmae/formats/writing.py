"""Write poses and recordings in any format."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from dmae.data.clip import Clip, Poses3D, person_name, person_names
from dmae.data.conversion import convert
from dmae.data.skeleton import Skeleton, encode, get_skeleton
from dmae.files.checks import child
from dmae.files.contents import check_vacant, whole_folder, write_atomic
from dmae.formats.config import LengthUnit
from dmae.formats.poses import provenance_people, provenance_table, write_provenance
from dmae.formats.registry import PoseWriter, pose_writer, recording_writer

_SUFFIXES = {"coco": ".json", "g1": ".csv", "movement": ".nc"}
"""Suffixes of files by format, where the suffix differs from the name of the format."""


@dataclass(frozen=True)
class Written:
    """What an export wrote."""

    poses: Poses3D  # The poses, on the skeleton that was written
    files: tuple[Path, ...]  # The files or folders of poses, and the table of their sources if the format needs one


def format_of(path: Path) -> str:
    """Return the format that the suffix of a file names: trc for walk.trc; npz if it names none."""
    name = path.suffix.lower().removeprefix(".")
    return name if name in pose_writer and not pose_writer[name].folder else "npz"


def export_path(path: Path, format: str | None) -> Path:
    """Return the path that `write_poses` writes. A file without a suffix gets the suffix of the format.

    Without a format it is `format_of` the path.

    Raises ValueError if the format is unknown, or a format of this package writes another suffix.
    """
    path = Path(path)
    writer = pose_writer.find(format or format_of(path))
    if writer.folder or writer.name not in pose_writer:
        return path
    own = _suffix(writer)
    if not path.suffix:
        return path.with_suffix(own)
    if path.suffix.lower() == own or not writer.home.startswith(f"{__package__}."):
        return path  # A format of the user may have any suffix
    files: dict[str, PoseWriter] = {}
    for each in pose_writer.values():
        if not each.folder:
            files.setdefault(_suffix(each), each)
    found = f"{path}: format={writer.name} writes {own} files"
    other = files.get(path.suffix.lower())
    if other is None:
        raise ValueError(
            f"{found}, and no format writes {path.suffix} files; expected "
            + ", ".join(f"{suffix} (format={known.name})" for suffix, known in files.items())
        )
    raise ValueError(f"{found}; {path.suffix} files are of format={other.name} ({other.help.rstrip('.')})")


def _suffix(writer: PoseWriter) -> str:
    return _SUFFIXES.get(writer.name, f".{writer.name}")


def write_poses(
    clip: Clip,
    path: Path,
    format: str | None = None,
    *,
    skeleton: str | Path | Skeleton | None = None,
    unit: LengthUnit = LengthUnit.m,
    keep_mm: float | None = None,
    robot: str | None = None,
    people: Sequence[str] = (),
) -> Written:
    """Write the captured or completed poses of a clip, or its truth if it has no poses; options as in `dmae.export`.

    `path` is completed by `export_path`. By default the poses keep their skeleton; of a fused one, the first part is
    written, unless the format writes all parts.

    Raises:
        ValueError: the clip has neither poses nor truth, or nobody in them for a format of people; the format is
            unknown, needs what is not installed, or does not support the skeleton or unit, the folder is not empty, or
            `keep_mm` is not a positive number.
        KeyError: the skeleton is unknown.
    """
    writer, path = pose_writer.find(format or format_of(Path(path))), export_path(path, format)
    writer.check_installed()
    poses = exported_poses(clip)
    if poses is clip.truth and clip.true_rig is not None:
        # Project the truth with the true cameras: the calibration of the clip can have errors.
        clip = replace(clip, rig=clip.true_rig)
    if people:
        clip = _of_people(clip, poses, people)
        poses = exported_poses(clip)
    if writer.table and not poses.source.size:
        frames, persons, _ = poses.source.shape
        raise ValueError(
            f"clip {clip.id!r}: found {persons} people in {frames} frames, and format={writer.name} needs one at least"
        )
    options: dict = {}
    if skeleton in writer.rigs:
        options["rig"], skeleton = skeleton, None
        if unit not in (LengthUnit.m, LengthUnit.cm):
            raise ValueError(f"unit={unit}: skeleton={options['rig']} is always in cm; leave it out")
    kept = poses
    if keep_mm is not None:
        from dmae.numerics.statistics import without_unlikely  # it loads Numba, which other exports do not need

        kept = without_unlikely(poses, keep_mm)
    written = convert(kept, _skeleton(writer, poses, skeleton))
    if "unit" in writer.options:
        options["unit"] = LengthUnit(unit)
    elif unit != LengthUnit.m:
        raise ValueError(f"unit={unit}: format={writer.name} is always in m; leave it out")
    if "robot" in writer.options:
        options["robot"] = robot
    elif robot is not None:
        raise ValueError(f"robot={robot}: format={writer.name} is not of a robot; leave it out")
    if writer.folder:
        _check_folder(path, clip)
    names = person_names(clip, poses.xyz.shape[1])
    if writer.table and (earlier := provenance_people(path)) not in ([], names):
        raise ValueError(
            f"{provenance_table(path)}: of an earlier export with other people, {', '.join(earlier)}; this one writes "
            f"{', '.join(names)}. Remove the earlier files, give the same people=, or choose another out"
        )
    if poses is clip.poses:
        # Some writers project the poses that the clip contains.
        clip = replace(clip, poses=kept)
    files = writer.function(written, clip, path, **options) or [path]
    if writer.table:
        captured = kept if writer.fused else convert(kept, kept.skeleton.parts[0])
        write_provenance(path, captured, clip.fps, clip.provenance.get("first_frame", 0), names)
        files = [*files, provenance_table(path)]
    return Written(written, tuple(files))


def write_recording(clip: Clip, path: Path, format: str = "clip") -> str:
    """Write the detections and cameras of a clip, as `dmae.convert`. The format `clip` writes everything in the clip.

    A skeleton of your own, if the format cannot store it, is written beside the detections as `<name>.yaml`.

    Returns the options, as on a command line, that the format cannot store and that its reader needs; empty if none.
    Raises ValueError if the format is unknown, the folder is not empty, or the format cannot store the cameras. Nothing
    is left in the folder then.
    """
    writer, path = recording_writer.find(format), Path(path)
    if writer.name == "clip":  # It may replace an earlier clip, and is written whole or not at all
        writer.function(clip, path)
        return ""
    _check_folder(path, clip)
    skeleton = clip.detections.skeleton
    values = {"fps": f"{clip.fps:g}", "skeleton": skeleton.name}
    with whole_folder(path) as folder:
        writer.function(clip, folder)
        if skeleton.defined and "skeleton" in writer.lacks:
            definition = child(folder, f"{skeleton.name}.yaml", "skeleton")
            write_atomic(definition, yaml.safe_dump(encode(skeleton), sort_keys=False, allow_unicode=True))
            values["skeleton"] = str(path / definition.name)
    return " ".join(f"data.{option}={values[option]}" for option in writer.lacks)


def exported_poses(clip: Clip) -> Poses3D:
    """Return the poses that `write_poses` writes: captured or completed, or else the truth; ValueError if none."""
    poses = clip.truth if clip.poses is None else clip.poses
    if poses is None:
        raise ValueError(f"clip {clip.id!r} has neither poses nor truth to export; run dmae capture on it first")
    return poses


def _of_people(clip: Clip, poses: Poses3D, people: Sequence[str]) -> Clip:
    """Return the clip with only these persons in `poses`, entries as `P2` or `P2:anna`, and their names."""
    known = [person_name(person) for person in range(poses.xyz.shape[1])]
    given = [(number, name or number) for number, _, name in (entry.partition(":") for entry in people)]
    numbers, names = zip(*given, strict=True)
    if not {*numbers} <= {*known} or len({*numbers}) < len(numbers):
        raise ValueError(
            f"people=[{','.join(people)}]: expected some of {', '.join(known) or 'nobody'}, each once, or with a name "
            f"as {known[0] if known else 'P1'}:anna"
        )
    for name in names:
        child(Path(), name, "person")
    if any("," in name for name in names) or len({name.lower() for name in names}) < len(names):
        raise ValueError(f"people=[{','.join(people)}]: expected different names, without commas")
    chosen = [known.index(number) for number in numbers]
    return replace(clip, poses=poses.select(persons=chosen), provenance=clip.provenance | {"people": list(names)})


def _skeleton(writer: PoseWriter, poses: Poses3D, wanted: str | Path | Skeleton | None) -> Skeleton:
    only = writer.skeleton
    if only and wanted not in (None, only, get_skeleton(only)):
        raise ValueError(f"skeleton={wanted}: format={writer.name} is always of {only}; leave it out")
    if name := only or wanted:
        skeleton = get_skeleton(name)
        common = set(skeleton.joints) & set(poses.skeleton.joints)
        if only and poses.skeleton.defined and 2 * len(common) < len(skeleton):
            raise ValueError(
                f"format={writer.name} is always of {only}, and {poses.skeleton.name} has {len(common)} of its "
                f"{len(skeleton)} joints; npz, trc, c3d, coco, openpose, bvh, glb and movement hold any skeleton"
            )
        return skeleton
    return poses.skeleton if writer.fused else poses.skeleton.parts[0]


def _check_folder(folder: Path, clip: Clip) -> None:
    """Refuse a folder with files, which readers would take for the new recording's, and camera names that name no
    folder."""
    check_vacant(folder, "a file for each frame")
    for name in clip.rig.names:
        child(folder, name, "camera")
