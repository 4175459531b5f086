"""Plant faults of single cameras, ask the doctor, and mend them: the tables of `docs/results/doctor.json`.

    python docs/tools/planted_faults.py                          # Shelf, Pose2Sim, forty generated rigs: hours
    python docs/tools/planted_faults.py generated=4 cameras=2    # two cameras of a recording, four rigs

Faults are drawn by seed: directions at random, of the stated size. A generated rig gets one fault of each kind, in a
camera drawn for it, at one of its sizes. Where the true cameras are known, mending is compared with them.
"""

import os
import platform
import subprocess
import sys
from collections import Counter, defaultdict
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from datetime import date
from functools import lru_cache
from importlib import metadata
from pathlib import Path

import numpy as np

import dmae
import synth
from dmae.calibration.adjustment.parameters import CENTRE, FOCAL, K1, ROTATION, Calibration, Q
from dmae.calibration.doctor import Diagnosis, diagnose
from dmae.calibration.faults import Fault
from dmae.data.clip import Clip, Detections2D
from dmae.data.json_text import json_text
from dmae.formats.reading import DataConfig, load
from dmae.progress import progress

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docs/results/doctor.json"
POSE2SIM = "pose2sim/S00_P00_SingleParticipant/S00_P00_T01_BalancingTrial"
FAULTS = [
    (Fault.moved, 0.30, "moved 30 cm"),
    (Fault.moved, 0.03, "moved 3 cm"),
    (Fault.turned, 2, "turned 2 degrees"),
    (Fault.turned, 0.5, "turned 0.5 degrees"),
    (Fault.focal_length, 0.05, "focal length +5 %"),
    (Fault.focal_length, 0.02, "focal length +2 %"),
    (Fault.lens, -0.2, "k1 = -0.2"),
    (Fault.delay, 12, "12 frames late"),
    (Fault.delay, 3, "3 frames late"),
    (Fault.delay, 1, "1 frame late"),
]
_LIMIT = {
    Fault.moved: "moved",
    Fault.turned: "turned",
    Fault.focal_length: "focal",
    Fault.lens: "lens",
    Fault.delay: "late",
}
COLUMNS = ["recording", "fault", "named right", "camera named, kind open", "not determined", "missed", "wrong"]
RIGS = ["rig=ring rig.ring.views=4", "rig=ring rig.ring.views=6", "rig=studio5", "rig=random", "rig=shelf"]
DETECTORS = ["shelf_openpose", "hrnet_like", "posefix", "clean"]
_SECONDS = 12


def planted(clip: Clip, view: int, fault: Fault, size: float, rng: np.random.Generator) -> Clip:
    """Return a clip with a fault of one camera."""
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    if fault == Fault.delay:
        count = len(clip) - int(size)
        found, early = clip.detections, clip.select(frames=slice(0, count))
        xy, score = early.detections.xy.copy(), early.detections.score.copy()
        xy[:, view], score[:, view] = found.xy[int(size) :, view], found.score[int(size) :, view]
        return replace(early, detections=Detections2D(found.skeleton, xy, score), detection_labels=None)
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


def verdict(diagnosis: Diagnosis, name: str, fault: Fault, size: float) -> str:
    """Return the column of a diagnosis."""
    for finding in diagnosis.findings:
        if finding.cameras != (name,) or (finding.fault != fault and fault not in finding.alternatives):
            return "wrong"
    if diagnosis.findings:
        return "camera named, kind open" if diagnosis.findings[0].alternatives else "named right"
    limits = next((fit.limits for fit in diagnosis.cameras if fit.camera == name), None)
    limit = limits and limits[_LIMIT[fault]]
    said = any(text.startswith("one of cameras") and f" {name}" in text for text in diagnosis.unknown)
    return "not determined" if said or limit is None or abs(size) < limit else "missed"


@lru_cache(2)
def sound_clip(number: int) -> Clip:
    """Return a recording: Shelf, Pose2Sim, then generated ones."""
    data = Path(os.environ["DMAE_DATA"])
    if number == 0:
        return load(DataConfig(name="shelf", path=str(data / "shelf")))[0]
    if number == 1:
        return load(DataConfig(name="pose2sim", path=str(data / POSE2SIM)))[0]
    rig, detector = RIGS[number % len(RIGS)], DETECTORS[number % len(DETECTORS)]
    options = f"{rig} detector={detector} scene.seconds={_SECONDS} scene.persons=[2,3]".split()
    return next(iter(synth.generate(*options, clips=1, seed=900 + number)))


def recording_name(number: int) -> str:
    """Return what a recording is called in the tables."""
    return ["Shelf", "Pose2Sim", "generated"][min(number, 2)]


def cases_of(number: int, cameras: int) -> list[tuple[int, int | None]]:
    """Return what is done with a recording: indices into FAULTS and the rank of a camera; None mends one."""
    if number < 2:
        return [*((index, rank) for rank in range(cameras) for index in range(len(FAULTS))), (-1, None)]
    rng = np.random.default_rng(number)
    kinds = [[k for k, case in enumerate(FAULTS) if case[0] == fault] for fault in dict.fromkeys(f for f, *_ in FAULTS)]
    return [(-1, None), *((int(rng.choice(kind)), int(rng.integers(100))) for kind in kinds)]


