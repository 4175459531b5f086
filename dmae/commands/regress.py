"""`dmae regress`: any project's triangulation against the pack of `dmae.regression`."""

import inspect
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dmae.plugins import load_function
from dmae.regression.pack import cases
from dmae.regression.verdicts import PURPOSES, REASONS, SECONDS, Verdict, check, text
from dmae.reporting.tables import Table, print_tables

WRITES = None
EXAMPLES = (
    "dmae regress solver=dmae.regression.solvers:ours",
    "dmae regress solver=my_module:triangulate skip=[] report=runs/regress.html",
)


@dataclass(frozen=True)
class RegressCommand:
    """Check any triangulation against a fixed set of cases. Exits with status 1 if a bound is broken.

    The solver is a plain function of keyword arrays (numpy is sufficient):

        def solver(*, K, dist, cam_from_world, size, xy, confidence): return xyz

        K (V, 3, 3) px; dist (V, 5) or (V, 8), OpenCV's k1 k2 p1 p2 k3 [k4 k5 k6], zeros for a pinhole;
        cam_from_world (V, 4, 4), OpenCV cameras (x right, y down, z forward), m; size (V, 2) width, height;
        xy (n, V, 2) pixels as detected, distorted, NaN where a view has none, (0, 0) the centre of the first pixel;
        confidence (n, V) in [0, 1], NaN where a view is not used; xyz (n, 3) m, NaN where the solver refuses. Rows are
        independent.

    To start from: dmae.regression.solvers:ours, :dlt, :opencv. In pytest: the fixture check_triangulation.
    """

    solver: str = "???"
    """package.module:function; the current folder is searched first."""
    skip: list[str] = field(default_factory=list)
    """Names of cases to skip."""
    seconds: float = SECONDS
    """s; time limit for one case."""
    report: str | None = None
    """An HTML page to write."""


def run(config: RegressCommand, out: Path | None) -> None:
    """Print what came of every case; exits with status 1 if a bound is broken."""
    verdicts = check(load_solver(config.solver), config.skip, config.seconds)
    print_tables([verdict_table(config.solver, verdicts)])
    failed = [verdict for verdict in verdicts if not verdict.passed]
    print(*failed, sep="\n", end="\n\n" if failed else "")
    if config.report:
        from dmae.reporting.page import write_report

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
    solver = load_function("solver", name, "dmae.regression.solvers:ours")
    keywords = cases()[0].arrays()
    try:
        inspect.signature(solver).bind(**keywords)
    except TypeError as error:
        raise ValueError(
            f"solver={name}: {error}; expected a function of the keywords {', '.join(keywords)} that returns (n, 3) "
            f"points, found {name.partition(':')[2]}{inspect.signature(solver)}"
        ) from None
    except ValueError:
        pass  # compiled functions may have no signature
    return solver


def verdict_table(name: str, verdicts: Sequence[Verdict]) -> Table:
    """Return a row for each case: the measures, and after a slash their bounds."""
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
    """Return the results, the purposes of the cases and the reasons of the bounds, for a report."""
    from dmae.reporting.page import Section

    failed = [verdict for verdict in verdicts if not verdict.passed]
    return Section(
        f"{len(verdicts) - len(failed)} of {len(verdicts)} cases passed",
        "Every case is a file of numbers that never changes: detected pixels, and the true points. Errors are "
        "distances from those points.",
        tables=[
            verdict_table("Found / allowed", verdicts),
            Table(
                "Bounds that are exceeded", ("case", "how"), [(v.case.name, str(v).partition(": ")[2]) for v in failed]
            ),
            Table("What each case tests", ("case", ""), [(v.case.name, PURPOSES[v.case.name]) for v in verdicts]),
            Table("Reasons of the bounds", ("measure", ""), list(REASONS.items())),
        ],
    )
