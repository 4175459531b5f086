"""Tasks in processes give what tasks in this one give."""

import pytest

from dmae.parallel import in_parallel


def square(number):
    return number**2


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("ordered", [True, False])
def test_results_are_those_of_the_tasks(workers, ordered):
    found = list(in_parallel(square, ((number,) for number in range(7)), workers, ordered=ordered))
    assert sorted(found) == [number**2 for number in range(7)]
    assert not ordered or found == sorted(found)
