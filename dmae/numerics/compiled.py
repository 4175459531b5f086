"""Compile functions to machine code, for inner loops that numpy cannot express."""

from collections.abc import Callable

import numba


def compiled(fastmath: bool = False) -> Callable[[Callable], Callable]:
    """Return a decorator that compiles a function when it is first called.

    The machine code is cached on disk, in the folder of the source or, if that is read-only, in the user's cache
    folder. Only the first call on a machine takes seconds. If neither folder is writable, each process compiles again.

    Args:
        fastmath: Whether sums may be reordered, so that several terms are added in one instruction. No value may be NaN
            or infinite.
    """
    # Checks for division by zero would prevent the vectorisation of loops.
    options: dict = {"nogil": True, "error_model": "numpy"}
    if fastmath:
        options["fastmath"] = {"reassoc", "contract", "nsz", "arcp", "nnan", "ninf"}

    def decorate(function: Callable) -> Callable:
        try:
            return numba.njit(cache=True, **options)(function)
        except RuntimeError:  # no folder for the cache can be written
            return numba.njit(**options)(function)

    return decorate
