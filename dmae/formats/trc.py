"""TRC, OpenSim's text format for markers: y up, separated by tabs, `NaN` where a marker is absent.

OpenSim 4.6 drops an empty cell at the end of a line and then refuses the file, so absence is written as `NaN`, which
OpenSim and Pose2Sim both read.
"""

import re
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path

import numpy as np
import yaml

from dmae.data.array_fields import UNSET
from dmae.data.clip import Clip, Poses3D, person_name, person_names
from dmae.data.skeleton import SKELETONS, Skeleton, encode, read_skeleton
from dmae.files.checks import MOST_METRES, check_numbers, check_rate
from dmae.files.contents import read_text, write_atomic, written
from dmae.files.mapped import frame_blocks
from dmae.formats.config import METRES, LengthUnit
from dmae.formats.poses import PoseFile, person_paths, provenance_people, read_provenance
from dmae.formats.recordings import csv_rows
from dmae.formats.registry import pose_reader, pose_writer
from dmae.formats.skeletons import bare

# Indices that reorder axes from TRC to world, and from world to TRC: TRC (x, y, z) = world (y, z, x).
_WORLD = (2, 0, 1)
_TRC = (1, 2, 0)
_SIDES = {"l_": "L", "r_": "R"}
_OPENSIM = {"head_top": "Head", "mid_hip": "CHip"} | {
    f"{side}_{finger}_finger": f"{letter}{name}"
    for side, letter in (("l", "L"), ("r", "R"))
    for finger, name in (("little", "Pinky"), ("index", "Index"))
}
_OPENSIM_HALPE26 = _OPENSIM | {"mid_hip": "Hip"}
"""Markers by joint, if Pose2Sim's OpenSim models use another name than `marker`. Halpe's models differ in the hip."""
_ALIASES = {name: joint for joint, name in _OPENSIM.items()} | {"Hip": "mid_hip"}  # Joints by the name of the marker
_FIRST_ROW = 5  # Number of lines of the header. OpenSim's own files have an empty line after it.


def marker(joint: str) -> str:
    """Return the name of the marker of a joint, as in OpenPose: l_big_toe is LBigToe, mid_hip is MidHip."""
    part, side, rest = "", joint[:2], joint
    if side in _SIDES:
        part, rest = _SIDES[side], joint[2:]
    return part + "".join(word.capitalize() for word in rest.split("_"))


def opensim_marker(joint: str, skeleton: Skeleton) -> str:
    """Return the name of the marker of a joint in Pose2Sim's models for OpenSim: mid_hip is CHip, or Hip in Halpe's.

    In your own skeleton, markers have the names of their joints.
    """
    if skeleton.defined:
        return joint
    names = _OPENSIM_HALPE26 if skeleton.name == "halpe26" else _OPENSIM
    return names.get(joint) or marker(joint)


def read_trc(path: Path, skeleton: Skeleton | None = None) -> tuple[Poses3D, float]:
    """Return the poses of one person from a TRC, in m and world axes, and the frame rate in frames/s.

    `source` and `cov` come from the tables that an export writes next to the TRC. Without these tables, all markers
    count as measured, although some programs write interpolated markers.

    Args:
        skeleton: By default the one defined in the file next to the TRC, or else the smallest skeleton of this package
            that has all markers. Joints without a marker are absent.

    Raises:
        FileNotFoundError: the file does not exist.
        ValueError: the file is malformed; the message names the line.
        KeyError: no skeleton has all markers.
    """
    path = Path(path)
    lines = _lines(path)
    rate, unit, names = _header(path, lines)
    metre, skeleton = METRES[unit], skeleton or _skeleton(path, names)
    named = [_joint(name, skeleton) for name in names]
    unknown = [name for name, joint in zip(names, named, strict=True) if joint not in skeleton.joints]
    if unknown:
        raise KeyError(f"{path}: skeleton {skeleton.name!r} has no joints for the markers {unknown}")
    if len(set(named)) < len(named):
        raise ValueError(f"{path}: expected a marker for each joint, found two of one among {', '.join(names)}")
    joints = skeleton.index(*named)
    rows = _rows(path, lines, len(names))
    xyz = np.full((len(rows), 1, len(skeleton), 3), np.nan)
    check_numbers(f"{path}: coordinates", rows, MOST_METRES / metre)
    xyz[:, 0, joints] = rows[:, :, _WORLD] * metre
    xyz[np.isnan(xyz).any(-1)] = np.nan
    try:
        source, known = UNSET, read_provenance(path, [skeleton.joints[joint] for joint in joints], len(xyz))
        if known is not None:
            source = np.zeros(xyz.shape[:-1], np.uint8)
            source[:, 0, joints] = known
        poses = Poses3D(skeleton, xyz, source, _read_cov(path, xyz, joints, metre))
        poses.check_numbers()
        return poses, check_rate("DataRate", rate)
    except ValueError as error:
        raise ValueError(str(error) if str(path.parent) in str(error) else f"{path}: {error}") from None


