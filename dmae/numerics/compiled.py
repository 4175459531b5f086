"""Functions compiled to machine code, for inner loops that numpy cannot express."""

from collections.abc import Callable

import numba


def compiled(fastmath: bool = False) -> Callable[[Callable], Callable]:
    """Return a decorator that compiles a function when it is first called.

    The machine code is kept on disk, beside the source or, where that cannot be written, in the user's cache folder:
    only the first call ever takes seconds. Where neither can be written, each process compiles anew.

    Args:
        fastmath: Let sums be reordered, so that several terms are added at once; no value may be NaN or infinite.
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
