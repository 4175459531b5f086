"""Closest approach of two lines."""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from dmae.reconstruction.triangulation import closest_approach

vector = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)


@given(vector, vector, vector)
def test_the_connection_is_perpendicular_to_both_lines(base, a, b):
    assume(np.linalg.norm(a) > 0.1 and np.linalg.norm(b) > 0.1)
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    along_a, along_b, sine2 = closest_approach(base, a, b)
    assume(sine2 > 1e-3)
    np.testing.assert_allclose(sine2, (np.cross(a, b) ** 2).sum(), atol=1e-9)
    connection = base + along_b * b - along_a * a
    np.testing.assert_allclose([connection @ a, connection @ b], 0, atol=1e-9)


def test_a_point_behind_the_start_is_negative():
    along_a, along_b, sine2 = closest_approach(np.array([0, 2, 0]), np.array([1, 0, 0]), np.array([0, 1, 0]))
    assert (along_a, along_b, sine2) == (0, -2, 1)


def test_parallel_lines_have_the_smallest_sine():
    x = np.array([1.0, 0, 0])
    assert closest_approach(np.array([0, 1.0, 0]), x, x)[2] == 1e-12
