"""Displace or delay a camera, correct it with `dmae.calibrate`, and compare: the tables of `docs/results/mended.json`.

    python docs/tools/mended_cameras.py                  # Shelf, Pose2Sim, eight generated rigs: 40 minutes
    python docs/tools/mended_cameras.py minutes=20       # stop after 20 minutes; run it again to continue

A camera is displaced by 10 cm and 2 degrees, or is three frames late. Cameras of real recordings are corrected from the
first five sixths, cameras of generated recordings from 12, 25 and 50 of 60 seconds. The five sixths of Pose2Sim's trial
are 1.4 s, too short to find the displaced camera; its name is given. The reprojection errors of the
corrected camera are measured on the rest, with people that the other cameras measure. Stated errors are right if nine
in ten of the 90 % regions contain the true camera.
"""

from collections import defaultdict
from dataclasses import replace

import numpy as np
from planted_recordings import (
    MINUTES,
    SHELF,
    TRIAL,
    detector,
    kept_rows,
    late,
    options,
    planted,
    recording_name,
    sound_clip,
    view_count,
    write_tables,
)
from scipy.stats import chi2, norm

import dmae
from dmae.calibration.bundle_adjustment import CENTRE, OFFSET, ROTATION, Calibration
from dmae.calibration.config import RefineConfig
from dmae.calibration.faults import Fault
from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.evaluation.report.findings import reprojection

DISPLACED, LATE = "displaced", "late"
_FRAMES_LATE = 3
_WITHIN_CM, _WITHIN_DEG, _WITHIN_FRAMES = 1.0, 0.2, 0.2
_SECONDS = (12, 25, 50)
_REGION = 0.9


def cases(generated: int) -> list[tuple[int, str, int, int]]:
    """Return the recording's number, the fault, the camera, and the seconds used to correct it (0 for five sixths)."""
    found = []
    for number in (SHELF, TRIAL):
        found += [(number, what, view, 0) for what in (DISPLACED, LATE) for view in range(view_count(number))]
    for number in range(MINUTES, MINUTES + generated):
        view = int(np.random.default_rng(number).integers(view_count(number)))
        found += [(number, DISPLACED, view, seconds) for seconds in _SECONDS] + [(number, LATE, view, _SECONDS[1])]
    return found


def measured(number: int, what: str, view: int, seconds: int) -> list:
    """Return the error of the corrected camera: cm and degrees, or frames; whether the stated region contains the
    truth; and, for the right, the faulty and the corrected rig, median reprojection errors and, on Shelf, PCP."""
    clip = sound_clip(number)
    part = slice(0, round(seconds * clip.fps) or len(clip) * 5 // 6)
    name = clip.rig.names[view]
    if what == LATE:
        faulty = late(clip, view, _FRAMES_LATE).select(frames=part)
        found = dmae.calibrate(faulty, RefineConfig(offsets=True, extrinsics=False, cameras=[name]))
        off = float(-found.offset[view] * clip.fps - _FRAMES_LATE)
        error = clip.fps * found.covariance[view][OFFSET, OFFSET] ** 0.5
        return [off, None, bool(abs(off) <= norm.ppf((1 + _REGION) / 2) * error), [], []]
    faulty = planted(clip, view, Fault.displaced, 0.1, np.random.default_rng([number, view])).rig
    config = RefineConfig(cameras=[name]) if number == TRIAL else RefineConfig()
    found = dmae.calibrate(replace(clip.select(frames=part), rig=faulty), config)
    off = Calibration.of(clip.rig).difference(Calibration.of(found.rig))[view]
    inside = False
    if found.changes[view].refined:
        inside = bool(off[:6] @ np.linalg.solve(found.covariance[view][:6, :6], off[:6]) <= chi2.ppf(_REGION, 6))
    rigs, pcp, pixels = (clip.rig, faulty, found.rig), [], []
    if number == SHELF:
        pcp = [dmae.evaluate(clip, dmae.capture(replace(clip, rig=rig), fill="linear"))["pcp"] for rig in rigs]
    if seconds in (0, _SECONDS[-1]):
        pixels = held_back(clip.select(frames=slice(part.stop, len(clip))), view, rigs)
    return [float(100 * np.linalg.norm(off[CENTRE])), float(np.degrees(np.linalg.norm(off[ROTATION]))),
            inside, pixels, pcp]  # fmt: skip


def held_back(clip: Clip, view: int, rigs: tuple[CameraRig, ...]) -> list[float | None]:
    """Return the median distance, px, of a camera's detections from people that the other cameras measure."""
    others = [other for other in range(len(clip.rig)) if other != view]
    poses, name = dmae.capture(clip.select(views=others)), clip.rig.names[view]
    found = [reprojection(replace(clip, rig=rig, poses=poses)).measured["camera"].get(name) for rig in rigs]
    return [each and float(each.quantile(0.5)) for each in found]


def write(rows: list[list]) -> None:
    """Write the tables."""
    displaced, delayed = defaultdict(list), defaultdict(list)
    for number, what, _, seconds, *found in rows:
        real = number in (SHELF, TRIAL)
        key = (recording_name(number), "" if real else detector(number), "5/6" if real else f"{seconds} s")
        (displaced if what == DISPLACED else delayed)[key].append(found)
    table = []
    for key, found in displaced.items():
        cm, degrees = (np.array([each[k] for each in found]) for k in (0, 1))
        within = int(((cm <= _WITHIN_CM) & (degrees <= _WITHIN_DEG)).sum())
        pixels = [each[3] for each in found if each[3] and None not in each[3]]
        pcp = [each[4] for each in found if each[4]]
        table.append(
            [*key, f"{np.median(cm):.1f} ({cm.max():.1f})", f"{np.median(degrees):.2f} ({degrees.max():.2f})",
             f"{within} of {len(found)}", f"{sum(each[2] for each in found)} of {len(found)}",
             *_three(pixels, np.median), *_three(pcp, np.mean)]
        )  # fmt: skip
    shared = ["recording", "detector", "corrected from"]
    columns = [*shared, "error, cm: median (largest)", "error, degrees", "within 1 cm and 0.2 degrees",
               "truth in the 90 % region", "other frames, px: original", "displaced", "corrected",
               "PCP: original", "displaced", "corrected"]  # fmt: skip
    rows_late = []
    for key, found in delayed.items():
        off = np.abs([each[0] for each in found])
        within, inside = int((off <= _WITHIN_FRAMES).sum()), sum(each[2] for each in found)
        rows_late.append([*key, f"{np.median(off):.2f} ({off.max():.2f})",
                          f"{within} of {len(off)}", f"{inside} of {len(off)}"])  # fmt: skip
    columns_late = [*shared, "error, frames: median (largest)", "within 0.2 frames", "truth in the 90 % interval"]
    tables = {"displaced": (columns, table), "late": (columns_late, rows_late)}
    write_tables("mended", {name: each for name, each in tables.items() if each[1]})


def _three(values: list[list[float]], average) -> list[str]:
    return [f"{x:.1f}" for x in average(values, 0)] if values else ["-"] * 3


if __name__ == "__main__":
    given = options(generated=8, minutes=10_000)
    write(kept_rows("mended", cases(given["generated"]), measured, given["minutes"]))
