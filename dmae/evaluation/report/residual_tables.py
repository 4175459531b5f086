"""Tables of reprojection errors by camera, person and joint."""

from collections.abc import Sequence

from dmae.evaluation.report.joint_groups import JointGroup
from dmae.reporting.tables import Table

Groups = dict[str, dict[str, JointGroup]]
"""Tallies by breakdown and group."""
BREAKDOWNS = ("camera", "person", "joint")


def residual_tables(measured: Groups, completed: Groups, names: Sequence[str] = BREAKDOWNS) -> list[Table]:
    """Return a table for each breakdown: of joints with a detection, how far they reproject from it, px.

    Args:
        measured, completed: Errors of measured and of completed joints, as in `Reprojection`. Columns of completed
            joints are left out where there are none.
        names: Breakdowns.
    """
    some_completed = any(each.compared for groups in completed.values() for each in groups.values())
    tables = []
    for name in (name for name in names if name in measured):
        rows = []
        for group, each in measured[name].items():
            other = completed.get(name, {}).get(group)
            if each.compared or (other and other.compared):
                row = (group, f"{each.compared:,}", *(_pixels(part) for part in (each.mean, each.quantile(0.5),
                       each.quantile(0.9))))  # fmt: skip
                more = (f"{other.compared:,}" if other else "0", _pixels(other and other.mean))
                rows.append(row + more if some_completed else row)
        header = (name, "measured", "mean px", "median px", "90 % under")
        if some_completed:
            header += ("completed", "completed mean px")
        if rows:
            tables.append(Table(f"By {name}", header, rows, bars=(2, 6) if some_completed else (2,)))
    return tables


def _pixels(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"
