"""Measure joint angles: the tables of `docs/results/angles.json`, beside those of OpenSim.

    python docs/tools/angles.py                # four clips each of simulated and of recorded motion: 20 minutes
    python docs/tools/angles.py part=people clips=1 keep=runs/angles      # one part, and keep the clips

DMAE_DATA names the folder with `cmu`, `cmu_more` and `pose2sim`. OpenSim's columns need `pip install opensim pose2sim`
(the latter with `--no-deps`); without them they are left out.

- people: four cameras around two or three people, detected with errors, captured and completed. True angles come
  from the simulated bodies, with the pelvis level in upright standing. Errors by the longest gap among
  the joints of an angle, and by its cause.
- bounds: what would be left of the errors of completed joints if one more thing were known.
- trial: Pose2Sim's trial, without a truth: our angles against OpenSim's, on the same markers.
- pelvis: how people share a lean between lumbar spine and hips: the rule by which pelvis tilt is inferred, on each
  subject of CMU, with the share of the others.
"""

import json
import os
import sys
import tempfile
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
from provenance import measured
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

import dmae  # noqa: E402
import synth  # noqa: E402
from dmae.data.clip import Clip, Poses3D  # noqa: E402
from dmae.data.conversion import convert  # noqa: E402
from dmae.data.json_values import json_text  # noqa: E402
from dmae.data.skeleton import BODY25  # noqa: E402
from dmae.data.store import clip_folders, load_clip  # noqa: E402
from dmae.evaluation.benchmark.holes import AXES, holes_of_capture, longest_holes  # noqa: E402
from dmae.metrics.angles import calibration  # noqa: E402
from dmae.metrics.comparison import match, take_matched  # noqa: E402
from dmae.numerics import kinematics  # noqa: E402
from dmae.numerics.kinematics import ANGLES, ISB, body_motion, cardan, is_upright, joint_angles, leans  # noqa: E402
from dmae.numerics.paths import linear  # noqa: E402
from dmae.numerics.statistics import mean_known  # noqa: E402
from dmae.progress import progress  # noqa: E402
from synth.motion.readers.takes import find_takes, subject, subject_and_trial  # noqa: E402
from synth.motion.source import read_take  # noqa: E402
from synth.people.body import SEGMENTS, Body, landmarks, segment_origins  # noqa: E402
from synth.physics.body_state import load_state  # noqa: E402
from tests.support.opensim_ik import opensim_angles, setup_folder  # noqa: E402

FILE = ROOT / "docs/results/angles.json"
SEED, SECONDS, CAMERAS = 53, 8, 4
PARTS = {
    "hip flexion": ("hip_flexion", ("hip", "knee", "shoulder")),
    "hip adduction": ("hip_adduction", ("hip", "knee")),
    "hip rotation": ("hip_rotation", ("hip", "knee", "ankle")),
    "knee": ("knee_angle", ("hip", "knee", "ankle")),
    "ankle": ("ankle_angle", ("knee", "ankle", "big_toe", "heel")),
}
"""Angles, left and right together: their name in OpenSim, and the joints that show them."""
PEOPLE_COLUMNS = [
    "angle", "people", "joints", "by", "angles", "known, %", "mean error, °", "bias, °",
    "without each person's bias, °", "in 90 %", "ECE",
]  # fmt: skip
GAP_COLUMNS = ["joints unmeasured", "hip flexion, °", "knee, °", "ankle, °", "in 90 %", "angles"]
BOUND_COLUMNS = [
    "angle", "people", "ours, °", "true sizes of the body, °", "true size of each joint's errors, °",
    "best filter in time, °", "true joints, °", "power of the error below 1 Hz, %",
]  # fmt: skip
TRIAL_COLUMNS = [
    "angle",
    "frames",
    "mean difference, °",
    "bias, °",
    "mean difference without bias, °",
    "our deviation, °",
]
PELVIS_COLUMNS = ["subject", "seconds", "share of the others", "mean error, °", "bias, °", "in 90 %"]
_RATE = 10
"""Frames a second at which recordings are read for the pelvis."""
_ENOUGH = 10
"""Fewest upright frames that show the level of the pelvis."""


