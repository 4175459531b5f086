"""The search for partners refuses most pairs early, and finds what a comparison of all pairs finds."""

import numpy as np
import pytest

from dmae.reconstruction.association import affinity, find_partners

VIEWS, EACH, JOINTS = 3, 12, 25


def detections(seed: int) -> tuple[np.ndarray, ...]:
    """Return view, centres, rays, weights and colours of figures in three views, a third of them of the same people."""
    rng = np.random.default_rng(seed)
    centers = np.array([[4, 0, 1.5], [-2, 3.5, 1.6], [-2, -3.5, 1.4]], np.float32)
    same = rng.uniform(-1, 1, (EACH // 3, JOINTS, 3))
    view, rays = np.repeat(np.arange(VIEWS), EACH), np.zeros((VIEWS * EACH, 3, 32), np.float32)
    for v in range(VIEWS):
        places = np.concatenate([same, rng.uniform(-1, 1, (EACH - len(same), JOINTS, 3))])
        towards = places + rng.normal(0, 0.01, places.shape) - centers[v]
        rays[view == v, :, :JOINTS] = (towards / np.linalg.norm(towards, axis=-1, keepdims=True)).swapaxes(1, 2)
    weights = np.zeros((len(view), 32), np.float32)
    weights[:, :JOINTS] = np.sqrt(rng.uniform(0.3, 1, (len(view), JOINTS)))
    absent = rng.random(weights.shape) < 0.2
    weights[absent] = 0
    rays.swapaxes(1, 2)[absent] = 0
    colours = rng.uniform(0, 60, (len(view), 3)).astype(np.float32)
    return view, centers, rays, weights, colours


@pytest.mark.parametrize("least", [0.3, 0.5])
@pytest.mark.parametrize("colour_weight", [0.0, 0.3, 1.0])
def test_no_pair_is_lost(least, colour_weight):
    for seed in range(3):
        given = detections(seed)
        lengths = tuple(np.array([0.1, 20, colour_weight], np.float32))
        partners = np.full((VIEWS * EACH, VIEWS, EACH), -1, np.int32)
        found = np.zeros(partners.shape, np.float32)
        find_partners(*given, *lengths, np.float32(least), partners, found)
        view, expected = given[0], {}
        for i in range(len(view)):
            for j in range(len(view)):
                value = affinity(min(i, j), max(i, j), *given, *lengths)
                if view[i] != view[j] and value >= np.float32(least):
                    expected[i, j] = value
        assert len(expected) >= 2 * 3 * EACH // 3
        rows = np.argwhere(partners >= 0)
        assert {(i, partners[i, v, k]): found[i, v, k] for i, v, k in rows} == expected
