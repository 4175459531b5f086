"""Tilt and lift whole rigs, and estimate the floor: the tables of `docs/results/floor.json`.

python docs/tools/planted_worlds.py                  # Shelf, Pose2Sim, forty generated rigs: two or three minutes
python docs/tools/planted_worlds.py generated=4      # four of the generated rigs

A third table has what the doctor says of recordings that are written in other formats and read again.
"""

import sys
import tempfile
from collections import defaultdict
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
from planted_recordings import SHELF, kept_rows, options, recording_name, sound_clip, write_tables
from scipy.spatial.transform import Rotation

import dmae
from dmae.calibration.doctor import diagnose, tilt_fault
from dmae.calibration.world import find_floor, place_clip
from dmae.data.clip import Poses3D
from dmae.formats.config import DataConfig
from dmae.formats.reading import Clips
from dmae.formats.registry import recording_writer
from dmae.formats.writing import write_recording

sys.path.insert(0, str(Path(__file__).parents[2]))
from tests.support.settled_people import KINDS

SEEDS = 10
REWRITTEN = 6
"""Number of generated recordings that are written in each format."""
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


def rewritten() -> tuple[list[str], list[list[str]]]:
    """Return a table of what the doctor says of recordings that are written in each format and read again, beside what
    it says of them as they are."""
    numbers = range(2 + REWRITTEN)
    found = {number: diagnose(sound_clip(number), max_offset=10) for number in numbers}
    table = []
    for format in recording_writer:
        rows = defaultdict(list)
        for number in numbers:
            clip, before = sound_clip(number), found[number]
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / format
                try:
                    write_recording(clip, path, format)
                except ValueError:  # The format cannot hold the lens of a camera
                    continue
                again = Clips(DataConfig(format, str(path), fps=None if format == "clip" else clip.fps))[0]
                after = diagnose(again, max_offset=10)
            same = [each.fault for each in before.findings] == [each.fault for each in after.findings]
            floors = [(np.nan, np.nan) if each.floor is None else (each.floor.tilt_deg, each.floor.height_m)
                      for each in (before, after)]  # fmt: skip
            rows[recording_name(number)].append((same, *np.array(floors, float).T))
        for recording, each in rows.items():
            same, *pairs = (np.array(part) for part in zip(*each, strict=True))
            cells = []
            for pair, scale in zip(pairs, (1, 100), strict=True):  # (recordings, 2): as they are, and read again
                known = np.isfinite(pair)
                off = scale * np.abs(pair[:, 0] - pair[:, 1])[known.all(1)]
                cells += [f"{known[:, 0].sum()} / {known[:, 1].sum()}", f"{off.max():.2f}" if len(off) else "-"]
            table.append([recording, format, str(len(same)), str(same.sum()), *cells])
    columns = ["recording", "written as", "recordings", "same findings", "tilt determined, before / after",
               "most degrees apart", "height determined, before / after", "most cm apart"]  # fmt: skip
    return columns, sorted(table, key=lambda row: ["Shelf", "Pose2Sim", "generated"].index(row[0]))


def write(rows: list[list]) -> None:
    """Write the tables."""
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
    write_tables("floor", {"floor": (columns, table), "people": settled(), "formats": rewritten()})


if __name__ == "__main__":
    given = options(generated=40, minutes=10_000)
    wanted = [(number, index) for number in range(2 + given["generated"]) for index in range(len(WORLDS))]
    rows = kept_rows("worlds", wanted, measured, given["minutes"])
    write(sorted(rows, key=lambda row: (min(row[0], 2), row[1])))