def main(part: str | None, clips: int, keep: str | None) -> None:
    data = Path(os.environ["DMAE_DATA"])
    tables: dict[str, list[list[str]]] = {}
    with nullcontext(keep) if keep else tempfile.TemporaryDirectory() as folder:
        if part in (None, "people"):
            tables |= _people(Path(folder), data, clips)
        if part in (None, "trial"):
            tables["trial"] = _trial(Path(folder), data)
        if part in (None, "pelvis"):
            tables["pelvis"] = _pelvis([data / "cmu", data / "cmu_more"])
    command = f"python docs/tools/angles.py clips={clips}"
    columns = {
        "people": PEOPLE_COLUMNS,
        "bounds": BOUND_COLUMNS,
        "gaps": GAP_COLUMNS,
        "causes": GAP_COLUMNS,
        "trial": TRIAL_COLUMNS,
        "pelvis": PELVIS_COLUMNS,
    }
    found = {
        name: {"command": command, "columns": columns[name], "rows": rows} for name, rows in tables.items() if rows
    }
    kept = json.loads(FILE.read_text())["tables"] if part and FILE.is_file() else {}
    FILE.write_text(json_text({"measured": measured("mujoco"), "tables": kept | found}) + "\n")


# People whose angles are known


def _people(folder: Path, data: Path, clips: int) -> dict[str, list[list[str]]]:
    """Return the tables `people`, `gaps` and `causes`."""
    rig = synth.RigConfig(ring=synth.RingConfig(views=CAMERAS))
    motions = {"simulated": "procedural", "recorded": synth.preset("motion", "recorded", path=str(data / "cmu"))}
    errors: dict[tuple[str, str, str], list[np.ndarray]] = {}
    holes: list[np.ndarray] = []
    ideal: dict[tuple[str, str], list[np.ndarray]] = {}
    filtered: dict[str, list[tuple[float, np.ndarray]]] = {}
    for number, (kind, motion) in enumerate(motions.items()):
        out = folder / kind
        options = {"seconds": SECONDS, "persons": [2, 3], "rig": rig, "motion": motion}
        if not out.is_dir():
            list(synth.generate(**options, clips=clips, seed=SEED + number, out=out))
        for path in progress(clip_folders(out), kind):
            clip = load_clip(path)
            truth = convert(clip.truth, BODY25)
            captured = dmae.capture(clip)
            completed = dmae.complete(captured, clip.fps)
            true = _true_angles(path, truth)
            hidden = np.stack(longest_holes(holes_of_capture(clip, captured), (each for _, each in PARTS.values())), -1)
            for joints, poses in (("true", truth), ("completed", completed)):
                matches = match(poses.xyz, truth.xyz)
                for by, found in _estimates(clip, poses, folder / "opensim" / path.name / joints).items():
                    values, spread = (take_matched(each, matches) for each in found)
                    error = (values - true + 180) % 360 - 180
                    # In frames without a match nothing is compared.
                    compared = (matches >= 0)[..., None, None] & ~np.isnan(true)
                    part = np.stack([np.where(compared, error, np.nan), spread, compared], -1)
                    errors.setdefault((kind, joints, by), []).append(part)
                    if (joints, by) == ("completed", "ours"):
                        holes.append(np.concatenate([part, hidden], -1))
            for by, values in _with_knowledge(completed, truth).items():
                ideal.setdefault((kind, by), []).append((values - true + 180) % 360 - 180)
            filtered.setdefault(kind, []).append((clip.fps, true))
    people = [_row(name, number, *key, found) for number, name in enumerate(PARTS) for key, found in errors.items()]
    flat = np.concatenate([each.reshape(-1, *each.shape[2:]) for each in holes])
    return {"people": people, "bounds": _bounds(errors, ideal, filtered)} | {
        axis: [_gap_row(label, flat, flat[..., 3 + column] == value) for value, label in labels]
        for axis, column, labels in (
            ("gaps", 0, [(-1, "none"), *enumerate(f"{each} frames" for each in AXES["frames"])]),
            ("causes", 1, [(-1, "none"), *enumerate(AXES["cause"])]),
        )
    }


