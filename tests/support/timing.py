"""Measure the run time of a function."""

import time


def seconds(function, times=3):
    """Return the shortest time of several runs."""
    spent = []
    for _ in range(times):
        start = time.perf_counter()
        function()
        spent.append(time.perf_counter() - start)
    return min(spent)
