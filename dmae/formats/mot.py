"""MOT, OpenSim's text format for joint angles, by our own inverse kinematics (`dmae.numerics.kinematics`).

`docs/reference/files.md` lists the columns, and the columns of `<name>.angles.csv`. Axes and times are as in our
TRC.

Every cell holds a number: OpenSim 4.6 silently stops reading a motion at its first `NaN`. Where the joints do not
determine an angle, the file has a straight line between the frames in which they do, and the angle of a body at rest if
there is no such frame. A line above `endheader` says so. Before the first and after the last frame in which a person is
known there are no rows; times count from the first frame of the clip, as in the files of all people.
"""

from collections.abc import Iterator
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D, person_names
from dmae.files.contents import write_atomic, written
from dmae.formats.animation import Y_UP, with_bodies
from dmae.formats.poses import SOURCE_WORDS, person_paths, stay
from dmae.formats.registry import pose_writer
from dmae.numerics.kinematics import ANGLES, BodyMotion, body_motion, defining_joints, estimated_angles

_PLACES = ("pelvis_tx", "pelvis_ty", "pelvis_tz")
_PELVIS = 3  # Number of angles of the pelvis, which come before its place


@pose_writer("mot", table=True, errors=True, fills="stay")
def write_mot(poses: Poses3D, clip: Clip, path: Path) -> list[Path]:
    """OpenSim's joint angles, a file for each person, with the standard deviation of each angle in a second file."""
    people = person_names(clip, poses.xyz.shape[1])
    files, paths = [], person_paths(path, people)
    names = [angle.name for angle in ANGLES]
    names[_PELVIS:_PELVIS] = _PLACES
    for person, motion in with_bodies(len(paths), partial(body_motion, poses)):
        file, table = paths[person], paths[person].with_suffix(".angles.csv")
        if motion is None:
            for stale in (file, table):
                stale.unlink(missing_ok=True)
            continue
        estimates, spread, known = estimated_angles(motion, Y_UP)
        place, place_sd = motion.root @ Y_UP.T, np.sqrt(np.diagonal(Y_UP @ motion.root_cov @ Y_UP.T, axis1=1, axis2=2))
        # Without any joint the body does not move, and is nowhere.
        somewhere = np.repeat(known[:, :_PELVIS].any(1, keepdims=True), 3, 1)
        estimates, spread, known = (
            np.concatenate([turned[:, :_PELVIS], at, turned[:, _PELVIS:]], 1)
            for turned, at in ((estimates, place), (spread, place_sd), (known, somewhere))
        )
        first, last = stay(poses, person)
        rows = slice(first, last + 1)
        estimates, known, source = estimates[rows], known[rows], poses.source[rows, person]
        spread = np.where(known, spread[rows], np.nan)
        values = np.empty_like(estimates)
        for column, name in enumerate(names):
            turn = None if name in _PLACES else 360
            values[:, column] = _without_gaps(estimates[:, column], known[:, column], turn)
        times = np.arange(first, last + 1) / clip.fps
        header = [people[person], "version=1", f"nRows={len(values)}", f"nColumns={1 + len(names)}",
                  "inDegrees=yes",
                  f"Angles that the joints do not determine are filled here, and empty in {table.name}.",
                  "endheader", "\t".join(["time", *names])]  # fmt: skip
        lines = (
            "\t".join(f"{value:.6f}" for value in (time, *row))
            for time, row in zip(times, values.tolist(), strict=True)
        )
        write_atomic(file, written(chain(header, lines)))
        write_atomic(table, written(_quality(motion, source, poses, names, times, values, spread)))
        files += [file, table]
    return files


def _without_gaps(estimates: np.ndarray, known: np.ndarray, period: float | None) -> np.ndarray:
    """Return estimates (F,) with lines between the known ones, or all of them if none is known, without full turns."""
    frames = np.arange(len(estimates))
    known = known if known.any() else np.ones_like(known)
    there = estimates[known] if period is None else np.unwrap(estimates[known], period=period)
    return np.interp(frames, frames[known], there)


def _quality(
    motion: BodyMotion,
    source: np.ndarray,
    poses: Poses3D,
    names: list[str],
    times: np.ndarray,
    values: np.ndarray,
    deviations: np.ndarray,
) -> Iterator[str]:
    """Yield the lines of `<name>.angles.csv`; `deviations` (F, A) are NaN where joints do not determine an angle."""
    segments = {angle.name: angle.segment for angle in ANGLES}
    weakest = {}
    for segment in {*segments.values(), "pelvis"}:
        joints = poses.skeleton.index(*defining_joints(motion.body, segment))
        weakest[segment] = [SOURCE_WORDS[kind] for kind in source[:, joints].max(1, initial=0).tolist()]
    yield ",".join(["time", *(f"{name}{what}" for name in names for what in ("", "_sd", "_source"))])
    columns = [weakest[segments.get(name, "pelvis")] for name in names]
    for frame, (time, row) in enumerate(zip(times, np.stack([values, deviations], -1).tolist(), strict=True)):
        cells = (
            text
            for (value, sd), words in zip(row, columns, strict=True)
            for text in (("", "", "absent") if sd != sd else (f"{value:.6f}", f"{sd:.4f}", words[frame]))
        )
        yield ",".join([f"{time:.6f}", *cells])