def trc_rate(path: Path) -> float:
    """Return the frames per second of a TRC; ValueError as in `read_trc`."""
    return _header(path, _lines(path))[0]


def _lines(path: Path) -> list[str]:
    lines = read_text(path).splitlines()
    if len(lines) < _FIRST_ROW or not lines[0].startswith("PathFileType"):
        raise ValueError(f"{path}: expected a TRC, five lines of header from PathFileType on, found {lines[:1]}")
    return lines


def _header(path: Path, lines: list[str]) -> tuple[float, LengthUnit, list[str]]:
    """Return rate and unit, from lines 2 and 3, and the names of the markers from line 4."""
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    try:
        rate, unit = float(header["DataRate"]), LengthUnit(header["Units"].strip())
    except (KeyError, ValueError):
        raise ValueError(
            f"{path}, lines 2 and 3: expected a DataRate and Units of {', '.join(LengthUnit)}, found {header}"
        ) from None
    names = [name.strip() for name in lines[3].split("\t")[2::3] if name.strip()]
    if not rate > 0 or not names or len(set(names)) < len(names):
        raise ValueError(f"{path}: expected a positive rate and different markers, found {rate:g} and {names}")
    return rate, unit, names


def _rows(path: Path, lines: list[str], markers: int) -> np.ndarray:
    """Return the coordinates (F, markers, 3) in the axes and the unit of the file; NaN where a cell is empty."""
    rows = []
    for number, line in enumerate(lines[_FIRST_ROW:], _FIRST_ROW + 1):
        if not line.strip():
            continue
        # Editors and OpenSim drop or add empty cells at the end of a line.
        cells = line.split("\t")[2:]
        if any(cell.strip() for cell in cells[3 * markers :]):
            raise ValueError(f"{path}, line {number}: expected {3 * markers} coordinates, found {len(cells)}")
        cells = (cells + [""] * (3 * markers))[: 3 * markers]
        try:
            rows.append([float(cell) if cell.strip() else np.nan for cell in cells])
        except ValueError as error:
            raise ValueError(f"{path}, line {number}: expected numbers, {error}") from None
    return np.array(rows).reshape(len(rows), markers, 3)


def _joint(name: str, skeleton: Skeleton) -> str:
    if name in skeleton.joints:
        return name
    joint = next((joint for joint in skeleton.joints if bare(joint) == bare(name)), None)
    return joint or _ALIASES.get(name, name)


def _skeleton_file(path: Path) -> Path:
    return path.with_suffix(".skeleton.yaml")


def _covariance_table(path: Path) -> Path:
    return path.with_suffix(".covariance.csv")


