"""Joints as text: a table with a row for each joint (CSV); a line of JSON for each frame, as `dmae live` answers."""

import csv
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D, Source, person_names
from dmae.files.checks import MOST_METRES, check_numbers
from dmae.files.contents import read_text, write_atomic, written
from dmae.files.mapped import frame_blocks
from dmae.formats.config import METRES, LengthUnit
from dmae.formats.poses import REJECTED, SOURCE_WORDS, PoseFile, source_word
from dmae.formats.recordings import check_span, natural, plain
from dmae.formats.registry import pose_reader, pose_writer
from dmae.formats.skeletons import named_skeleton

_COLUMNS = {
    "frame": ("frame", "frame_id", "frame_number"),
    "person": ("person", "player", "athlete", "subject", "actor", "id", "track", "track_id", "person_id"),
    "joint": ("joint", "keypoint", "landmark", "marker", "joint_name"),
}
"""The names of columns that are read, by what they hold. Coordinates are x, y, z or x_mm, y_mm, z_mm and so on."""
_MOST_CELLS = 50_000_000
_DIGITS = {LengthUnit.m: 4, LengthUnit.cm: 2, LengthUnit.mm: 1}


@pose_writer("csv", errors=True)
def write_csv(poses: Poses3D, clip: Clip, path: Path, *, unit: LengthUnit = LengthUnit.m) -> None:
    """A table as text: a row for each joint of each person in each frame, with its source and standard error."""
    first, people, metre = clip.provenance.get("first_frame", 0), person_names(clip, poses.xyz.shape[1]), METRES[unit]
    joints, digits = poses.skeleton.joints, _DIGITS[unit]

    def rows() -> Iterator[str]:
        yield f"frame,time_s,person,joint,x_{unit},y_{unit},z_{unit},source,error_{unit}"
        for frame, xyz, source, views, error in _frames(poses):
            for person, name in enumerate(people):
                quoted = '"' + name.replace('"', '""') + '"' if {*name} & {*',"'} else name
                for joint, at in enumerate(xyz[person].astype(np.float64) / metre):
                    if source[person, joint] == Source.ABSENT:
                        continue
                    place = ",".join(f"{value:.{digits}f}" for value in at.tolist())
                    how = source_word(Source(source[person, joint]), views[person, joint])
                    off = error[person, joint] / metre
                    stated = "" if np.isnan(off) else f"{off:.{digits}f}"
                    yield f"{frame + first},{frame / clip.fps:.6f},{quoted},{joints[joint]},{place},{how},{stated}"

    write_atomic(path, written(rows()))


@pose_writer("jsonl", errors=True)
def write_jsonl(poses: Poses3D, clip: Clip, path: Path) -> None:
    """A line of JSON for each frame, after one with the names of joints, as `dmae live` answers."""
    first, people = clip.provenance.get("first_frame", 0), person_names(clip, poses.xyz.shape[1])
    names = [source.name.lower() for source in Source]

    def lines() -> Iterator[str]:
        skeleton = poses.skeleton
        yield json.dumps(
            {"skeleton": skeleton.name, "joints": skeleton.joints, "cameras": clip.rig.names, "fps": clip.fps}
        )
        for frame, xyz, source, _, error in _frames(poses):
            found = [
                {
                    "id": person,
                    "name": name,
                    "xyz": [None if np.isnan(at[0]) else at.round(4).tolist() for at in xyz[person].astype(np.float64)],
                    "source": [names[kind] for kind in source[person]],
                    "error_mm": [None if np.isnan(off) else round(1000 * off, 1) for off in error[person].tolist()],
                }
                for person, name in enumerate(people)
                if (source[person] != Source.ABSENT).any()
            ]
            yield json.dumps({"frame": frame + first, "people": found})

    write_atomic(path, written(lines()))


def _frames(poses: Poses3D) -> Iterator[tuple]:
    """Yield number, coordinates (P, J, 3) m, sources, views and standard errors (P, J) m of each frame."""
    for part in frame_blocks(poses.cov):
        some = poses.select(part)
        error = np.sqrt(np.trace(some.cov.astype(np.float64), axis1=-2, axis2=-1) / 3)
        yield from zip(
            range(part.start, part.start + len(error)), some.xyz, some.source, some.views, error, strict=True
        )


