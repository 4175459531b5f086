"""Functions compiled to machine code, for inner loops that numpy cannot express."""

from collections.abc import Callable

import numba


def compiled(fastmath: bool = False) -> Callable[[Callable], Callable]:
    """Return a decorator that compiles a function when it is first called.

    The machine code is kept on disk, in the folder of the source or, if that is read-only, in the user's cache folder:
    only the first call ever takes seconds. If neither can be written, each process compiles again.

    Args:
        fastmath: Let sums be reordered, so that several terms are added together; no value may be NaN or infinite.
    """
    # Checks for division by zero would keep loops from being vectorised.
    options = {"nogil": True, "error_model": "numpy"}
    if fastmath:
        options["fastmath"] = {"reassoc", "contract", "nsz", "arcp", "nnan", "ninf"}

    def decorate(function: Callable) -> Callable:
        try:
            return numba.njit(cache=True, **options)(function)
        except RuntimeError:  # no folder for the cache can be written
            return numba.njit(**options)(function)

    return decorate
