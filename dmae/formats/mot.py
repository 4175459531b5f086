"""MOT, OpenSim's text format for joint angles, by our own inverse kinematics (`dmae.numerics.kinematics`).

Columns have the names of the coordinates of OpenSim's models, in degrees, `pelvis_tx`, `pelvis_ty` and `pelvis_tz` in
metres: the mid point of the hips, y up, in the axes and with the times of our TRC. `NaN` stands where the joints do not
determine an angle.

`<name>.angles.csv` states how good each angle is: `<angle>_sd`, its standard deviation, and `<angle>_source`, the
weakest source of the joints that show it, in the words of the table of provenance.
"""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Poses3D, person_name
from dmae.files.contents import write_atomic, written
from dmae.formats.animation import Y_UP, say_left_out
from dmae.formats.poses import SOURCE_WORDS, person_paths
from dmae.formats.registry import pose_writer
from dmae.numerics.kinematics import ANGLES, BodyMotion, NoBody, body_motion, defining_joints, joint_angles

_PLACES = ("pelvis_tx", "pelvis_ty", "pelvis_tz")
_PELVIS = 3  # Number of angles of the pelvis, which come before its place


@pose_writer("mot", table=True)
def write_mot(poses: Poses3D, clip: Clip, path: Path) -> list[Path]:
    """OpenSim's joint angles, a file for each person, with the standard deviation of each angle in a second file."""
    files, lacking = [], []
    names = [angle.name for angle in ANGLES]
    names[_PELVIS:_PELVIS] = _PLACES
    for person, file in enumerate(person_paths(path, poses.xyz.shape[1])):
        table = file.with_suffix(".angles.csv")
        try:
            motion = body_motion(poses, person)
        except NoBody as error:
            for stale in (file, table):
                stale.unlink(missing_ok=True)
            lacking.append(error)
            continue
        angles, spread = joint_angles(motion, Y_UP)
        place, place_sd = motion.root @ Y_UP.T, np.sqrt(np.diagonal(Y_UP @ motion.root_cov @ Y_UP.T, axis1=1, axis2=2))
        # Without any joint the body does not move, and is nowhere.
        nowhere = np.isnan(angles[:, :_PELVIS]).all(1)
        place, place_sd = (np.where(nowhere[:, None], np.nan, part) for part in (place, place_sd))
        values, deviations = (
            np.concatenate([turned[:, :_PELVIS], at, turned[:, _PELVIS:]], 1)
            for turned, at in ((angles, place), (spread, place_sd))
        )
        times = np.arange(len(values)) / clip.fps
        header = [person_name(person), "version=1", f"nRows={len(values)}", f"nColumns={1 + len(names)}",
                  "inDegrees=yes", "endheader", "\t".join(["time", *names])]  # fmt: skip
        rows = ("\t".join(map(_number, (time, *row))) for time, row in zip(times, values.tolist(), strict=True))
        write_atomic(file, written(chain(header, rows)))
        write_atomic(table, written(_quality(motion, poses.source[:, person], poses, names, times, deviations)))
        files += [file, table]
    say_left_out(lacking, poses.xyz.shape[1])
    return files


def _number(value: float) -> str:
    return "NaN" if value != value else f"{value:.6f}"


def _quality(
    motion: BodyMotion, source: np.ndarray, poses: Poses3D, names: list[str], times: np.ndarray, deviations: np.ndarray
) -> Iterator[str]:
    """Yield the lines of `<name>.angles.csv`."""
    segments = {angle.name: angle.segment for angle in ANGLES}
    weakest = {}
    for segment in {*segments.values(), "pelvis"}:
        joints = poses.skeleton.index(*defining_joints(motion.body, segment))
        weakest[segment] = [SOURCE_WORDS[kind] for kind in source[:, joints].max(1, initial=0).tolist()]
    yield ",".join(["time", *(f"{name}_{what}" for name in names for what in ("sd", "source"))])
    columns = [weakest[segments.get(name, "pelvis")] for name in names]
    for frame, (time, row) in enumerate(zip(times, deviations.tolist(), strict=True)):
        cells = (
            text
            for value, words in zip(row, columns, strict=True)
            for text in (("", "absent") if value != value else (f"{value:.4f}", words[frame]))
        )
        yield ",".join([f"{time:.6f}", *cells])