def _skeleton(path: Path, names: list[str]) -> Skeleton:
    if _skeleton_file(path).is_file():
        return read_skeleton(_skeleton_file(path))
    for skeleton in sorted(SKELETONS.values(), key=len):
        if all(_joint(name, skeleton) in skeleton.joints for name in names):
            return skeleton
    known = {bare(joint) for skeleton in SKELETONS.values() for joint in skeleton.joints} | {*map(bare, _ALIASES)}
    raise KeyError(
        f"{path}: no skeleton has all of the markers {names}; of no skeleton are "
        f"{sorted(name for name in names if bare(name) not in known)}, "
        f"there are {sorted(SKELETONS)}; {_skeleton_file(path).name} next to it defines another"
    )


@pose_reader("trc", file="*.trc")
def read_trc_poses(path: Path) -> PoseFile:
    """OpenSim's markers: one person, or the files `<name>_P1.trc`, ... that `write_trc` wrote for several persons."""
    path = Path(path)
    files = [path] if path.is_file() else _person_files(path)
    read = [read_trc(file) for file in files]
    first, rate = read[0]
    for file, (poses, other) in zip(files, read, strict=True):
        if (len(poses.xyz), poses.skeleton, other) != (len(first.xyz), first.skeleton, rate):
            raise ValueError(
                f"{file}: expected {len(first.xyz)} frames at {rate:g}/s of {first.skeleton.name} as in "
                f"{files[0].name}, found {len(poses.xyz)} at {other:g}/s of {poses.skeleton.name}"
            )
    arrays = [np.concatenate([getattr(poses, name) for poses, _ in read], 1) for name in ("xyz", "source", "cov")]
    return PoseFile(Poses3D(first.skeleton, *arrays), rate)


def _person_files(path: Path) -> list[Path]:
    """Return the files of the persons that `<name>.provenance.csv` names, or `<name>_P<number>.trc` by number."""
    named = [path.with_name(f"{path.stem}_{person}{path.suffix}") for person in provenance_people(path)]
    if named and all(file.is_file() for file in named):
        return named
    numbered = {}
    for file in path.parent.glob("*.trc"):
        number = re.fullmatch(rf"{re.escape(path.stem)}_P(\d+)", file.stem)
        if number:
            numbered[int(number[1])] = file
    if not numbered:
        raise FileNotFoundError(f"{path}: no such file, and no {path.stem}_P1.trc")
    return [numbered[number] for number in sorted(numbered)]


@pose_writer("trc", table=True, errors=True)
def write_trc_poses(poses: Poses3D, clip: Clip, path: Path, *, unit: LengthUnit = LengthUnit.m) -> list[Path]:
    """OpenSim's markers, a file for each person, with the covariances of joints in further files."""
    people = person_names(clip, poses.xyz.shape[1])
    files = write_trc(poses, clip.fps, path, unit, clip.provenance.get("first_frame", 0), people)
    beside = (each(file) for each in (_covariance_table, _skeleton_file) for file in files)
    return files + [file for file in beside if file.is_file()]


def write_trc(
    poses: Poses3D,
    fps: float,
    path: Path,
    unit: LengthUnit = LengthUnit.m,
    first: int = 0,
    people: Sequence[str] | None = None,
) -> list[Path]:
    """Write one TRC file per person, to a micrometre. `person_paths` gives their names.

    `<name>.covariance.csv` contains the known covariances of the joints, in the axes and the unit of the TRC, and
    `<name>.skeleton.yaml` defines the skeleton if it is not one of this package. A TRC cannot state that a joint was
    not measured: see `write_provenance`.

    Args:
        first: Number of the first frame in the recording. Its time is 0 s.
        people: Names of the persons; by default P1, P2, ...

    Returns:
        The TRC files.
    """
    names = [opensim_marker(joint, poses.skeleton) for joint in poses.skeleton.joints]
    paths = person_paths(path, people or [person_name(person) for person in range(poses.xyz.shape[1])])
    digits = {LengthUnit.m: 6, LengthUnit.cm: 4, LengthUnit.mm: 3}[unit]
    for person, file in enumerate(paths):
        frames, rate = len(poses.xyz), f"{fps:.10g}"
        header = [
            f"PathFileType\t4\t(X/Y/Z)\t{file.name}",
            "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames",
            f"{rate}\t{rate}\t{frames}\t{len(names)}\t{unit}\t{rate}\t{first}\t{frames}",
            "Frame#\tTime\t" + "\t\t\t".join(names) + "\t\t",
            "\t\t" + "\t".join(f"{axis}{number}" for number in range(1, len(names) + 1) for axis in "XYZ"),
        ]
        rows = _rows_of(poses.xyz[:, person], METRES[unit], fps, digits, first)
        write_atomic(file, written(chain(header, rows)))
        if poses.skeleton.defined:
            write_atomic(
                _skeleton_file(file), yaml.safe_dump(encode(poses.skeleton), sort_keys=False, allow_unicode=True)
            )
        else:
            _skeleton_file(file).unlink(missing_ok=True)
        _write_cov(file, names, poses.cov[:, person], METRES[unit], first)
    return paths


