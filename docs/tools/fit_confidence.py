"""Fit the confidences of BlazePose: the probability that a joint was found near its true place.

    python docs/tools/fit_confidence.py CLIP...    # writes dmae/models/blazepose/confidence.json

CLIP are folders of clips with colour images and truth in `body25+shelf14`. Joints are searched at the true people, so
that hidden people count as well.
"""

import json
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from dmae.data.clip import Clip
from dmae.data.skeleton import BLAZEPOSE33
from dmae.data.store import load_clip
from dmae.detection.detectors.landmarks import (
    MODELS,
    Network,
    Person,
    Region,
    features,
    find_person,
    members,
    pyramid_of,
)
from dmae.files.contents import write_atomic

NEAR = 0.05
"""Largest distance, as a share of the height of the body, at which a joint counts as near its true place."""
_STATURE = 1.7
"""m; assumed height of a body, which converts pixels at its depth into a share of the height."""
_EVERY = 4
"""Step from one used frame to the next."""
_PASSES = 2
_PENALTY = 1.0
"""Penalty on the squared weights of the scores. It prevents extreme weights for rare joints."""
_MATCHED = 0.15
"""Largest mean distance of a detection from the true joints, m/m; one with a greater distance is another person."""


def fit_confidence(clips: Iterable[Clip]) -> dict[str, dict]:
    """Fit the confidence of each group of joints by logistic regression, on every fourth frame.

    Returns:
        For each group: `weights` of 1, of the logit of being visible and of the logit of being inside the image;
        `number` of joints; `near`, the share of joints near their true places.
    """
    features, near = zip(*(each for clip in clips for each in _samples(clip)), strict=True)
    features, near = np.array(features), np.array(near)
    fitted = {}
    for group, index in members().items():
        x, y = features[:, index].reshape(-1, 3), near[:, index].ravel()
        x, y = x[~np.isnan(y)], y[~np.isnan(y)]
        share = round(float(y.mean()), 4)
        fitted[group] = {"weights": np.round(_logistic(x, y), 4).tolist(), "number": len(y), "near": share}
    return fitted


def _samples(clip: Clip) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    """Yield for each person features (33, 3), and (33,) whether joints are near their true places, NaN if unknown."""
    network, rig, skeleton = Network("pose_landmark_full"), clip.actual_rig, clip.truth.skeleton
    known = [i for i, joint in enumerate(BLAZEPOSE33.joints) if f"body25.{joint}" in skeleton.joints]
    xy, depth = rig.project(clip.truth.xyz[:, :, skeleton.index(*(f"body25.{BLAZEPOSE33.joints[i]}" for i in known))])
    focal = rig.focal
    inside = rig.inside(xy)
    for frame in range(0, len(clip), _EVERY):
        for view, name in enumerate(rig.names):
            pyramid = pyramid_of(np.ascontiguousarray(clip.images.at("rgb", name, frame)))
            for person in range(xy.shape[2]):
                true = xy[frame, view, person]
                if inside[frame, view, person].mean() < 0.5:
                    continue
                found = _found(network, pyramid, true, known)
                height = _STATURE * focal[view] / depth[frame, view, person]
                if found is None:
                    continue
                distance = np.linalg.norm(found.xy[known] - true, axis=-1) / height
                if not np.nanmean(distance) < _MATCHED:
                    continue
                near = np.full(len(BLAZEPOSE33), np.nan)
                near[known] = np.where(np.isnan(distance), np.nan, distance < NEAR)
                yield features(found), near


def _found(network: Network, pyramid: list[np.ndarray], true: np.ndarray, known: list[int]) -> Person | None:
    at = {BLAZEPOSE33.joints[i]: place + 0.5 for i, place in zip(known, true, strict=True)}
    hip, shoulder = ((at[f"l_{part}"] + at[f"r_{part}"]) / 2 for part in ("hip", "shoulder"))
    up = (shoulder - hip) / max(np.hypot(*(shoulder - hip)), 1e-6)
    region = Region.around(hip, hip + 1.1 * np.nanmax(np.linalg.norm(true + 0.5 - hip, axis=-1)) * up)
    person = None
    for _ in range(_PASSES):
        if region is None:
            return None
        person = find_person(network, pyramid, region)
        region = person.region
    return person if person.presence >= 0.5 else None


def _logistic(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    def loss(weights: np.ndarray) -> float:
        logits = x @ weights
        return float(np.logaddexp(0, logits).sum() - (y * logits).sum() + _PENALTY * (weights[1:] ** 2).sum())

    return minimize(loss, np.zeros(x.shape[1]), method="L-BFGS-B", bounds=[(None, None), (0, None), (0, None)]).x


if __name__ == "__main__":
    fitted = fit_confidence(load_clip(Path(folder)) for folder in sys.argv[1:])
    write_atomic(MODELS / "confidence.json", json.dumps(fitted, indent=1) + "\n")
