"""Tilt and lift whole rigs, and estimate the floor: the table of `docs/results/floor.json`.

python docs/tools/planted_worlds.py                  # Shelf, Pose2Sim, forty generated rigs: a minute or two
python docs/tools/planted_worlds.py generated=4      # four of the generated rigs
"""

import sys
from collections import defaultdict
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from planted_recordings import SHELF, kept_rows, options, recording_name, sound_clip, write_tables
from scipy.spatial.transform import Rotation

import dmae
from dmae.calibration.doctor import tilt_fault
from dmae.calibration.world import find_floor, place_clip
from dmae.data.clip import Poses3D

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.support.settled_people import KINDS

SEEDS = 10
WORLDS = [(0.0, 0.0), (2.0, 0.0), (0.0, 0.05), (0.0, -0.05), (10.0, -0.59)]
"""Tilt, degrees, and height of the floor, m."""


@lru_cache(2)
def captured(number: int) -> Poses3D:
    """Return the people of a recording. In a moved world they are the same people, moved."""
    return dmae.capture(sound_clip(number))


def measured(number: int, index: int) -> list:
    """Return the error of the vertical, degrees, whether the tilt is reported, and the error of the floor, m. Errors
    are None where not determined."""
    clip, (tilt, height) = sound_clip(number), WORLDS[index]
    angle = np.random.default_rng([number, index]).uniform(0, 2 * np.pi)
    axis, world = np.array([np.cos(angle), np.sin(angle), 0]), np.eye(4)
    world[:3, :3] = Rotation.from_rotvec(np.radians(tilt) * axis).as_matrix()
    world[2, 3] = height
    moved = place_clip(replace(clip, poses=captured(number)), world)
    floor, usual = find_floor(moved.poses, clip.fps), -0.08 if number == SHELF else 0.0
    off_deg = off_m = None
    if floor.up is not None:
        off_deg = float(np.degrees(np.arccos(np.clip(np.dot(floor.up, world[:3, 2]), -1, 1))))
    if floor.place is not None:
        off_m = float((np.linalg.inv(world) @ (*floor.place, 1))[2] - usual)
    return [off_deg, bool(tilt_fault(floor, clip.rig.names)), off_m]


def settled() -> tuple[list[str], list[list[str]]]:
    """Return a table of people who sit, stand, dance and step in worlds tilted by up to three degrees."""
    table = []
    for name, people in KINDS.items():
        determined, held, off = 0, 0, []
        for seed in range(SEEDS):
            tilt, axis = np.random.default_rng(seed).uniform((0, 0), (3, 2 * np.pi))
            R = Rotation.from_rotvec(np.radians(tilt) * np.array([np.cos(axis), np.sin(axis), 0])).as_matrix()
            poses = people(np.random.default_rng([seed, 1]))
            floor = find_floor(Poses3D(poses.skeleton, poses.xyz @ R.T), 25.0)
            if floor.up is not None:
                low, high = floor.tilt_interval_deg
                determined, held = determined + 1, held + (low <= tilt <= high)
                off.append(np.degrees(np.arccos(np.clip(np.dot(floor.up, R[:, 2]), -1, 1))))
        table.append([name, str(SEEDS), str(determined), str(held), f"{max(off):.1f}" if off else "-"])
    return ["people", "recordings", "tilt determined", "interval holds", "most degrees off"], table


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
             f"{100 * max(metres):.1f}" if metres else "-"]
        )  # fmt: skip
    columns = ["recording", "planted", "rigs", "tilt determined", "tilt named", "most degrees off",
               "height determined", "most cm off"]  # fmt: skip
    write_tables("floor", {"floor": (columns, table), "people": settled()})


if __name__ == "__main__":
    given = options(generated=40, minutes=10_000)
    wanted = [(number, index) for number in range(2 + given["generated"]) for index in range(len(WORLDS))]
    rows = kept_rows("worlds", wanted, measured, given["minutes"])
    write(sorted(rows, key=lambda row: (min(row[0], 2), row[1])))
