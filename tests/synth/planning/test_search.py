"""The search for cameras, on evidence that is known; and evidence, in scenes that are simple."""

from itertools import combinations

import numpy as np
import pytest

from synth.planning.plan import expected
from synth.planning.search import JointEvidence, choose, predict, standard_errors


def evidence_of(centers: np.ndarray, joints: np.ndarray, probability: np.ndarray, error: float = 0.01) -> JointEvidence:
    """Evidence of cameras at (C, 3) places on (N, 3) joints."""
    toward = joints[:, None] - centers
    toward /= np.linalg.norm(toward, axis=-1, keepdims=True)
    planes = np.eye(3) - toward[..., :, None] * toward[..., None, :]
    rows, columns = [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]
    weight = probability[..., None] / error**2
    return JointEvidence(probability.astype(np.float32), (planes[..., rows, columns] * weight).astype(np.float32))


def around(count: int, radius: float = 4.0) -> np.ndarray:
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full(count, 1.5)], -1)


def test_standard_errors_are_those_of_the_inverse():
    rng = np.random.default_rng(0)
    parts = rng.normal(size=(5, 3, 4))
    covariance = parts @ parts.swapaxes(-1, -2) * 1e-4
    inverse = np.linalg.inv(covariance)
    information = inverse[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    np.testing.assert_allclose(standard_errors(information), np.sqrt(np.trace(covariance, axis1=1, axis2=2)), rtol=1e-3)


def test_the_share_that_is_measured_is_that_of_two_detections():
    rng = np.random.default_rng(1)
    probability = rng.uniform(0.2, 0.9, (200, 4))
    evidence = evidence_of(around(4), rng.normal(0, 0.5, (200, 3)), probability)
    none = (1 - probability).prod(1)
    one = sum(probability[:, c] * np.delete(1 - probability, c, 1).prod(1) for c in range(4))
    assert predict(evidence, [0, 1, 2, 3]).missing == pytest.approx(100 * (none + one).mean(), abs=1e-4)


def test_cameras_that_see_nothing_or_from_the_same_side_are_left():
    joints = np.random.default_rng(2).normal(0, 0.4, (100, 3)) + (0, 0, 1)
    centers = np.concatenate([around(6), around(6) + (0.05, 0, 0)])
    probability = np.full((100, 12), 0.9)
    probability[:, 3] = 0
    chosen = choose(evidence_of(centers, joints, probability), np.arange(12), range(2, 5), 3)
    assert [len(cameras) for cameras in chosen.values()] == [2, 3, 4]
    assert all(3 not in cameras for cameras in chosen.values())
    one, other = centers[chosen[2]]
    cosine = one[:2] @ other[:2] / np.linalg.norm(one[:2]) / np.linalg.norm(other[:2])
    assert abs(cosine) < 0.6


def test_exchange_finds_the_best_of_all_pairs_and_keeps_places_apart():
    rng = np.random.default_rng(3)
    evidence = evidence_of(around(8), rng.normal(0, 1, (60, 3)), rng.uniform(0, 1, (60, 8)))
    place = np.arange(8) // 2
    (chosen,) = choose(evidence, place, range(2, 3), 5).values()
    allowed = [list(pair) for pair in combinations(range(8), 2) if place[pair[0]] != place[pair[1]]]
    scores = [predict(evidence, pair).score for pair in allowed]
    assert predict(evidence, chosen).score >= np.quantile(scores, 0.9)
    assert len(set(place[chosen])) == 2
    assert predict(evidence, chosen).score > predict(evidence, chosen[:1]).score
    with pytest.raises(ValueError, match="5 cameras do not fit into 4 places"):
        choose(evidence, place, range(5, 6), 1)


def test_intervals_are_over_clips():
    rng = np.random.default_rng(4)
    held = 0
    for _ in range(300):
        found = expected(rng.normal(90, 3, 6))
        held += found.low <= 90 <= found.high
    assert 270 <= held <= 297
    cut = expected(np.array([99.0, 100.0, 95.0, np.nan]), 0.0, 100.0)
    assert (cut.value, cut.high) == (98.0, 100.0) and cut.low > 80
    assert np.isnan(expected(np.array([5.0, np.nan])).low) and np.isnan(expected(np.array([np.nan])).value)
