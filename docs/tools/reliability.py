"""Check whether the confidences of `dmae detect` are probabilities: compare them with the share of correct joints.

    python docs/tools/reliability.py DETECTED...    # into docs/results/reliability.json

DETECTED are data sets that `dmae detect clip=...` made. A joint is near if its distance from the true position is at
most 5 % of the height of the body. All joints of people with a matched detection count, hidden ones included.
"""

import sys
from pathlib import Path

import numpy as np
from provenance import provenance

import dmae
from dmae.data.clip import Clip
from dmae.data.conversion import convert, convert_detections
from dmae.data.json_values import json_text
from dmae.data.skeleton import BODY25
from dmae.detection.detectors.landmarks import GROUPS
from synth.detector.statistics import match_detections
from synth.recognition.realism import NEAR, sightings

RESULT = Path(__file__).parents[1] / "results/reliability.json"
_COMMAND = (
    "synth generate -m scene=office,living_room,market,pillars,studio,warehouse rig=ring,random rig.ring.views=3 "
    "rig.random.views=3 scene.fps=1 scene.seconds=6 clips=2 seed=71 images=rgb rgb=jpeg out=rooms && "
    "for n in 0 1 2 3 4 5 6 7 8 9 10 11; do dmae detect clip=rooms/$n out=seen/$n detector.search_every=1 "
    "detector.windows=[1,0.6]; done && python docs/tools/reliability.py seen/*"
)
_TENTHS = 10


def joints_of(clip: Clip) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return confidences, whether joints were near their true places, and numbers of joints of BODY25; (N,) each."""
    found = convert_detections(clip.detections, BODY25)
    plain = dmae.Clip(clip.id, clip.fps, clip.rig, found, truth=clip.truth)
    seen, match = sightings(clip), match_detections(plain, convert(clip.truth, BODY25))
    error = np.linalg.norm(match.found - seen.xy, axis=-1) / seen.height[..., None]
    known = ~np.isnan(error) & ~np.isnan(match.score)
    return match.score[known], error[known] < NEAR, np.nonzero(known)[-1]


def row(name: str, confidence: np.ndarray, near: np.ndarray) -> dict:
    """Return mean confidence and share near the true place, and how far apart the two are, by tenths of confidence."""
    tenth = np.minimum((confidence * _TENTHS).astype(int), _TENTHS - 1)
    apart = [abs(confidence[tenth == k].mean() - near[tenth == k].mean()) * (tenth == k).mean() for k in set(tenth)]
    return {
        "joints": name,
        "number": len(near),
        "confidence": float(confidence.mean()),
        "near": float(near.mean()),
        "error": float(sum(apart)),
        "brier": float(((confidence - near) ** 2).mean()),
    }


def main(folders: list[str]) -> None:
    confidence, near, joint = (
        np.concatenate(each)
        for each in zip(*(joints_of(clip) for folder in folders for clip in dmae.load_dataset(folder)), strict=True)
    )
    rows = [row("all", confidence, near)]
    tenth = np.minimum((confidence * _TENTHS).astype(int), _TENTHS - 1)
    rows += [row(f"confidence {k}0-{k + 1}0 %", confidence[tenth == k], near[tenth == k]) for k in np.unique(tenth)]
    kinds = np.array([name.removeprefix("l_").removeprefix("r_") for name in BODY25.joints])[joint]
    for group, names in GROUPS.items():
        some = np.isin(kinds, names)
        rows += [row(group, confidence[some], near[some])] if some.any() else []
    RESULT.write_text(json_text({"command": _COMMAND, **provenance("mujoco"), "rows": rows}) + "\n")
    for each in rows:
        print(each)


if __name__ == "__main__":
    main(sys.argv[1:])