def _rows_of(xyz: np.ndarray, metre: float, fps: float, digits: int, first: int) -> Iterator[str]:
    for frame, row in enumerate(xyz):
        values = (row[:, _TRC].astype(np.float64) / metre).ravel().tolist()
        cells = ("NaN" if v != v else f"{v:.{digits}f}" for v in values)
        yield "\t".join([str(frame + first), f"{frame / fps:.6f}", *cells])


_ENTRIES = ("xx", "xy", "xz", "yy", "yz", "zz")
_ROWS, _COLUMNS = np.triu_indices(3)


def _write_cov(path: Path, names: list[str], cov: np.ndarray, metre: float, first: int) -> None:
    """Write `<name>.covariance.csv` beside a TRC: six columns per joint, in its axes and the square of its unit.

    Unknown covariances are empty cells; if all are, an earlier table is removed. The unit of the TRC is `metre` m.
    """
    if all(np.isnan(cov[part]).all() for part in frame_blocks(cov)):
        _covariance_table(path).unlink(missing_ok=True)
        return

    def lines() -> Iterator[str]:
        yield ",".join(["Frame#", *(f"{name}_{entry}" for name in names for entry in _ENTRIES)])
        for part in frame_blocks(cov):
            turned = cov[part].astype(np.float64)[..., _TRC, :][..., _TRC] / metre**2
            rows = turned[:, :, _ROWS, _COLUMNS].reshape(len(turned), -1)
            for frame, row in enumerate(rows, first + part.start):
                yield ",".join([str(frame), *("" if value != value else f"{value:.6g}" for value in row.tolist())])

    write_atomic(_covariance_table(path), written(lines()))


def _read_cov(path: Path, xyz: np.ndarray, joints: list[int], metre: float) -> np.ndarray:
    """Return the covariances (F, 1, J, 3, 3) m^2 beside a TRC, NaN where unknown; `UNSET` if there is no table."""
    table = _covariance_table(path)
    if not table.is_file():
        return UNSET
    lines, columns = [line.split(",") for line in read_text(table).splitlines()[1:]], 1 + len(_ENTRIES) * len(joints)
    if len(lines) != len(xyz) or any(len(line) != columns for line in lines):
        raise ValueError(
            f"{table}: expected {len(xyz)} frames of {len(joints)} markers as in {path.name}; delete it if it is of "
            "another file"
        )
    values = csv_rows(table, lines, columns, 2)[:, 1:].reshape(len(xyz), len(joints), len(_ENTRIES))
    found = np.empty((*values.shape[:2], 3, 3))
    found[..., _ROWS, _COLUMNS] = found[..., _COLUMNS, _ROWS] = values
    cov = np.full((*xyz.shape, 3), np.nan)
    cov[:, 0, joints] = found[..., _WORLD, :][..., _WORLD] * metre**2
    cov[np.isnan(xyz).any(-1)] = np.nan
    return cov
