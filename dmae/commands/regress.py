"""`dmae regress`: any project's triangulation against the pack of `dmae.regression`."""

import sys
from collections.abc import Sequence
from pathlib import Path

from dmae.commands.config import RegressCommand
from dmae.regression.verdicts import PURPOSES, REASONS, Verdict, check, text
from dmae.reporting.page import Section, write_report
from dmae.reporting.tables import Table, print_tables


def run(config: RegressCommand, out: Path | None) -> None:
    """Print what came of every case; exits with status 1 if a bound is broken."""
    verdicts = check(config.solver, config.skip, config.seconds)
    failed = [verdict for verdict in verdicts if not verdict.passed]
    problems = {verdict.problem for verdict in verdicts}
    if len(verdicts) > 1 and len(problems) == 1 and all(problems):
        # A table without numbers and the same line for each case would say no more.
        print(f"{config.solver}: every case: {problems.pop()}")
    else:
        print_tables([verdict_table(config.solver, verdicts)])
        print(*failed, sep="\n", end="\n\n" if failed else "")
    if config.report:
        write_report(Path(config.report), f"Triangulation by {config.solver}", [regress_section(verdicts)])
        print(config.report)
    skipped = f", {len(config.skip)} skipped" if config.skip else ""
    print(f"{len(verdicts) - len(failed)} of {len(verdicts)} cases passed{skipped}")
    if failed:
        sys.exit(1)


def verdict_table(name: str, verdicts: Sequence[Verdict]) -> Table:
    """Return a row for each case: the measures, and after a slash their bounds."""
    return Table(
        f"{name}: errors in mm, refused in % / what is allowed",
        ("case", *REASONS, ""),
        [
            (verdict.case.name, *(_cell(verdict, measure) for measure in REASONS), "ok" if verdict.passed else "FAIL")
            for verdict in verdicts
        ],
    )


def _cell(verdict: Verdict, measure: str) -> str:
    if measure not in verdict.measured:
        return "-"
    values = [found[measure] for found in (verdict.measured, verdict.bounds) if measure in found]
    return "/".join(text(measure, value).removesuffix(" mm").removesuffix("%") for value in values)


def regress_section(verdicts: Sequence[Verdict]) -> Section:
    """Return the results, the purposes of the cases and the reasons of the bounds, for a report."""
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
