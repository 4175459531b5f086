"""Measure simulated clips: `docs/results/simulation.json`.

    python docs/tools/simulation.py        # ten minutes of one core

What is hidden in clips with and without `occlusion.target`, and how well the physics follows motion, generated and
recorded, is what a clip says of itself (`Clip.provenance["manifest"]`). The twin of Shelf and crowds are captured, and
scored with linear filling.
"""

import json
import os
import sys
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from provenance import measured

import synth
from dmae.data.clip import Clip
from dmae.data.json_values import json_text
from dmae.evaluation.config import EvaluateConfig
from dmae.evaluation.evaluate import evaluate
from dmae.formats.reading import DataConfig
from dmae.progress import progress
from synth.datasets.config import OcclusionConfig

RESULTS = Path(__file__).parents[1] / "results"
CLIPS, SECONDS = 8, 3
TARGETS = ([], [0.32, 0.36], [0.36, 0.4], [0.4, 0.44])
BY_OTHERS = ([], [0.05, 0.1], [0.1, 0.15], [0.15, 0.2])
LIMBS = {
    "lower arms": ("l_elbow-l_wrist", "r_elbow-r_wrist"), "upper arms": ("l_shoulder-l_elbow", "r_shoulder-r_elbow"),
    "head": ("bottom_head-top_head",),
}  # fmt: skip
MOTIONS = {
    "procedural": None,
    "CMU, AMC": ("amc", "asf_amc"),
    "CMU, BVH": ("bvh", "bvh_cc"),
    "CMU, C3D": ("c3d", "c3d"),
}
"""Sources of motion: reader, and folder of takes in `$DMAE_DATA/cmu`."""


def clips(**options) -> tuple[list[dict], float]:
    """Return the manifests of clips of people in a studio, and seconds of processor time for each clip."""
    scene = synth.preset("scene", "studio", persons=[2, 4])
    start = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        made: Iterable[Clip] = synth.generate(
            scene=scene, seconds=SECONDS, rig="ring", clips=CLIPS, seed=1, out=Path(folder, "made"), **options
        )
        found = [clip.provenance["manifest"] for clip in made]
    return found, (time.process_time() - start) / CLIPS


def targets(wanted: tuple[list[float], ...], by_self: bool) -> list[list[str]]:
    """Return a row for each target: the share of joints hidden from a camera, and from how many cameras."""
    rows, untargeted = [], None
    for target in progress(wanted, "clips with targets", len(wanted)):
        found, seconds = clips(occlusion=OcclusionConfig(target=target, by_self=by_self))
        hidden = np.array([each["occlusion"]["hidden_in" if by_self else "hidden_in_by_others"] for each in found])
        shares = hidden @ np.arange(hidden.shape[1]) / (hidden.shape[1] - 1)
        untargeted = untargeted or seconds
        rows.append([
            str(target) if target else "nothing", f"{shares.min():.2f} to {shares.max():.2f}, mean {shares.mean():.2f}",
            ", ".join(f"{share:.0f}" for share in 100 * hidden.mean(0)), f"{seconds / untargeted:.1f} times",
        ])  # fmt: skip
    return rows


def physics() -> list[list[str]]:
    """Return a row for each source of motion: how closely bodies follow it, and how deep they enter each other."""
    rows, root = [], Path(os.environ["DMAE_DATA"]) / "cmu"
    for name, recorded in MOTIONS.items():
        motion = synth.preset("motion", recorded[0], path=str(root / recorded[1])) if recorded else "procedural"
        found, _ = clips(motion=motion)
        quality = [each["quality"] for each in found]
        rows.append([
            name, str(sum(each["attempts"] > 1 for each in found)),
            f"{np.median([each['tracking_error_mm'] for each in quality]):.1f}",
            f"{max(each['penetration_mm'] for each in quality):.0f}",
            f"{100 * np.mean([each['foot_slide'] for each in quality]):.2f}",
        ])  # fmt: skip
    return rows


def scored(views: list[int], clips: int, seed: int, **options) -> list[dict]:
    """Return the scores of simulated clips with linear filling, by number of cameras, from most to fewest."""
    with tempfile.TemporaryDirectory() as folder:
        list(synth.generate(clips=clips, seed=seed, out=Path(folder, "made"), **options))
        config = EvaluateConfig(DataConfig(path=f"{folder}/made"), methods=["linear"], views=views)
        return [found["mean"] for found in evaluate(config)["results"]]


def twin() -> list[list[str]]:
    """Return a row of strict PCP for Shelf and for each seed of its twin."""
    shelf = json.loads((RESULTS / "shelf.json").read_text())["scores"]["results"]
    scores = {"Shelf": [found["mean"] for found in shelf if found["method"] == "linear"]}
    for seed in progress((1, 5), "twins of Shelf", 2):
        scores[f"twin, seed {seed}"] = scored([5, 4, 3], 1, seed, scene="shelf_twin")
    rows = []
    for name, found in scores.items():
        limbs = (np.mean([found[-1]["pcp_limbs"][limb] for limb in pair]) for pair in LIMBS.values())
        rows.append([name, *(f"{each['pcp']:.1f}" for each in found), *(f"{pcp:.1f}" for pcp in limbs)])
    return rows


def crowds() -> list[list[str]]:
    """Return a row for each interaction of six people."""
    rows, scene = [], synth.preset("scene", "studio", persons=[6, 6])
    for name, kind in progress({"a huddle": "huddle", "crossing": "crossing"}.items(), "crowds", 2):
        (found,) = scored([5], 4, 3, scene=scene, rig="ring", interaction=kind)
        rows.append([name, f"{found['idf1']:.1f}", f"{found['identity_switches']:g}", f"{found['pcp']:.1f}"])
    return rows


if __name__ == "__main__":
    if not os.environ.get("DMAE_DATA"):
        sys.exit("set DMAE_DATA to the folder that holds cmu/")
    head = ["asked for", "hidden from a camera", "joints hidden from 0, 1, ... 5 cameras, %", "a clip takes"]
    tables = {
        "targets": {"columns": head, "rows": targets(TARGETS, True)},
        "targets_by_others": {"columns": [f"{head[0]} with `by_self=false`", *head[1:]],
                              "rows": targets(BY_OTHERS, False)},
        "physics": {"columns": ["motion: procedural, or of CMU", f"begun again, of {CLIPS} clips",
                                "off the motion, mm: median", "deepest overlap of two people, mm",
                                "frames in which feet slide, %"],
                    "rows": physics()},
        "twin": {"columns": ["strict PCP, linear filling, %", "5 cameras", "4", "3",
                             *(f"{limbs}, 3" for limbs in LIMBS)],
                 "rows": twin()},
        "crowds": {"columns": ["six people, five cameras, four clips", "IDF1, %", "identity switches",
                               "strict PCP, linear filling, %"],
                   "rows": crowds()},
    }  # fmt: skip
    for table in tables.values():
        table["command"] = "python docs/tools/simulation.py"
    (RESULTS / "simulation.json").write_text(json_text({"measured": measured("mujoco"), "tables": tables}))
