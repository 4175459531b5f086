"""Compiled distances, and functions that use them, compared with the same computation on arrays."""

import numpy as np
import pytest

from dmae.reconstruction.association import NONE
from dmae.reconstruction.config import CaptureConfig, DistanceUnit
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.reassignment import reassign
from tests.support.detected_people import crossing, detected_clip

FRAMES = slice(10, 30)


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    return Evidence.of(detected_clip(crossing(), miss=0.3), 0.1, CaptureConfig())


@pytest.fixture(scope="module")
def people() -> np.ndarray:
    """(F, P, J, 3) near the true people; some unknown, one behind all cameras."""
    rng = np.random.default_rng(0)
    xyz = crossing()[FRAMES] + rng.normal(0, 0.05, crossing()[FRAMES].shape)
    xyz[rng.random(xyz.shape[:3]) < 0.2] = np.nan
    return np.concatenate([xyz, xyz[:, :1] + 100.0], 1)


def by_arrays(evidence: Evidence, people: np.ndarray, unit: DistanceUnit) -> np.ndarray:
    """(F, V, P, D, J)"""
    rig = evidence.rig
    pixels, depth = rig.project(people)
    focal, diagonal = np.sqrt(rig.K[:, 0, 0] * rig.K[:, 1, 1]), np.hypot(*rig.size.T)
    scale = depth / focal[:, None, None] if unit == DistanceUnit.metres else 1 / diagonal[:, None, None] + 0 * depth
    return np.linalg.norm(pixels[:, :, :, None] - evidence.xy[FRAMES][:, :, None], axis=-1) * scale[:, :, :, None]


@pytest.mark.parametrize("unit", list(DistanceUnit))
def test_distances_of_detections_from_people(evidence, people, unit):
    found, expected = evidence.distances(FRAMES, people, unit), by_arrays(evidence, people, unit)
    assert np.isfinite(expected).mean() > 0.2 and np.isnan(expected[:, :, -1]).any()
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_joints_take_the_detection_that_is_nearest_both_ways(evidence, people):
    distance = by_arrays(evidence, people, DistanceUnit.metres)
    distance = np.where(distance < 0.2, distance, np.inf)
    nearest = distance.argmin(3)
    owner = np.take_along_axis(distance.argmin(2), nearest, 2)
    mutual = np.isfinite(distance.min(3)) & (owner == np.arange(people.shape[1])[:, None])
    expected = np.where(mutual, nearest, NONE).swapaxes(1, 2)
    before = np.full(expected.shape, 7, np.int16)
    found = reassign(evidence_of(evidence), before, people, 0.2)
    known = ~np.isnan(people[:, :, None, :, 0]) & np.ones(expected.shape, bool)
    np.testing.assert_array_equal(found[known], expected[known])
    assert (found[~known] == 7).all() and (expected[known] != NONE).mean() > 0.3


def evidence_of(evidence: Evidence) -> Evidence:
    """Return that of the frames of the people."""
    return Evidence(evidence.rig, evidence.xy[FRAMES], evidence.confidence[FRAMES], evidence.config)
