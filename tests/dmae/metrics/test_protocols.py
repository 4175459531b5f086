"""PCP by published protocols."""

import numpy as np
import pytest

from dmae.data.skeleton import SHELF14
from dmae.metrics.protocols import published_pcp
from tests.support.shelf_walkers import people


def test_published_protocols_differ_as_described():
    truth = people(4, 2)
    pred = truth.copy()
    pred[0, 1] = np.nan
    # Strict: actor 1 is missed in one frame of four. 4da does not count it, hkbu does, mvpose takes actor 0.
    scores = published_pcp(pred, truth, SHELF14, [0, 1])
    assert scores["4da"] == 100
    assert scores["hkbu"] == pytest.approx(87.5)
    assert scores["mvpose"] == pytest.approx(87.5)
