"""For pytest, in any project: the cases that `dmae regress` runs, as tests of its own triangulation.

    def test_triangulation(check_triangulation):
        check_triangulation(my_solver)  # as described at dmae.regression.check

is one test for each case, and `triangulation_case` the case itself, with its arrays and the truth. Nothing is loaded
before a test asks for either.
"""

from functools import partial

import pytest


def pytest_generate_tests(metafunc):
    """One test for each case."""
    if "triangulation_case" in metafunc.fixturenames:
        from dmae.regression import cases

        metafunc.parametrize("triangulation_case", cases(), ids=lambda case: case.name)


@pytest.fixture
def check_triangulation(triangulation_case):
    """A function of a solver: AssertionError if it breaks a bound of this test's case."""
    from dmae.regression import assert_passes

    return partial(assert_passes, case=triangulation_case)
