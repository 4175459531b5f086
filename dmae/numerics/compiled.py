"""Compile functions to machine code, for inner loops that numpy cannot express."""

from collections.abc import Callable

import numba

_FUNCTIONS: list = []
"""What was decorated in this process."""


def compiled_anew() -> bool:
    """Return whether this process had to compile a function, as it found no machine code of an earlier one."""
    return any(getattr(function, "stats", None) and function.stats.cache_misses for function in _FUNCTIONS)


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
            made = numba.njit(cache=True, **options)(function)
        except RuntimeError:  # no folder for the cache can be written
            made = numba.njit(**options)(function)
        _FUNCTIONS.append(made)
        return made

    return decorate
