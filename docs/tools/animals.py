"""Capture and complete simulated hands and dogs: the tables of `docs/results/animals.json`.

    python docs/tools/animals.py            # ten clips of ten seconds each: two minutes

Four cameras see each body in noise of 2 px; joints are missed in bursts of half a second, some in all cameras.
"""

import sys
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from provenance import measured

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT))

from dmae.completion.methods import find_method  # noqa: E402
from dmae.data.clip import Clip, Poses3D, Source  # noqa: E402
from dmae.data.json_values import json_text  # noqa: E402
from dmae.data.skeleton import PERSON_M  # noqa: E402
from dmae.metrics.comparison import match, take_matched  # noqa: E402
from dmae.reconstruction.config import CaptureConfig  # noqa: E402
from dmae.reconstruction.pipeline import capture  # noqa: E402
from tests.support.animals import dog_clip, hand_clip, hands_clip  # noqa: E402

FILE = ROOT / "docs/results/animals.json"
METHODS = ("linear", "pchip_body", "rays", "gaussian_process")
CLIPS = {
    "hand, 21 joints, 19 cm": hand_clip,
    "two hands, 12 cm apart": hands_clip,
    "dog, 19 joints, 1.2 m": dog_clip,
    "three dogs": lambda seed: dog_clip(seed=seed, dogs=3),
}
SEEDS = 5


def _errors(clip: Clip, poses: Poses3D, chosen: np.ndarray) -> np.ndarray:
    """Return the distances from the truth, mm, of the chosen joints (F, P, J) of poses."""
    found = take_matched(np.where(chosen[..., None], poses.xyz, np.nan), match(poses.xyz, clip.truth.xyz))
    distance = 1000 * np.linalg.norm(found - clip.truth.xyz, axis=-1)
    return distance[~np.isnan(distance)]


def _with_size(clip: Clip, size_m: float | None) -> Clip:
    skeleton = replace(clip.detections.skeleton, size_m=size_m)
    return replace(clip, detections=replace(clip.detections, skeleton=skeleton))


def measure() -> None:
    captured, completed = [], []
    for name, make in CLIPS.items():
        sizes, errors = defaultdict(list), defaultdict(list)
        for seed in range(SEEDS):
            clip = make(seed=seed)
            for size, wanted in (("stated", clip), ("measured", _with_size(clip, None)),
                                 ("a person's", _with_size(clip, PERSON_M))):  # fmt: skip
                poses = capture(wanted, CaptureConfig())
                count = poses.measured.sum() / (clip.truth.xyz[..., 0].size)
                sizes[size].append((poses.xyz.shape[1], count, _errors(clip, poses, poses.measured)))
            poses = capture(clip, CaptureConfig())
            for method in METHODS:
                filled = find_method(method).load()(poses, clip.fps)
                errors[method].append(_errors(clip, filled, filled.source == Source.COMPLETED))
        for size, found in sizes.items():
            right = sum(bodies == clip.truth.xyz.shape[1] for bodies, *_ in found)
            share = 100 * np.mean([share for _, share, _ in found])
            mean = np.concatenate([each for *_, each in found]).mean()
            captured.append([name, size, f"{right} of {SEEDS}", f"{share:.1f}", f"{mean:.1f}"])
        means = [f"{np.concatenate(errors[method]).mean():.1f}" for method in METHODS]
        completed.append([name, str(sum(map(len, errors["linear"]))), *means])
    command = "python docs/tools/animals.py"
    captured_columns = ["bodies", "size", "clips with the right number", "joints measured, %", "mean error, mm"]
    content = {
        "measured": measured(),
        "tables": {
            "captured": {"command": command, "columns": captured_columns, "rows": captured},
            "completed": {
                "command": command,
                "columns": ["bodies", "joints completed", *(f"{method}, mm" for method in METHODS)],
                "rows": completed,
            },
        },
    }
    FILE.write_text(json_text(content) + "\n")


if __name__ == "__main__":
    measure()
