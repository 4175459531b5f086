"""Plant faults of single cameras and ask the doctor: the tables of `docs/results/doctor.json`.

    python docs/tools/planted_faults.py                  # Shelf, Pose2Sim, forty generated rigs: an hour
    python docs/tools/planted_faults.py minutes=20       # stop after 20 minutes; run it again to continue

Each camera of a real recording gets a fault of each kind; a generated rig gets two faults. The sizes and directions of
faults, and the kinds and cameras for the generated rigs, are drawn by seed.
"""

from collections import Counter

import numpy as np
from planted_recordings import (
    SHELF,
    TRIAL,
    kept_rows,
    options,
    planted,
    recording_name,
    sound_clip,
    view_count,
    write_tables,
)

from dmae.calibration.doctor import Diagnosis, diagnose
from dmae.calibration.faults import Fault
from dmae.data.cameras import CameraRig

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
SOUND = -1
"""Index for a recording without a fault."""
_LIMIT = {
    Fault.moved: "moved",
    Fault.turned: "turned",
    Fault.focal_length: "focal",
    Fault.lens: "lens",
    Fault.delay: "late",
}
COLUMNS = ["named right", "camera named, kind open", "not determined", "missed", "wrong"]
_MAX_OFFSET = 20
_USUAL_K1 = 0.05
"""Distortion that every calibration is expected to miss."""


def verdict(diagnosis: Diagnosis, sound: CameraRig, name: str, fault: Fault, size: float) -> str:
    """Return the column of a diagnosis, given the camera without the fault."""
    right = {fault}
    # For a camera without distortion, the planted fault is a lens that the detections do not have.
    if fault == Fault.lens and abs(sound.dist).max() < _USUAL_K1:
        right.add(Fault.undistorted)
    for finding in diagnosis.findings:
        if finding.cameras != (name,) or not right & {finding.fault, *finding.alternatives}:
            return "wrong"
    if diagnosis.findings:
        return "camera named, kind open" if diagnosis.findings[0].alternatives else "named right"
    limits = next((fit.limits for fit in diagnosis.cameras if fit.camera == name), None)
    limit = limits and limits[_LIMIT[fault]]
    said = any(text.startswith("one of cameras") and f" {name}" in text for text in diagnosis.unknown)
    return "not determined" if said or limit is None or abs(size) < limit else "missed"


def cases(generated: int) -> list[tuple[int, int, int]]:
    """Return tuples of the recording's number, the index of the fault, and the camera."""
    kinds = [[k for k, case in enumerate(FAULTS) if case[0] == fault] for fault in _LIMIT]
    found = []
    for number in range(2 + generated):
        rng, views = np.random.default_rng([number, 23]), view_count(number)
        found.append((number, SOUND, 0))
        if number in (SHELF, TRIAL):
            found += [(number, int(rng.choice(kind)), view) for view in range(views) for kind in kinds]
        else:
            two = rng.choice(len(kinds), 2, replace=False)
            found += [(number, int(rng.choice(kinds[k])), int(rng.integers(views))) for k in two]
    return found


def measured(number: int, index: int, view: int) -> list[str]:
    """Return the verdict, and the doctor's diagnosis in words."""
    clip = sound_clip(number)
    if index == SOUND:
        found = diagnose(clip, max_offset=_MAX_OFFSET)
        return ["finding" if found.findings else "none", _said(found)]
    fault, size, _ = FAULTS[index]
    faulty = planted(clip, view, fault, size, np.random.default_rng([number, index, view]))
    found = diagnose(faulty, max_offset=_MAX_OFFSET)
    return [verdict(found, clip.rig[[view]], clip.rig.names[view], fault, size), _said(found)]


def _said(diagnosis: Diagnosis) -> str:
    return "; ".join(f"{each.fault} {','.join(each.cameras)}: {each.evidence}" for each in diagnosis.findings)


def write(rows: list[list]) -> None:
    """Write the tables."""
    counts, alarms = {}, {}  # by recording and fault; by recording
    for number, index, _, found, _ in rows:
        if index == SOUND:
            alarms.setdefault(recording_name(number), Counter())[found] += 1
        else:
            counts.setdefault((recording_name(number), FAULTS[index][2]), Counter())[found] += 1
    words = [fault[2] for fault in FAULTS]
    names = [recording_name(number) for number in range(3)]
    table = [
        [*key, *(str(found[column]) for column in COLUMNS)]
        for key, found in sorted(counts.items(), key=lambda item: (names.index(item[0][0]), words.index(item[0][1])))
    ]
    total = sum(counts.values(), Counter())
    table.append(["all", "", *(str(total[column]) for column in COLUMNS)])
    sound = [[recording, str(sum(found.values())), str(found["finding"])] for recording, found in alarms.items()]
    tables = {
        "faults": (["recording", "fault", *COLUMNS], table),
        "sound": (["recording", "sound rigs", "with a finding"], sound),
    }
    write_tables("doctor", tables)


if __name__ == "__main__":
    given = options(generated=40, minutes=10_000)
    write(kept_rows("faults", cases(given["generated"]), measured, given["minutes"]))
