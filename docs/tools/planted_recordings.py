"""Recordings into which faults are planted, and rows of results that are stored during a run.

The recordings are Shelf, Pose2Sim's trial, and generated rigs of five kinds with four detectors. Generated clips and
finished rows are in `runs/planted`. A run that was stopped continues from them. For another commit, first run
`rm -r runs/planted`.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import provenance

import dmae
import synth
from dmae.calibration.bundle_adjustment import CENTRE, FOCAL, K1, ROTATION, Calibration, Q
from dmae.calibration.faults import Fault
from dmae.data.clip import Clip, Detections2D
from dmae.data.json_values import json_text
from dmae.formats.reading import Clips, DataConfig
from dmae.progress import progress

ROOT = Path(__file__).parents[2]
KEPT = ROOT / "runs/planted"
POSE2SIM = "pose2sim/S00_P00_SingleParticipant/S00_P00_T01_BalancingTrial"
SHELF, TRIAL = 0, 1
"""Numbers of the real recordings; generated ones follow."""
RIGS = [*(synth.RigConfig(ring=synth.RingConfig(views=views)) for views in (4, 6)), "studio5", "random", "shelf"]
DETECTORS = ["shelf_openpose", "hrnet_like", "posefix", "clean"]
MINUTES = 100
"""Generated recordings from this number on last a minute and show three people; the others last 12 s."""


@lru_cache(2)
def sound_clip(number: int) -> Clip:
    """Return a recording by its number."""
    data = Path(os.environ["DMAE_DATA"])
    if number == SHELF:
        return Clips(DataConfig(name="shelf", path=str(data / "shelf")))[0]
    if number == TRIAL:
        return Clips(DataConfig(name="pose2sim", path=str(data / POSE2SIM)))[0]
    kept = KEPT / "clips" / str(number)
    if not (kept / "clip.json").exists():
        seconds, persons = (60, [3, 3]) if number >= MINUTES else (12, [2, 3])
        options = {"rig": RIGS[number % len(RIGS)], "detector": detector(number)}
        clips = synth.generate(clips=1, seconds=seconds, persons=persons, seed=900 + number, **options)
        dmae.save(next(clips), kept)
    return dmae.load(kept)


def view_count(number: int) -> int:
    """Return the number of cameras of a recording. For generated clips, no arrays are read."""
    if number in (SHELF, TRIAL):
        return len(sound_clip(number).rig)
    kept = KEPT / "clips" / str(number) / "clip.json"
    if not kept.exists():
        sound_clip(number)
    return len(json.loads(kept.read_text())["cameras"])


def detector(number: int) -> str:
    """Return the detector preset of a generated recording."""
    return DETECTORS[number % len(DETECTORS)]


def recording_name(number: int) -> str:
    """Return the name of a recording in the tables."""
    return ["Shelf", "Pose2Sim", "generated"][min(number, 2)]


def planted(clip: Clip, view: int, fault: Fault, size: float, rng: np.random.Generator) -> Clip:
    """Return a clip with a fault of one camera, in a random direction."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    if fault == Fault.delay:
        return late(clip, view, int(size))
    step = np.zeros((len(clip.rig), Q))
    if fault in (Fault.moved, Fault.displaced):
        step[view, CENTRE] = direction * size
    if fault == Fault.displaced:
        direction = rng.normal(size=3)
        step[view, ROTATION] = np.radians(20 * size) * direction / np.linalg.norm(direction)
    if fault == Fault.turned:
        step[view, ROTATION] = direction * np.radians(size)
    step[view, FOCAL] = np.log1p(size) if fault == Fault.focal_length else 0
    step[view, K1] = size if fault == Fault.lens else 0
    return replace(clip, rig=Calibration.of(clip.rig).changed(step).rig, true_rig=clip.rig)


def late(clip: Clip, view: int, frames: int) -> Clip:
    """Return a clip in which one camera shows, at each frame, the image that is `frames` frames later."""
    found, early = clip.detections, clip.select(frames=slice(0, len(clip) - frames))
    xy, score = early.detections.xy.copy(), early.detections.score.copy()
    xy[:, view], score[:, view] = found.xy[frames:, view], found.score[frames:, view]
    return replace(early, detections=Detections2D(found.skeleton, xy, score), detection_labels=None)


def kept_rows(name: str, cases: Iterable[tuple], measured: Callable[..., list], minutes: float = np.inf) -> list[list]:
    """Return a row `[*case, *measured(*case)]` for each case. Rows in `runs/planted/<name>.jsonl` are reused.

    After `minutes` minutes the remaining cases are left out. Cases are measured in a fixed random order, so that the
    measured ones are a fair sample.
    """
    end = time.monotonic() + 60 * minutes
    file = KEPT / f"{name}.jsonl"
    file.parent.mkdir(parents=True, exist_ok=True)
    lines = file.read_text().splitlines() if file.exists() else []
    cases = list(cases)
    rows = {tuple(case): row for case, row in map(json.loads, lines)}
    wanted = [case for case in cases if case not in rows]
    for index in progress(np.random.default_rng(0).permutation(len(wanted)), name, len(wanted)):
        if time.monotonic() > end:
            break
        case = wanted[index]
        rows[case] = [*case, *measured(*case)]
        with file.open("a") as kept:
            kept.write(json.dumps([case, rows[case]]) + "\n")
        print(*rows[case], flush=True)
    return [rows[case] for case in cases if case in rows]


def write_tables(name: str, tables: dict[str, tuple[list[str], list[list[str]]]]) -> None:
    """Write `docs/results/<name>.json`: tables of columns and rows, with the command and versions that made them."""
    command = " ".join(["python", f"docs/tools/{Path(sys.argv[0]).name}", *sys.argv[1:]])
    content = {
        "measured": provenance.measured("mujoco"),
        "tables": {
            key: {"command": command, "columns": columns, "rows": rows} for key, (columns, rows) in tables.items()
        },
    }
    (ROOT / "docs/results" / f"{name}.json").write_text(json_text(content) + "\n")


def options(**defaults: int) -> dict[str, int]:
    """Return the numbers given on the command line as name=number; exits where one is unknown."""
    given = dict(each.split("=") for each in sys.argv[1:])
    if not os.environ.get("DMAE_DATA") or set(given) - set(defaults):
        known = " ".join(f"{name}={value}" for name, value in defaults.items())
        sys.exit(f"set DMAE_DATA to the folder that holds shelf/ and pose2sim/; options are {known}")
    return defaults | {name: int(value) for name, value in given.items()}
