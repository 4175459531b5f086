"""Displace or delay one camera, mend it with `dmae.calibrate`, and compare: the tables of `docs/results/mended.json`.

    python docs/tools/mended_cameras.py                  # Shelf, Pose2Sim, forty generated rigs: an hour
    python docs/tools/mended_cameras.py minutes=20       # as many of them as are done by then, and so on

A camera is displaced by 10 cm and 2 degrees, or three frames late. It is mended by the first five sixths of the
recording. How well it then reprojects people is measured on the rest, with people that the other cameras measure.
"""

from collections import defaultdict
from dataclasses import replace

import numpy as np
from planted_recordings import (
    SHELF,
    TRIAL,
    detector,
    kept_rows,
    late,
    options,
    planted,
    recording_name,
    sound_clip,
    write_tables,
)

import dmae
from dmae.calibration.adjustment.parameters import CENTRE, ROTATION, Calibration
from dmae.calibration.adjustment.refinement import RefineConfig
from dmae.calibration.faults import Fault
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.evaluation.report.reprojection import reprojection

DISPLACED, LATE = "displaced", "late"
_FRAMES_LATE = 3
_WITHIN_CM, _WITHIN_DEG, _WITHIN_FRAMES = 1.0, 0.2, 0.2


def cases(generated: int) -> list[tuple[int, str, int]]:
    """Return number of the recording, what is wrong, and the camera."""
    found = []
    for number in range(2 + generated):
        views = len(sound_clip(number).rig)
        chosen = range(views) if number in (SHELF, TRIAL) else [int(np.random.default_rng(number).integers(views))]
        found += [(number, what, view) for what in (DISPLACED, LATE) for view in chosen]
    return found


def measured(number: int, what: str, view: int) -> list:
    """Return how far off the mended camera is, and medians of its reprojection errors: sound, faulty, mended."""
    clip = sound_clip(number)
    part = len(clip) * 5 // 6
    if what == LATE:
        faulty = late(clip, view, _FRAMES_LATE)
        found = dmae.calibrate(faulty, RefineConfig(offsets=True, extrinsics=False, cameras=[clip.rig.names[view]]))
        return [float(-found.offset[view] * clip.fps - _FRAMES_LATE), None, [], []]
    faulty = planted(clip, view, Fault.displaced, 0.1, np.random.default_rng([number, view])).rig
    mended = dmae.calibrate(replace(clip.select(frames=slice(0, part)), rig=faulty)).rig
    off = Calibration.of(clip.rig).difference(Calibration.of(mended))[view]
    rigs = (clip.rig, faulty, mended)
    pcp = []
    if number == SHELF:
        pcp = [dmae.evaluate(clip, dmae.capture(replace(clip, rig=rig), fill="linear"))["pcp"] for rig in rigs]
    return [float(100 * np.linalg.norm(off[CENTRE])), float(np.degrees(np.linalg.norm(off[ROTATION]))),
            held_back(clip.select(frames=slice(part, len(clip))), view, rigs), pcp]  # fmt: skip


def held_back(clip: Clip, view: int, rigs: tuple[CameraRig, ...]) -> list[float | None]:
    """Return the median distance, px, of a camera's detections from people that the other cameras measure."""
    others = [other for other in range(len(clip.rig)) if other != view]
    poses, name = dmae.capture(clip.select(views=others)), clip.rig.names[view]
    found = [reprojection(replace(clip, rig=rig, poses=poses)).measured["camera"].get(name) for rig in rigs]
    return [each and each.quantile(0.5) for each in found]


def write(rows: list[list]) -> None:
    """Write the tables."""
    displaced, delayed = defaultdict(list), defaultdict(list)
    for number, what, _, *found in rows:
        name = recording_name(number)
        group = f"{name}, {detector(number)}" if number not in (SHELF, TRIAL) else name
        (displaced if what == DISPLACED else delayed)[group].append(found)
    table = []
    for group, found in sorted(displaced.items()):
        cm, degrees = (np.array([each[k] for each in found]) for k in (0, 1))
        within = int(((cm <= _WITHIN_CM) & (degrees <= _WITHIN_DEG)).sum())
        pixels = [each[2] for each in found if None not in each[2]]
        pcp = [each[3] for each in found if each[3]]
        table.append(
            [group, f"{np.median(cm):.1f} ({cm.max():.1f})", f"{np.median(degrees):.2f} ({degrees.max():.2f})",
             f"{within} of {len(found)}", *(f"{x:.1f}" for x in (np.median(pixels, 0) if pixels else [])),
             *([f"{x:.1f}" for x in np.mean(pcp, 0)] if pcp else ["-"] * 3)]
        )  # fmt: skip
    columns = ["recording", "cm off: median (most)", "degrees off", "within 1 cm and 0.2 degrees",
               "held back px: sound", "displaced", "mended", "PCP: sound", "displaced", "mended"]  # fmt: skip
    rows_late = []
    for group, found in sorted(delayed.items()):
        off = np.abs([each[0] for each in found])
        within = f"{int((off <= _WITHIN_FRAMES).sum())} of {len(off)}"
        rows_late.append([group, f"{np.median(off):.2f} ({off.max():.2f})", within])
    columns_late = ["recording", "frames off: median (most)", "within 0.2 frames"]
    tables = {"displaced": (columns, table), "late": (columns_late, rows_late)}
    write_tables("mended", {name: each for name, each in tables.items() if each[1]})


if __name__ == "__main__":
    given = options(generated=40, minutes=10_000)
    write(kept_rows("mended", cases(given["generated"]), measured, given["minutes"]))
