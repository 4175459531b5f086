"""What `dmae.evaluate` found, as tables: for a terminal, a pipe, or a report."""

from collections.abc import Sequence
from dataclasses import dataclass

import rich.table
from rich.box import SIMPLE
from rich.console import Console


@dataclass(frozen=True)
class Table:
    """Cells are written as they are; format numbers first."""

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


def tables(scores: dict) -> list[Table]:
    """PCP, errors, errors by length of gap, and how far stated covariances are right; a row for each method and number
    of views.

    Narrow enough, at up to four persons, for a terminal of 80 columns.

    Args:
        scores: What `dmae.evaluate.evaluate` returned, or what was read back from its JSON.
    """
    means = [result["mean"] for result in scores["results"]]
    firsts = [(result["method"], str(result["views"] or "-")) for result in scores["results"]]
    worst = [result["worst"]["pcp"] for result in scores["results"]]
    lengths = [gap["frames"] for gap in means[0]["gaps"]]
    held = [
        (*first, *(_text(gap["held"]) for gap in mean["gaps"]))
        for first, mean in zip(firsts, means, strict=True)
        if any(gap["stated"] for gap in mean["gaps"])
    ]
    caption = "True joints within the 90 % regions that methods state, %, by how long they were hidden"
    regions = [Table(caption, ("method", "views", *lengths), held)] if held else []
    persons = [f"person {person}" for person in range(len(means[0].get("pcp_persons", ())))]
    return [
        Table(
            f"Strict PCP on {scores['skeleton']}, %",
            ("method", "views", "mean", "worst", *persons),
            [
                (*first, *map(_text, (mean["pcp"], low, *mean.get("pcp_persons", ()))))
                for first, mean, low in zip(firsts, means, worst, strict=True)
            ],
        ),
        Table(
            "PCK@0.2, joints and IDF1, %; MPJPE, mm",
            (
                "method",
                "views",
                "recall",
                "precision",
                "filled",
                "absent",
                "MPJPE",
                "seen",
                "hidden",
                "switches",
                "IDF1",
            ),
            [(*first, *map(_text, _errors(mean))) for first, mean in zip(firsts, means, strict=True)],
        ),
        Table(
            "MPJPE, mm, of joints hidden for so many frames at 25/s, those that all methods filled",
            ("method", "views", *lengths),
            [
                row
                for views in dict.fromkeys(views for _, views in firsts)
                for row in _gap_rows(
                    [(first, mean["gaps"]) for first, mean in zip(firsts, means, strict=True) if first[1] == views]
                )
            ],
        ),
        *regions,
    ]


def _errors(mean: dict) -> list[float | None]:
    kinds = mean["mpjpe"]
    return [
        mean["pck"]["recall"],
        mean["pck"]["precision"],
        mean["shares"]["completed"],
        mean["shares"]["absent"],
        kinds["all"],
        kinds["measured"] if kinds["denoised"] is None else kinds["denoised"],
        mean["hidden"]["mpjpe"],
        mean["identity_switches"],
        mean.get("idf1"),
    ]


def _gap_rows(gaps: list[tuple[tuple[str, str], list[dict]]]) -> list[tuple[str, ...]]:
    """Rows of the methods with one number of views, and one that tells how many joints they are compared on."""
    columns = list(zip(*(entries for _, entries in gaps), strict=True))
    # A method that fills little is matched in fewer frames, and then less is known to be hidden.
    counts = [(max(gap["filled"] for gap in column), max(gap["hidden"] for gap in column)) for column in columns]
    return [
        *((*first, *(_text(gap["mpjpe"]) for gap in entries)) for first, entries in gaps),
        ("joints", gaps[0][0][1], *(f"{filled} of {hidden}" for filled, hidden in counts)),
    ]


def _text(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def print_tables(tables: Sequence[Table]) -> None:
    """Print tables; in a pipe as plain text, every cell in full."""
    console = Console()
    if not console.is_terminal:
        console = Console(width=1000)
    for table in tables:
        drawn = rich.table.Table(title=table.caption, title_justify="left", box=SIMPLE, padding=0)
        for column, heading in enumerate(table.header):
            drawn.add_column(heading, justify="right" if column else "left", no_wrap=True)
        for row in table.rows:
            drawn.add_row(*row)
        console.print(drawn)
