"""`dmae regress`: any project's triangulation against the pack of `dmae.regression`."""

import importlib
import inspect
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dmae.regression import Verdict, cases, check
from dmae.regression.check import ASKS, REASONS, SECONDS, text
from dmae.tables import Table, print_tables


@dataclass(frozen=True)
class RegressCommand:
    """`dmae regress`."""

    solver: str = "???"
    """package.module:function; the current folder is looked in first."""
    skip: list[str] = field(default_factory=list)
    """Names of cases that the solver is not meant for."""
    seconds: float = SECONDS
    """What it may take for one case."""
    report: str | None = None
    """An HTML page to write."""


def run_regress(config: RegressCommand, out: Path | None) -> None:
    """Print what came of every case; exits with status 1 if a bound is broken."""
    verdicts = check(load_solver(config.solver), config.skip, config.seconds)
    print_tables([verdict_table(config.solver, verdicts)])
    failed = [verdict for verdict in verdicts if not verdict.passed]
    print(*failed, sep="\n", end="\n\n" if failed else "")
    if config.report:
        from dmae.report import write_report

        write_report(Path(config.report), f"Triangulation by {config.solver}", [regress_section(verdicts)])
        print(config.report)
    skipped = f", {len(config.skip)} skipped" if config.skip else ""
    print(f"{len(verdicts) - len(failed)} of {len(verdicts)} cases passed{skipped}")
    if failed:
        sys.exit(1)


def load_solver(name: str) -> Callable:
    """The function that `package.module:function` names, from the current folder or what is installed.

    Raises:
        ValueError: there is none, its module cannot be imported, or it does not take the keywords of `check`.
    """
    module_name, _, function_name = name.partition(":")
    if not module_name or not function_name:
        raise ValueError(f"solver={name}: expected package.module:function, as in solver=dmae.regression.solvers:ours")
    sys.path.insert(0, str(Path.cwd()))
    try:
        module = importlib.import_module(module_name)
    # Whatever a module does when it is imported, SystemExit included, is to be told as one line.
    except (Exception, SystemExit) as error:
        raise ValueError(
            f"solver={name}: cannot import {module_name}: {type(error).__name__}: {error} (looked in {Path.cwd()} "
            f"and among the installed packages; expected package.module:function)"
        ) from error
    solver = getattr(module, function_name, None)
    if not callable(solver):
        there = [key for key, value in vars(module).items() if inspect.isfunction(value) and not key.startswith("_")]
        raise ValueError(f"solver={name}: {module_name} has no function {function_name!r}; there are {there}")
    keywords = cases()[0].arrays()
    try:
        inspect.signature(solver).bind(**keywords)
    except TypeError as error:
        raise ValueError(
            f"solver={name}: {error}; expected a function of the keywords {', '.join(keywords)} that returns (n, 3) "
            f"points, found {function_name}{inspect.signature(solver)}"
        ) from None
    except ValueError:
        pass  # what is compiled need not tell its signature
    return solver


def verdict_table(name: str, verdicts: Sequence[Verdict]) -> Table:
    """A row for each case: what was measured, a slash and what is allowed where that is bounded."""
    return Table(
        f"{name}: errors in mm, refused in % / what is allowed",
        ("case", *REASONS, ""),
        [
            (
                verdict.case.name,
                *(_cell(verdict, measure) for measure in REASONS),
                "ok" if verdict.passed else "FAIL",
            )
            for verdict in verdicts
        ],
    )


def _cell(verdict: Verdict, measure: str) -> str:
    if measure not in verdict.measured:
        return "-"
    values = [found[measure] for found in (verdict.measured, verdict.bounds) if measure in found]
    return "/".join(text(measure, value).removesuffix(" mm").removesuffix("%") for value in values)


def regress_section(verdicts: Sequence[Verdict]):
    """What came of every case, what the cases ask, and why the bounds are what they are, for a report."""
    from dmae.report import Section

    failed = [verdict for verdict in verdicts if not verdict.passed]
    return Section(
        f"{len(verdicts) - len(failed)} of {len(verdicts)} cases passed",
        "Every case is a file of numbers that does not change: pixels as cameras saw them, and the points that they "
        "saw. Errors are distances from those points.",
        tables=[
            verdict_table("Found / allowed", verdicts),
            Table("What is broken", ("case", "how"), [(v.case.name, str(v).partition(": ")[2]) for v in failed]),
            Table("What each case asks", ("case", ""), [(v.case.name, ASKS[v.case.name]) for v in verdicts]),
            Table("Why each bound is what it is", ("measure", ""), list(REASONS.items())),
        ],
    )
