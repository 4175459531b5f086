"""Tilt and lift whole rigs, and estimate the floor: the table of `docs/results/floor.json`.

python docs/tools/planted_worlds.py                  # Shelf, Pose2Sim, forty generated rigs: a minute or two
python docs/tools/planted_worlds.py generated=4      # four of the generated rigs
"""

from collections import defaultdict
from dataclasses import replace
from functools import lru_cache

import numpy as np
from planted_recordings import kept_rows, options, recording_name, sound_clip, write_tables
from scipy.spatial.transform import Rotation

import dmae
from dmae.calibration.faults import Fault
from dmae.calibration.findings import floor_faults
from dmae.calibration.world import FLOOR_KEY, find_floor, place_clip
from dmae.data.clip import Poses3D

WORLDS = [(0.0, 0.0), (2.0, 0.0), (0.0, 0.05), (0.0, -0.05), (10.0, -0.59)]
"""Tilt, degrees, and height of the floor, m."""


@lru_cache(2)
def captured(number: int) -> Poses3D:
    """Return the people of a recording. In a moved world they are the same people, moved."""
    return dmae.capture(sound_clip(number))


def measured(number: int, index: int) -> list:
    """Return the error of the vertical, degrees, whether the tilt is reported, the error of the floor, m, and whether
    its height is reported. Errors are None where not determined."""
    clip, (tilt, height) = sound_clip(number), WORLDS[index]
    angle = np.random.default_rng([number, index]).uniform(0, 2 * np.pi)
    axis, world = np.array([np.cos(angle), np.sin(angle), 0]), np.eye(4)
    world[:3, :3] = Rotation.from_rotvec(np.radians(tilt) * axis).as_matrix()
    world[2, 3] = height
    moved = place_clip(replace(clip, poses=captured(number)), world)
    floor, usual = find_floor(moved.poses, clip.fps), clip.provenance.get(FLOOR_KEY, 0.0)
    faults = {finding.fault for finding in floor_faults(floor, usual, clip.rig.names)}
    off_deg = off_m = None
    if floor.up is not None:
        off_deg = float(np.degrees(np.arccos(np.clip(np.dot(floor.up, world[:3, 2]), -1, 1))))
    if floor.place is not None:
        off_m = float((np.linalg.inv(world) @ (*floor.place, 1))[2] - usual)
    return [off_deg, Fault.tilted in faults, off_m, Fault.floor in faults]


def write(rows: list[list]) -> None:
    """Write the table."""
    groups = defaultdict(list)
    for number, index, *found in rows:
        groups[recording_name(number), index].append(found)
    table = []
    for (recording, index), found in groups.items():
        tilt, height = WORLDS[index]
        degrees = [each[0] for each in found if each[0] is not None]
        metres = [abs(each[2]) for each in found if each[2] is not None]
        table.append(
            [recording, f"{tilt:g} degrees, {100 * height:+.0f} cm", str(len(found)), str(len(degrees)),
             str(sum(each[1] for each in found)), f"{max(degrees):.1f}" if degrees else "-", str(len(metres)),
             str(sum(each[3] for each in found)), f"{100 * max(metres):.1f}" if metres else "-"]
        )  # fmt: skip
    columns = ["recording", "planted", "rigs", "tilt determined", "tilt named", "most degrees off",
               "height determined", "height named", "most cm off"]  # fmt: skip
    write_tables("floor", {"floor": (columns, table)})


if __name__ == "__main__":
    given = options(generated=40, minutes=10_000)
    wanted = [(number, index) for number in range(2 + given["generated"]) for index in range(len(WORLDS))]
    rows = kept_rows("worlds", wanted, measured, given["minutes"])
    write(sorted(rows, key=lambda row: (min(row[0], 2), row[1])))
