"""A frozen pack of cases for triangulation, whoever's it is, and the bounds that it must keep."""

from dmae.regression.check import Verdict, assert_passes, check, check_case
from dmae.regression.pack import Case, cases

__all__ = ["Case", "Verdict", "assert_passes", "cases", "check", "check_case"]
