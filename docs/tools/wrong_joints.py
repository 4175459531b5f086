"""Classify the joints that make limbs wrong, on Shelf and where simulated people touch or sit at a table.

    python docs/tools/wrong_joints.py            # all, into docs/results/wrong_joints.json: 10 minutes
    python docs/tools/wrong_joints.py shelf      # one of them

A limb is wrong as strict PCP says, after completion as `dmae complete` runs by default. Of each wrong limb the end with
the larger error is classified, once if it ends two wrong limbs. The first class that fits counts, in the order of
`CLASSES`.
"""

import json
import os
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
from provenance import provenance

import dmae
import synth
from dmae.data.conversion import convert
from dmae.data.json_values import json_text
from dmae.data.skeleton import SHELF14
from dmae.evaluation.config import EvaluateConfig
from dmae.evaluation.evaluate import filled_trials, load_methods
from dmae.evaluation.scores import measured_by_all
from dmae.formats.reading import Clips, DataConfig
from dmae.metrics.comparison import match, take_matched
from dmae.metrics.pcp import correct_limbs, limb_ends, limb_names
from dmae.reconstruction.config import CaptureConfig
from synth.rigs.config import RigConfig, RingConfig

RESULT = Path(__file__).parents[1] / "results/wrong_joints.json"
CLASSES = {
    "person": "the person is not found",
    "annotation": "all cameras measure it where it is, 10 cm or more from the annotation",
    "sides": "exchanged with the other side",
    "other": "at a joint of another person",
    "completed": "measured by no two cameras, completed wrongly",
    "two": "measured by two cameras, elsewhere",
    "more": "measured by three cameras or more, elsewhere",
}
_AT = 0.15
"""m; a joint that is this near another one, and at most half as far from it as from its own place, is at the other."""
_AGREES, _OFF = 0.08, 0.1
"""m; a joint that all cameras contradict: its distance from their place, and of their place from the annotation."""
_GRID_PX = 5.7
"""Grid of detections in images of low resolution, px."""
_SCENES = ("hug", "fight", "huddle", "meal")


def shelf(data: Path) -> Iterator[dmae.Clip]:
    yield from Clips(DataConfig(name="shelf", path=str(data / "shelf")))


def scene(name: str) -> Iterator[dmae.Clip]:
    """Yield clips of people in a scene, in five cameras; at a meal with detections on a grid."""
    rig = RigConfig(ring=RingConfig(views=5))
    kind = "table" if name == "meal" else name
    for clip in synth.generate(clips=2, seed=53, seconds=3, interaction=kind, rig=rig):
        if name == "meal":
            xy = np.round(clip.detections.xy / _GRID_PX) * _GRID_PX
            clip = replace(clip, detections=replace(clip.detections, xy=xy.astype(np.float32)))
        yield clip


def classified(clips: Iterable[dmae.Clip], cameras: int) -> dict:
    """Return the number of limbs and of wrong ones, and of wrong joints by class, and by class and joint."""
    config = EvaluateConfig(views=[cameras])
    limbs = wrong_limbs = 0
    counts, joints = Counter(), Counter()
    methods = load_methods(["dmae_denoise"])
    for trial, filled in chain.from_iterable(filled_trials([clip], config, methods) for clip in clips):
        (poses,), truth = filled.values(), convert(trial.truth, SHELF14).xyz.astype(np.float64)
        actors = list(range(truth.shape[1])) if trial.actors is None else list(trial.actors)
        matches = match(poses.xyz, truth)
        mine = take_matched(poses.xyz, matches)
        correct, known = correct_limbs(mine, truth, SHELF14)
        counted = np.zeros_like(known)
        counted[:, actors] = known[:, actors]
        limbs, wrong_limbs = limbs + int(counted.sum()), wrong_limbs + int((counted & ~correct).sum())
        best = truth
        if trial.actors is not None:
            whole = convert(measured_by_all(trial.clip, CaptureConfig()), SHELF14).xyz
            best = take_matched(whole, match(whole, truth))
        views = take_matched(convert(trial.given, SHELF14).views, matches, 0)
        wrong = _wrong_ends(mine, truth, counted & ~correct)
        for frame, person, joint in np.argwhere(wrong):
            kind = _class(mine, truth, best, views, frame, person, joint)
            counts[kind] += 1
            joints[f"{kind}: {SHELF14.joints[joint].removeprefix('l_').removeprefix('r_')}"] += 1
    classes = {text: counts[kind] for kind, text in CLASSES.items()}
    return {"limbs": limbs, "wrong limbs": wrong_limbs, "wrong joints": sum(counts.values())} | classes | {
        "by_joint": dict(joints.most_common())
    }  # fmt: skip


def _wrong_ends(mine: np.ndarray, truth: np.ndarray, wrong: np.ndarray) -> np.ndarray:
    """Return (F, T, J) True for the end of each wrong limb (F, T, L) that is farther from its place, or absent."""
    off = np.linalg.norm(limb_ends(mine, SHELF14) - limb_ends(truth, SHELF14), axis=-1)
    end = np.nan_to_num(off, nan=np.inf).argmax(-1)
    index = {name: number for number, name in enumerate(SHELF14.joints)}
    found = np.zeros(truth.shape[:3], bool)
    for frame, person, limb in np.argwhere(wrong):
        name = limb_names(SHELF14)[limb].split("-")[end[frame, person, limb]]
        for joint in ("l_hip", "r_hip") if name == "mid_hip" else (name,):
            found[frame, person, index[joint]] = True
    return found


def _class(mine, truth, best, views, frame: int, person: int, joint: int) -> str:
    place = mine[frame, person, joint]
    if np.isnan(mine[frame, person]).all():
        return "person"
    measured, annotated = best[frame, person, joint], truth[frame, person, joint]
    own = np.linalg.norm(place - annotated)
    if np.linalg.norm(measured - annotated) >= _OFF and np.linalg.norm(place - measured) <= _AGREES:
        return "annotation"
    reach = min(_AT, own / 2)
    if np.linalg.norm(place - truth[frame, person, SHELF14.mirror[joint]]) <= reach:
        return "sides"
    others = np.delete(best[frame], person, axis=0)
    if (np.linalg.norm(others - place, axis=-1) <= reach).any():
        return "other"
    count = views[frame, person, joint]
    return "completed" if count < 2 else "two" if count == 2 else "more"


def main(parts: list[str]) -> None:
    if "DMAE_DATA" not in os.environ:
        sys.exit("set DMAE_DATA to the folder that holds shelf/")
    known = json.loads(RESULT.read_text())["recordings"] if RESULT.is_file() else {}
    for part in parts or ["shelf", *_SCENES]:
        clips = shelf(Path(os.environ["DMAE_DATA"])) if part == "shelf" else scene(part)
        known[part] = classified(clips, 3)
        print(part, known[part], flush=True)
        made_by = {"command": "python docs/tools/wrong_joints.py", **provenance("torch", "mujoco")}
        kept = {key: known[key] for key in ("shelf", *_SCENES) if key in known}
        RESULT.write_text(json_text(made_by | {"recordings": kept}) + "\n")


if __name__ == "__main__":
    main(sys.argv[1:])