def _rows(path: Path) -> Iterator[list[str]]:
    try:
        yield from csv.reader(read_text(path).splitlines())
    except csv.Error as error:
        raise ValueError(f"{path}: expected a table of values between commas, {error}") from None


@pose_reader("csv", file="*.csv")
def read_csv_poses(path: Path) -> PoseFile:
    """A table with the columns frame, person, joint, x, y, z (m, or x_mm and so on), a row for each known joint."""
    path = Path(path)
    rows = _rows(path)
    header = [name.strip() for name in next(rows, [])]
    named = {plain(name): place for place, name in enumerate(header)}
    wanted = {
        key: next((named[plain(name)] for name in names if plain(name) in named), -1) for key, names in _COLUMNS.items()
    }
    units = [unit for unit in ("", *LengthUnit) if all(f"{axis}{unit}" in named for axis in "xyz")]
    lacking = [key for key, place in wanted.items() if place < 0 and key != "person"] + ["x, y, z"] * (not units)
    if lacking:
        raise ValueError(
            f"{path}: expected columns frame, person, joint, x, y, z, found no {', '.join(lacking)} among {header}"
        )
    places = [named[f"{axis}{units[0]}"] for axis in "xyz"]
    how = named.get("source")
    frames: list[int] = []
    people: list[str] = []
    joints: list[str] = []
    xyz: list[list[float]] = []
    sources: list[Source] = []
    kinds = {word: kind for kind, word in SOURCE_WORDS.items()} | {REJECTED: Source.COMPLETED}
    for number, row in enumerate(rows, 2):
        if not any(cell.strip() for cell in row):
            continue
        try:
            at = [float(row[place]) if row[place].strip() else np.nan for place in places]
            frames.append(int(np.int64(row[wanted["frame"]])))
            joints.append(row[wanted["joint"]].strip())
            people.append("" if wanted["person"] < 0 else row[wanted["person"]].strip())
            sources.append(Source.MEASURED if how is None else kinds[row[how].strip()])
        except (ValueError, IndexError, KeyError, OverflowError) as error:
            choices = "" if how is None else f", and one of the sources {', '.join(kinds)}"
            raise ValueError(
                f"{path}, line {number}: expected a frame, names and numbers{choices}; found {row!r:.90} ({error})"
            ) from None
        xyz.append(at)
    if not frames:
        raise ValueError(f"{path}: expected rows of joints, found none")
    persons = sorted({*people}, key=natural)
    names = [*dict.fromkeys(joints)]
    skeleton, order, _ = named_skeleton(names, (), None, path)
    check_span(path, frames, len(set(frames)))
    span = max(frames) - min(frames) + 1
    if span * len(persons) * len(skeleton) > _MOST_CELLS:
        raise ValueError(f"{path}: found {len(persons)} people of {len(skeleton)} joints in {span} frames, too many")
    number_of = {name: place for place, name in enumerate(persons)}
    place_of = {names[each]: place for place, each in enumerate(order)}
    where = (
        np.array(frames) - min(frames),
        np.array([number_of[name] for name in people]),
        np.array([place_of.get(joint, -1) for joint in joints]),
    )
    values = np.array(xyz) * (METRES[LengthUnit(units[0])] if units[0] else 1.0)
    check_numbers(f"{path}: coordinates", values, MOST_METRES)
    if len({*zip(*(index.tolist() for index in where), strict=True)}) < len(frames):
        raise ValueError(f"{path}: expected each joint of a person once in a frame, found some twice")
    known = where[2] >= 0
    cells = tuple(index[known] for index in where)
    shape = (span, len(persons), len(skeleton))
    whole, source = np.full((*shape, 3), np.nan), np.zeros(shape, np.uint8)
    whole[cells], source[cells] = values[known], np.array(sources, np.uint8)[known]
    source[np.isnan(whole).any(-1)] = Source.ABSENT
    whole[source == Source.ABSENT] = np.nan
    poses = Poses3D(skeleton, whole, source)
    poses.check_numbers()
    return PoseFile(poses, first=min(frames))
