"""Confidence: the probability that a joint was found near its true place, fitted on clips with images and truth."""

from collections.abc import Iterable
from functools import cache

import numpy as np
from scipy.optimize import minimize

from dmae.data.clip import Clip
from dmae.data.skeleton import BLAZEPOSE33
from dmae.detection.blazepose.landmarks import Person, find_person
from dmae.detection.blazepose.models import MODELS, Network
from dmae.detection.blazepose.regions import Region, pyramid_of
from dmae.files.structured import read_json

NEAR = 0.05
"""Largest distance, as a share of the height of the body, at which a joint counts as near its true place."""
_STATURE = 1.7
"""m; assumed height of a body, which converts pixels at its depth into a share of the height."""
_PASSES = 2
_PENALTY = 1.0
"""Penalty on the squared weights of the scores. It prevents extreme weights for rare joints."""
_MATCHED = 0.15
"""Largest mean distance of a detection from the true joints, m/m; one with a greater distance is another person."""
GROUPS = {
    "face": ("nose", "eye", "eye_inner", "eye_outer", "mouth"),
    "ear": ("ear",),
    "shoulder": ("shoulder",),
    "elbow": ("elbow",),
    "hand": ("wrist", "little_finger", "index_finger", "thumb"),
    "hip": ("hip",),
    "knee": ("knee",),
    "ankle": ("ankle",),
    "foot": ("heel", "big_toe"),
}
"""Kinds of joints that share a fit."""


def confidence(person: Person) -> np.ndarray:
    """Return (33,) probabilities that joints are within 5 % of the height of the body from their true places."""
    logits = (_weights() * _features(person)).sum(-1)
    return 1 / (1 + np.exp(-np.clip(logits, -30, 30)))


def clearness(person: Person) -> float:
    """Return the mean confidence of the joints of a person, from 0 to 1."""
    return float(confidence(person).mean())


def fit_confidence(clips: Iterable[Clip], every: int = 4) -> dict[str, dict]:
    """Fit the confidence of each group of joints by logistic regression.

    Regions are those of the true people, so that hidden people count as well.

    Args:
        clips: With colour images and truth in `body25+shelf14`.
        every: Step from one used frame to the next.

    Returns:
        By group: `weights` of 1, of the logit of visibility and of that of being inside the image; `number` of
        joints; `near`, the share of joints that are near their true places. `confidence.json` has the same content.
    """
    features, near = zip(*(each for clip in clips for each in _samples(clip, every)), strict=True)
    features, near = np.array(features), np.array(near)
    fitted = {}
    for group, index in _members().items():
        x, y = features[:, index].reshape(-1, 3), near[:, index].ravel()
        x, y = x[~np.isnan(y)], y[~np.isnan(y)]
        fitted[group] = {"weights": np.round(_logistic(x, y), 4).tolist(), "number": len(y), "near": round(y.mean(), 4)}
    return fitted


def _features(person: Person) -> np.ndarray:
    """Return (33, 3) features: 1 and the two logits, clipped where larger values add no information."""
    logits = np.clip(np.stack([person.visibility, person.inside], -1), -8, 8)
    return np.concatenate([np.ones((len(logits), 1)), logits], -1)


def _members() -> dict[str, list[int]]:
    kinds = [joint.removeprefix("l_").removeprefix("r_") for joint in BLAZEPOSE33.joints]
    return {group: [i for i, kind in enumerate(kinds) if kind in names] for group, names in GROUPS.items()}


@cache
def _weights() -> np.ndarray:
    """Return the (33, 3) weights of the features."""
    fitted, weights = read_json(MODELS / "confidence.json"), np.empty((len(BLAZEPOSE33), 3))
    for group, index in _members().items():
        weights[index] = fitted[group]["weights"]
    return weights


def _samples(clip: Clip, every: int) -> Iterable[tuple[np.ndarray, np.ndarray]]:
    """Yield for each person features (33, 3), and (33,) whether joints are near their true places, NaN if unknown."""
    network, rig, skeleton = Network("pose_landmark_full"), clip.true_rig or clip.rig, clip.truth.skeleton
    known = [i for i, joint in enumerate(BLAZEPOSE33.joints) if f"body25.{joint}" in skeleton.joints]
    xy, depth = rig.project(clip.truth.xyz[:, :, skeleton.index(*(f"body25.{BLAZEPOSE33.joints[i]}" for i in known))])
    focal = np.sqrt(rig.K[:, 0, 0] * rig.K[:, 1, 1])
    inside = rig.inside(xy)
    for frame in range(0, len(clip), every):
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
                yield _features(found), near


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
