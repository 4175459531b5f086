"""Labels and captures are the same on every system, and with the oldest and the newest packages, within tolerances."""

import json

import numpy as np
import pytest

from tests.fingerprints import FILE, TOLERANCES, measure


@pytest.mark.slow
def test_labels_and_captures_are_those_of_other_systems():
    expected, found = json.loads(FILE.read_text()), measure()
    assert list(found) == list(expected)
    for name, value in found.items():
        tolerance = TOLERANCES[name.rsplit(" ", 1)[1]]
        np.testing.assert_allclose(value, expected[name], rtol=0, atol=tolerance, err_msg=name)