def _estimates(clip: Clip, poses: Poses3D, folder: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return angles and standard deviations (F, P, 5, 2), degrees, by program; right sides first."""
    names = [angle.name for angle in ANGLES]
    columns = [[names.index(f"{name}_{side}") for side in "rl"] for name, _ in PARTS.values()]
    ours = [joint_angles(body_motion(poses, person)) for person in range(poses.xyz.shape[1])]
    found = {"ours": tuple(np.stack([each[:, columns] for each in part], 1) for part in zip(*ours, strict=True))}
    if setup_folder():
        theirs = np.stack(
            [
                np.stack([one[names[column]] for column in np.ravel(columns)], -1).reshape(-1, *np.shape(columns))
                for one in opensim_angles(replace(clip, poses=poses), folder)
            ],
            1,
        )
        found["OpenSim"] = theirs, np.full_like(theirs, np.nan)
    return found


def _true_angles(path: Path, truth: Poses3D) -> np.ndarray:
    """Return the true angles (F, P, 5, 2), degrees, of a simulated clip.

    The pelvis is level where true joints show the person upright, as for estimated angles; in clips that do not show
    it, hips have no true angles.
    """
    state = load_state(path)
    local = Rotation.from_quat(state.rotations[..., [1, 2, 3, 0]].reshape(-1, 4)).as_matrix()
    local = (ISB.T @ local @ ISB).reshape(*state.rotations.shape[:3], 3, 3)
    found = np.full((*local.shape[:2], len(PARTS), 2), np.nan)
    for person in range(local.shape[1]):
        # Turned about the vertical first, then tilted.
        tilt = Rotation.from_matrix(local[:, person, 0]).as_euler("YXZ")[:, 2]
        upright = is_upright(*leans(body_motion(truth, person)))
        level = np.full((3, 3), np.nan)
        if upright.sum() >= _ENOUGH:
            level = Rotation.from_euler("z", np.median(tilt[upright])).as_matrix()
        for number, side in enumerate("rl"):
            thigh, shin, foot = (
                local[:, person, SEGMENTS.index(f"{side}_{part}")] for part in ("thigh", "shin", "foot")
            )
            hip = np.degrees(cardan(level @ thigh)) * (1, 1 - 2 * number, 1 - 2 * number)
            bend = np.degrees(cardan(shin))
            found[:, person, :, number] = np.column_stack([hip, -bend[:, 0], np.degrees(cardan(foot)[:, 0])])
    return found


def _row(name: str, number: int, kind: str, joints: str, by: str, found: list[np.ndarray]) -> list[str]:
    parts = [each[:, person, number, side] for each in found for person in range(each.shape[1]) for side in range(2)]
    error, spread, compared = np.concatenate(parts).T
    own = np.concatenate([each[:, 0] - mean_known(each[:, 0], 0) for each in parts])
    held = calibration(error, spread)
    return [
        name, kind, joints, by, str(int(compared.sum())), f"{100 * (~np.isnan(error)).sum() / compared.sum():.0f}",
        *(f"{mean_known(each, 0):.1f}" for each in (np.abs(error), error, np.abs(own))),
        *(("", "") if np.isnan(held["ece"]) else (f"{held['held']:.0f}", f"{held['ece']:.2f}")),
    ]  # fmt: skip


def _with_knowledge(poses: Poses3D, truth: Poses3D) -> dict[str, np.ndarray]:
    """Return angles (F, P, 5, 2) of each true person from what matches it, if one more thing about it were known."""
    matches = match(poses.xyz, truth.xyz)
    xyz, source, cov = (take_matched(each, matches) for each in (poses.xyz, poses.source, poses.cov))
    sized = mean_known((xyz - truth.xyz) ** 2, (0, -1))
    known = np.broadcast_to(sized[..., None, None] * np.eye(3), cov.shape).astype(cov.dtype)
    columns = [[n for n, a in enumerate(ANGLES) if a.name.startswith(f"{name}_")] for name, _ in PARTS.values()]
    found = {"lengths": [], "sizes": []}
    for person in range(xyz.shape[1]):
        body = body_motion(truth, person).body
        found["lengths"].append(body_motion(Poses3D(BODY25, xyz, source, cov), person, body))
        found["sizes"].append(body_motion(Poses3D(BODY25, xyz, source, known), person))
    return {by: np.stack([joint_angles(each)[0][:, columns] for each in part], 1) for by, part in found.items()}


def _bounds(errors: dict, ideal: dict, truth: dict) -> list[list[str]]:
    rows = []
    for name in ("hip flexion", "knee", "ankle"):
        number = list(PARTS).index(name)
        for kind in truth:

            def legs(parts: list[np.ndarray], number: int = number) -> np.ndarray:
                """Return (legs, F)."""
                return np.concatenate([each[:, :, number].reshape(len(each), -1).T for each in parts])

            ours, on_true = (
                legs([each[..., 0] for each in errors[kind, joints, "ours"]]) for joints in ("completed", "true")
            )
            lengths, sizes = (legs(ideal[kind, by]) for by in ("lengths", "sizes"))
            fps, true = truth[kind][0][0], legs([each for _, each in truth[kind]])
            low = _low_share(ours, fps)
            path = np.nan_to_num(linear(true.T[..., None])[..., 0].T)
            cells = [ours, lengths, sizes, _filtered(path, ours), on_true]
            rows.append([name, kind, *(f"{mean_known(np.abs(each), None):.1f}" for each in cells), f"{100 * low:.0f}"])
    return rows


def _low_share(error: np.ndarray, fps: float) -> float:
    """Return the share below 1 Hz of the power of errors (n, F) around their mean over time, plus that of the mean."""
    mean = mean_known(error, 1)[:, None]
    power = (np.abs(np.fft.rfft(np.nan_to_num(error - mean))) ** 2).sum(0)
    share = power[np.fft.rfftfreq(error.shape[1], 1 / fps) < 1].sum() / power.sum()
    constant = mean_known(np.broadcast_to(mean, error.shape) ** 2, None) / mean_known(error**2, None)
    return float(constant + (1 - constant) * share)


def _filtered(true: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Return the errors (n, F) that a filter would leave that knows the spectra of angles and errors (Wiener's).

    Each leg keeps its mean. The filter is without delay, and the same for all legs. It is fitted to these very
    errors, so any other does less well.
    """
    found = true + np.nan_to_num(error)
    # Mirrored in time, so that ends meet.
    spectrum, wanted = (
        np.fft.rfft(np.concatenate([each, each[:, ::-1]], 1) - each.mean(1, keepdims=True)) for each in (found, true)
    )
    gain = (spectrum.conj() * wanted).real.sum(0) / (np.abs(spectrum) ** 2).sum(0).clip(1e-9)
    best = np.fft.irfft(spectrum * gain, 2 * found.shape[1])[:, : found.shape[1]] + found.mean(1, keepdims=True)
    return np.where(np.isnan(error), np.nan, best - true)


def _gap_row(label: str, flat: np.ndarray, inside: np.ndarray) -> list[str]:
    """Return a row; `flat` is (n, 5, 2, 5) with error, deviation, compared, class and cause, `inside` (n, 5, 2)."""
    judged = [list(PARTS).index(name) for name in ("hip flexion", "knee", "ankle")]
    error = np.where(inside, flat[..., 0], np.nan)[:, judged]
    held = calibration(error, flat[..., 1][:, judged])
    cells = [mean_known(np.abs(error[:, number]), None) for number in range(3)]
    return [
        label,
        *("" if np.isnan(cell) else f"{cell:.1f}" for cell in cells),
        "" if np.isnan(held["held"]) else f"{held['held']:.0f}",
        str(int((~np.isnan(error)).sum())),
    ]


# Pose2Sim's trial


def _trial(folder: Path, data: Path) -> list[list[str]]:
    """Return a row for each angle of the trial."""
    if not setup_folder():
        return []
    clip = dmae.read(data / "pose2sim/S00_P00_SingleParticipant/S00_P00_T01_BalancingTrial", fps=60)
    poses = dmae.complete(dmae.capture(clip, dmae.CaptureConfig(persons=1)), clip.fps)
    found = _estimates(clip, poses, folder / "opensim/trial")
    rows = []
    for number, name in enumerate(PARTS):
        ours, theirs = (found[by][0][:, 0, number] for by in ("ours", "OpenSim"))
        off = ours - theirs
        mean = mean_known(off, 0)
        rows.append([
            name, str(len(off)), f"{mean_known(np.abs(off), None):.1f}", f"{mean_known(off, None):.1f}",
            f"{mean_known(np.abs(off - mean), None):.1f}", f"{mean_known(found['ours'][1][:, 0, number], None):.1f}",
        ])  # fmt: skip
    return rows


# The pelvis of recorded people


def _pelvis(folders: list[Path]) -> list[list[str]]:
    """Return a row for each subject, and one for all."""
    people: dict[str, list[np.ndarray]] = {}
    seen = set()
    files = [file for folder in folders for kind in ("amc", "bvh") for file in find_takes(folder, kind)]
    for file in progress(files, "takes"):
        who = subject(file)
        trial = subject_and_trial(file.name.split(".")[0])
        # Takes of a folder that names no people, and other conversions of a take.
        if "bvh_mass" in file.parts or (trial[1] and trial in seen):
            continue
        seen.add(trial)
        if len(part := _tilts(file)):
            people.setdefault(who, []).append(part)
    people = {who: np.concatenate(parts) for who, parts in people.items()}

    def share(chosen: list[str]) -> float:
        """Least squares, each subject with the same weight."""
        sums = np.mean(
            [[(people[who][:, 0] * people[who][:, 1]).mean(), (people[who][:, 1] ** 2).mean()] for who in chosen], 0
        )
        return float(sums[0] / sums[1])

    rows, errors = [], {}
    for who in sorted(people, key=lambda name: (len(name), name)):
        lumbar, folded = people[who].T
        of_others = share([each for each in people if each != who])
        error = lumbar - of_others * folded
        errors[who] = np.stack([error, np.hypot(kinematics._LUMBAR_SD[0], kinematics._LUMBAR_SD[1] * folded)])
        rows.append([who, f"{len(error) / _RATE:.0f}", f"{of_others:.2f}", *_pelvis_cells(*errors[who])])
    together = np.concatenate([*errors.values()], 1)
    return [*rows, ["all", f"{together.shape[1] / _RATE:.0f}", f"{share(list(people)):.2f}", *_pelvis_cells(*together)]]


def _pelvis_cells(error: np.ndarray, spread: np.ndarray) -> list[str]:
    return [f"{np.abs(error).mean():.1f}", f"{error.mean():.1f}", f"{calibration(error, spread)['held']:.0f}"]


def _tilts(file: Path) -> np.ndarray:
    """Return (n, 2) lean of the trunk against the pelvis, and against both thighs, degrees, from upright standing."""
    motion = read_take(file)
    step = max(1, round(motion.fps / _RATE))
    turned, body = motion.rotations[::step], Body()
    root = motion.root[::step] * body.hip_height / motion.hip_height
    on, points, _ = landmarks(body, BODY25)
    xyz = segment_origins(body, root, turned)[:, on] + (turned[:, on] @ points[..., None])[..., 0]
    found = body_motion(Poses3D(BODY25, xyz[:, None]), 0)
    lean, thighs = leans(found)
    tilt = -np.degrees(Rotation.from_matrix(ISB.T @ turned[:, 0] @ ISB).as_euler("YXZ")[:, 2])
    upright = is_upright(lean, thighs)
    # Beyond these, the plane in which a person faces says little.
    steep = (np.abs(lean) > 100) | (np.abs(tilt) > 100)
    if upright.sum() < _ENOUGH:
        return np.empty((0, 2))
    thighs = thighs.mean(-1)
    lean, tilt, thighs = (each - np.median(each[upright]) for each in (lean, tilt, thighs))
    return np.stack([lean - tilt, lean + thighs], -1)[~steep]


if __name__ == "__main__":
    given = dict(argument.split("=", 1) for argument in sys.argv[1:])
    main(given.get("part"), int(given.get("clips", 4)), given.get("keep"))
