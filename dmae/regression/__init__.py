"""Regression tests for any triangulation: a frozen pack of cases, and bounds on the errors of a solver."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dmae.regression.pack import Case, cases
    from dmae.regression.verdicts import Verdict, assert_passes, check, check_case

__all__ = ["Case", "Verdict", "assert_passes", "cases", "check", "check_case"]


# The names are loaded on first use, because pytest imports this package wherever dmae is installed.
def __getattr__(name: str):
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{'pack' if name in ('Case', 'cases') else 'verdicts'}"), name)
