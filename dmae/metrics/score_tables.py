"""Scores as tables: PCP, the columns of all metrics, errors by length of gap, and regions."""

from dmae.data.clip import person_name
from dmae.metrics.angles import JUDGED
from dmae.metrics.position import COVERAGES, LARGE
from dmae.metrics.registry import metrics
from dmae.reporting.tables import Table

_COLUMN_TABLES = {"joints": "Joints within 0.2 m", "identities": "Identities"}
"""Captions of the tables of the columns that metrics declare."""


def score_tables(scores: dict) -> list[Table]:
    """Return the tables of scores from `evaluate`, or its JSON, with a row for each method and number of views.

    They are narrow enough, at up to four persons, for a terminal of 80 columns.
    """
    results = scores["results"]
    means = [result["mean"] for result in results]
    firsts = [(result["method"], str(result["views"] or "-")) for result in results]
    lengths = [gap["frames"] for gap in means[0]["gaps"]]
    rows = list(zip(firsts, means, strict=True))
    tables = [_pcp_table(scores, firsts), *(_columns_table(rows, *each) for each in _COLUMN_TABLES.items())]
    poses = f" in {scores['poses']}" if "poses" in scores else ""
    tables.append(
        Table(
            f"MPJPE, mm, of joints unmeasured{poses}, by frames at 25/s; only those that all methods filled",
            ("method", "views", *lengths),
            [
                row
                for views in dict.fromkeys(views for _, views in firsts)
                for row in _gap_rows([(first, mean["gaps"]) for first, mean in rows if first[1] == views])
            ],
        )
    )
    regions = [
        (*first, *(_text(gap["held"]) for gap in mean["gaps"]))
        for first, mean in rows
        if any(gap["stated"] for gap in mean["gaps"])
    ]
    if regions:
        caption = (
            "True joints within the 90 % regions that methods state, widened by the error of a measured or annotated "
            "truth, %, by how long they were unmeasured"
        )
        tables.append(Table(caption, ("method", "views", *lengths), regions))
    turned = [(first, mean["angles"]) for first, mean in rows if mean.get("angles")]
    if turned:
        tables.append(_angles_table(turned))
    ranked = [(first, mean["ranking"]) for first, mean in rows if (mean.get("ranking") or {}).get("risk_100")]
    if ranked:
        tables.append(_ranking_table(ranked))
    return tables


def overview(scores: dict) -> Table:
    """Return the table of the main figures, with a row for each method and number of views: PCP and mean errors."""
    results = scores["results"]
    lengths = [gap["frames"] for gap in results[0]["mean"]["gaps"]]
    rows = [
        (
            result["method"],
            str(result["views"] or "-"),
            *(
                "-" if value is None else _text(value)
                for value in (
                    result["mean"]["pcp"], result["mean"]["hidden"]["recall"], compared_error(result["mean"]),
                    *(gap["mpjpe"] for gap in result["mean"]["gaps"]),
                )
            ),
        )
        for result in results
    ]  # fmt: skip
    caption = (
        "Strict PCP; unmeasured joints: PCK@0.2, in which unfilled joints are missed, and MPJPE, mm, of those that all "
        "methods filled, of all lengths and by frames, at 25/s, without a measurement"
    )
    return Table(caption, ("method", "views", "PCP %", "PCK %", "all", *lengths), rows)


def compared_error(mean: dict) -> float | None:
    """Return the MPJPE, mm, of the unmeasured joints that all methods filled; None where there are none.

    Over all joints that a method fills, one that leaves out the difficult ones would look better than it is.
    """
    filled = [gap for gap in mean["gaps"] if gap["filled"]]
    joints = sum(gap["filled"] for gap in filled)
    return sum(gap["filled"] * gap["mpjpe"] for gap in filled) / joints if joints else None


def _angles_table(turned: list[tuple[tuple[str, str], dict]]) -> Table:
    """Return the table of joint angles."""
    no_feet = all(score["ankles"] is None for _, score in turned)
    return Table(
        "Joint angles of the legs: mean absolute errors, degrees, share of angles that joints determine, share of true "
        "angles in the 90 % intervals, %, and expected calibration error"
        + ("; ankles need joints of the feet, which skeleton=body25 has" if no_feet else ""),
        ("method", "views", *JUDGED, "determined", "in 90 %", "ECE"),
        [
            (*first, *(_text(score[name]) for name in (*JUDGED, "determined", "held")), _text(score["ece"], 2))
            for first, score in turned
        ],
    )


def _ranking_table(ranked: list[tuple[tuple[str, str], dict]]) -> Table:
    """Return the table of how well stated uncertainty ranks unmeasured joints."""
    return Table(
        "Unmeasured joints ranked by stated uncertainty: rank correlation with the error, area under the curve for "
        f"errors over {LARGE:.0f} mm, and mm over the most certain share of them",
        ("method", "views", "Spearman", "AUC", *(f"{share} %" for share in COVERAGES)),
        [
            (
                *first,
                *(_text(score[name], 2) for name in ("spearman", "auc")),
                *(_text(score[f"risk_{share}"]) for share in COVERAGES),
            )
            for first, score in ranked
        ],
    )


def _pcp_table(scores: dict, firsts: list[tuple[str, str]]) -> Table:
    results = scores["results"]
    persons = [person_name(person) for person in range(len(results[0]["mean"].get("pcp_persons", ())))]
    cells = [
        (result["mean"]["pcp"], result["worst"]["pcp"], *result["mean"].get("pcp_persons", ())) for result in results
    ]
    return Table(
        f"Strict PCP on {scores['skeleton']}, %",
        ("method", "views", "mean", "worst", *persons),
        [(*first, *map(_text, row)) for first, row in zip(firsts, cells, strict=True)],
    )


def _columns_table(rows: list[tuple[tuple[str, str], dict]], table: str, caption: str) -> Table:
    """Return the table of the columns that metrics declare; columns are empty for scores older than their metric."""
    columns = [(metric.name, column) for metric in metrics() for column in metric.columns if column.table == table]
    columns.sort(key=lambda each: each[1].order)
    units = dict.fromkeys(column.unit for _, column in columns if column.unit)
    captions = [
        f"{', '.join(column.heading for _, column in columns if column.unit == unit)} in {unit}" for unit in units
    ]
    return Table(
        f"{caption}: {'; '.join(captions)}",
        ("method", "views", *(column.heading for _, column in columns)),
        [
            (*first, *(_text(column.value(mean[name]) if name in mean else None) for name, column in columns))
            for first, mean in rows
        ],
    )


def _gap_rows(gaps: list[tuple[tuple[str, str], list[dict]]]) -> list[tuple[str, ...]]:
    """Return the rows of the methods with one number of views, and a row with the number of compared joints."""
    columns = list(zip(*(entries for _, entries in gaps), strict=True))
    # A method that fills few joints is matched in fewer frames, and then fewer joints are known to be hidden.
    counts = [(max(gap["filled"] for gap in column), max(gap["hidden"] for gap in column)) for column in columns]
    return [
        *((*first, *(_text(gap["mpjpe"]) for gap in entries)) for first, entries in gaps),
        ("joints", gaps[0][0][1], *(f"{filled} of {hidden}" for filled, hidden in counts)),
    ]


def _text(value: float | None, digits: int = 1) -> str:
    return "not measured" if value is None else f"{value:.{digits}f}"
