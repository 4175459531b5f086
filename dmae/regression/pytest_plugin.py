"""The cases of `dmae regress` as pytest tests of any project's triangulation.

    def test_triangulation(check_triangulation):
        check_triangulation(my_solver)  # as described at dmae.regression.check

gives one test for each case. The fixture `triangulation_case` is the case itself, with its arrays and the truth. The
cases are loaded only when a test uses one of these fixtures.
"""

from functools import partial

import pytest


def pytest_generate_tests(metafunc):
    """Generate one test for each case."""
    if "triangulation_case" in metafunc.fixturenames:
        from dmae.regression.pack import cases

        metafunc.parametrize("triangulation_case", cases(), ids=lambda case: case.name)


@pytest.fixture
def check_triangulation(triangulation_case):
    """Return a function of a solver that raises AssertionError if the solver does not pass this test's case."""
    from dmae.regression.verdicts import assert_passes

    return partial(assert_passes, case=triangulation_case)