def measured(number: int, index: int, rank: int | None) -> str | tuple[bool, tuple[float, ...]]:
    """Return the verdict on a fault; without one whether there is a false alarm, and what mending gives."""
    clip, rng = sound_clip(number), np.random.default_rng([number, index + 1, rank or 0])
    if rank is None:
        return bool(diagnose(clip, max_offset=20).findings), mend(clip, rng)
    view = int(np.random.default_rng(number).permutation(len(clip.rig))[rank % len(clip.rig)])
    fault, size, words = FAULTS[index]
    faulty = planted(clip, view, fault, size, rng)
    found = verdict(diagnose(faulty, max_offset=20), clip.rig.names[view], fault, size)
    print(f"{recording_name(number)} {number}: camera {clip.rig.names[view]} {words}: {found}", flush=True)
    return found


def measure(generated: int, cameras: int, workers: int) -> None:
    """Plant, diagnose, mend, and write the file anew after each."""
    counts, alarms, mended = defaultdict(Counter), defaultdict(Counter), []
    with ProcessPoolExecutor(workers) as pool:
        jobs = {}
        for number in range(2 + generated):
            for index, rank in cases_of(number, cameras):
                jobs[pool.submit(measured, number, index, rank)] = (recording_name(number), index)
        for job in progress(as_completed(jobs), "faults", len(jobs)):
            recording, index = jobs[job]
            if index >= 0:
                counts[recording, FAULTS[index][2]][job.result()] += 1
            else:
                alarm, found = job.result()
                alarms[recording]["false alarms" if alarm else "sound"] += 1
                mended.append((recording, *found))
            write(counts, alarms, mended, generated, cameras)


def mend(clip: Clip, rng: np.random.Generator) -> tuple[float, ...]:
    """Displace a camera by 10 cm and 2 degrees, mend it, and return how far off it is in cm and degrees, and PCP."""
    view = int(rng.integers(len(clip.rig)))
    faulty = planted(clip, view, Fault.displaced, 0.1, rng)
    refined = dmae.calibrate(faulty).rig
    off = Calibration.of(clip.rig).difference(Calibration.of(refined))[view]
    cm, degrees = 100 * np.linalg.norm(off[CENTRE]), np.degrees(np.linalg.norm(off[ROTATION]))
    pcp = []
    if clip.truth is not None:
        rigs = (clip.rig, faulty.rig, refined)
        pcp = [dmae.evaluate(clip, dmae.capture(replace(clip, rig=rig), fill="linear"))["pcp"] for rig in rigs]
    print(f"mended: {cm:.1f} cm, {degrees:.2f} degrees off; PCP {pcp}", flush=True)
    return (cm, degrees, *pcp)


def _order(item: tuple[tuple[str, str], Counter]) -> tuple[str, int]:
    """Return where a row of the table stands."""
    (recording, words), _ = item
    return recording, [fault[2] for fault in FAULTS].index(words)


def write(counts: dict, alarms: dict, mended: list, generated: int, cameras: int) -> None:
    """Write the tables."""
    rows = [[recording, words, *(str(found[column]) for column in COLUMNS[2:])]
            for (recording, words), found in sorted(counts.items(), key=_order)]  # fmt: skip
    total = sum(counts.values(), Counter())
    rows.append(["all", "", *(str(total[column]) for column in COLUMNS[2:])])
    sound = [[recording, str(sum(found.values())), str(found["false alarms"])] for recording, found in alarms.items()]
    rows_mended = []
    for recording in dict.fromkeys(each[0] for each in mended):
        found = [each[1:] for each in mended if each[0] == recording]
        cm, degrees = (np.array([each[k] for each in found]) for k in (0, 1))
        within = f"{np.sum((cm <= 1) & (degrees <= 0.2))} of {len(found)}"
        pcp = [each[2:] for each in found if len(each) > 2]
        means = [f"{mean:.1f}" for mean in np.mean(pcp, 0)] if pcp else ["-"] * 3
        rows_mended.append([recording, f"{np.median(cm):.1f} ({cm.max():.1f})",
                            f"{np.median(degrees):.2f} ({degrees.max():.2f})", within, *means])  # fmt: skip
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True).stdout
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("dmae-synth", "numpy", "mujoco"))
    command = f"python docs/tools/planted_faults.py generated={generated} cameras={cameras}"
    mended_columns = ["recording", "off by cm: median (most)", "degrees: median (most)",
                      "within 1 cm and 0.2 degrees", "PCP sound", "PCP displaced", "PCP mended"]  # fmt: skip
    tables = {
        "faults": {"columns": COLUMNS, "rows": rows},
        "sound": {"columns": ["recording", "sound rigs", "with a finding"], "rows": sound},
        "mended": {"columns": mended_columns, "rows": rows_mended},
    }
    content = {
        "measured": f"{date.today()}, commit {commit.strip()}, python {platform.python_version()}, {versions}",
        "tables": {name: {"command": command, **table} for name, table in tables.items() if table["rows"]},
    }
    FILE.write_text(json_text(content) + "\n")


if __name__ == "__main__":
    given = dict(each.split("=") for each in sys.argv[1:])
    if not os.environ.get("DMAE_DATA") or set(given) - {"generated", "cameras", "workers"}:
        sys.exit(
            "set DMAE_DATA to the folder that holds shelf/ and pose2sim/; options are generated=40 cameras=9 workers=2"
        )
    measure(int(given.get("generated", 40)), int(given.get("cameras", 9)), int(given.get("workers", 2)))
