"""Figures of one small clip, its labels and its capture, which are the same on every system within tolerances.

python -m tests.fingerprints        # write tests/data/fingerprints.json anew, after a change of labels or capture
"""

import json
from pathlib import Path

import numpy as np

import dmae
import synth
from dmae.data.conversion import convert
from dmae.data.labels import Visibility
from dmae.data.skeleton import BODY25

FILE = Path(__file__).parent / "data/fingerprints.json"
TOLERANCES = {"m": 0.005, "share": 0.01, "mm": 2.0, "count": 0}
"""By unit, which ends the name of a figure. Physics and rays differ in the last digits between processors; frames,
people and cameras do not."""


def measure() -> dict[str, float | list[float]]:
    """Return the figures, by name."""
    clip = next(synth.generate(seconds=1, persons=[2, 2], clips=1, scene="office", seed=3))
    poses = dmae.capture(clip)
    scores = dmae.evaluate(clip, poses)
    visibility = clip.occlusion.visibility
    truth = convert(clip.truth, BODY25)
    hips = truth.xyz[:, :, BODY25.joints.index("mid_hip")].astype(float)
    return {
        "frames, persons, cameras: count": [*truth.xyz.shape[:2], len(clip.rig)],
        "joints, mean position: m": truth.xyz.mean((0, 1, 2), dtype=float).tolist(),
        "hips, path length: m": np.linalg.norm(np.diff(hips, axis=0), axis=-1).sum(0).tolist(),
        "joints by visibility: share": [float((visibility == code).mean()) for code in Visibility],
        "joints detected: share": float(clip.detections.observed.mean()),
        "confidence, mean: share": float(np.nanmean(clip.detections.score)),
        "joints measured: share": float(poses.measured.mean()),
        "captured joints, mean error: mm": float(scores["mpjpe"]["measured"]),
    }


if __name__ == "__main__":
    FILE.write_text(
        json.dumps({name: np.round(value, 5).tolist() for name, value in measure().items()}, indent=1) + "\n"
    )
    print(FILE)
