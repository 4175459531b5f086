"""Scores as tables: PCP, the columns of all metrics, errors by length of gap, and regions."""

from collections.abc import Callable, Iterable, Sequence

from dmae.data.clip import person_name
from dmae.metrics.angles import JUDGED
from dmae.metrics.registry import metrics
from dmae.reporting.tables import Table, number_text

_UNKNOWN = "not measured"
_COLUMN_TABLES = {"joints": "Joints of {} within 0.2 m", "identities": "Identities"}
"""Captions of the tables of the columns that metrics declare; `{}` stands for the skeleton."""


def score_tables(scores: dict) -> list[Table]:
    """Return the tables of scores from `evaluate`, or its JSON, with a row for each method and number of views.

    They are narrow enough, at up to four persons, for a terminal of 80 columns.
    """
    results = scores["results"]
    skeleton = scores["skeleton"]
    tables = [
        _pcp_table(results, skeleton),
        *(_columns_table(results, table, caption.format(skeleton)) for table, caption in _COLUMN_TABLES.items()),
        _gaps_table(results, skeleton, f" in {scores['poses']}" if "poses" in scores else ""),
    ]
    if stated := [each for each in results if any(gap["stated"] for gap in each["mean"]["gaps"])]:
        tables.append(_regions_table(stated))
    if turned := [each for each in results if each["mean"].get("angles")]:
        tables.append(_angles_table(turned))
    return tables


def overview(scores: dict) -> Table:
    """Return the table of the main figures, with a row for each method and number of views: PCP and mean errors."""
    caption = (
        f"Joints of {scores['skeleton']}. Strict PCP; unmeasured joints: PCK@0.2, in which unfilled joints are missed, "
        "and MPJPE, mm, of those that all methods filled, of all lengths and by frames, at 25/s, without a measurement"
    )

    def values(result: dict) -> list[str]:
        mean = result["mean"]
        errors = (compared_error(mean), *(gap["mpjpe"] for gap in mean["gaps"]))
        return [number_text(each) for each in (mean["pcp"], mean["hidden"]["recall"], *errors)]

    return _table(scores["results"], caption, ("PCP %", "PCK %", "all", *_lengths(scores["results"])), values)


def compared_error(mean: dict) -> float | None:
    """Return the MPJPE, mm, of the unmeasured joints that all methods filled; None where there are none.

    Over all joints that a method fills, one that leaves out the difficult ones would look better than it is.
    """
    filled = [gap for gap in mean["gaps"] if gap["filled"]]
    joints = sum(gap["filled"] for gap in filled)
    return sum(gap["filled"] * gap["mpjpe"] for gap in filled) / joints if joints else None


def _pcp_table(results: Sequence[dict], skeleton: str) -> Table:
    persons = [person_name(person) for person in range(len(results[0]["mean"].get("pcp_persons", ())))]
    return _table(
        results,
        f"Strict PCP on {skeleton}, %",
        ("mean", "worst", *persons),
        lambda each: (each["mean"]["pcp"], each["worst"]["pcp"], *each["mean"].get("pcp_persons", ())),
    )


def _columns_table(results: Sequence[dict], table: str, caption: str) -> Table:
    """Return the table of the columns that metrics declare; columns are empty for scores older than their metric."""
    columns = [(metric.name, column) for metric in metrics() for column in metric.columns if column.table == table]
    columns.sort(key=lambda each: each[1].order)
    units = dict.fromkeys(column.unit for _, column in columns if column.unit)
    captions = [
        f"{', '.join(column.heading for _, column in columns if column.unit == unit)} in {unit}" for unit in units
    ]
    return _table(
        results,
        f"{caption}: {'; '.join(captions)}",
        [column.heading for _, column in columns],
        lambda each: [column.value(each["mean"][name]) if name in each["mean"] else None for name, column in columns],
    )


def _gaps_table(results: Sequence[dict], skeleton: str, poses: str) -> Table:
    """Return the table of errors by length of gap; after the methods of each number of views, the compared joints."""
    caption = (
        f"MPJPE, mm, of joints of {skeleton} unmeasured{poses}, by frames at 25/s; only those that all methods filled"
    )
    rows: list[Sequence[str]] = []
    for views in dict.fromkeys(result["views"] for result in results):
        some = [result for result in results if result["views"] == views]
        columns = list(zip(*(result["mean"]["gaps"] for result in some), strict=True))
        # A method that fills few joints is matched in fewer frames, and then fewer joints are known to be hidden.
        counts = [(max(gap["filled"] for gap in column), max(gap["hidden"] for gap in column)) for column in columns]
        rows += _table(some, "", (), lambda each: [gap["mpjpe"] for gap in each["mean"]["gaps"]]).rows
        rows.append(("joints", str(views or "-"), *(f"{filled} of {hidden}" for filled, hidden in counts)))
    return Table(caption, ("method", "views", *_lengths(results)), rows)


def _regions_table(results: Sequence[dict]) -> Table:
    caption = (
        "True joints within the 90 % regions that methods state, widened by the error of a measured or annotated "
        "truth, %, by how long they were unmeasured"
    )
    return _table(results, caption, _lengths(results), lambda each: [gap["held"] for gap in each["mean"]["gaps"]])


def _angles_table(results: Sequence[dict]) -> Table:
    caption = (
        "Joint angles of the legs: mean absolute errors, degrees, share of angles that joints determine, share of "
        "true angles in the 90 % intervals, %, and expected calibration error"
    )
    if all(each["mean"]["angles"]["ankles"] is None for each in results):
        caption += "; ankles need joints of the feet, which skeleton=body25 has"

    def values(result: dict) -> list[str | float | None]:
        angles = result["mean"]["angles"]
        return [*map(angles.get, (*JUDGED, "determined", "held")), _text(angles["ece"], 2)]

    return _table(results, caption, (*JUDGED, "determined", "in 90 %", "ECE"), values)


def _lengths(results: Sequence[dict]) -> list[str]:
    return [gap["frames"] for gap in results[0]["mean"]["gaps"]]


def _table(
    results: Sequence[dict],
    caption: str,
    columns: Iterable[str],
    values: Callable[[dict], Iterable[str | float | None]],
) -> Table:
    rows = [
        (result["method"], str(result["views"] or "-"), *(_text(value) for value in values(result)))
        for result in results
    ]
    return Table(caption, ("method", "views", *columns), rows)


def _text(value: str | float | None, digits: int = 1) -> str:
    return value if isinstance(value, str) else _UNKNOWN if value is None else f"{value:.{digits}f}"
