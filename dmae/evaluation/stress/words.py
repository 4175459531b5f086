"""Results of a stress matrix, in words and tables."""

from collections import Counter
from collections.abc import Sequence

from dmae.evaluation.stress.curves import HIDDEN_ERROR, PCP_DROP
from dmae.reporting.tables import Table
from dmae.reporting.words import counted

_REFERENCES = {
    "truth": "Results are compared with the truth of the clips.",
    "capture": "The clips have no truth. Results are compared with the joints that all cameras measured in three views "
    "or more before anything was corrupted.",
}


def summary(result: dict) -> list[str]:
    """Return the results in sentences: the comparison, the axes on which methods do not break, and the best method."""
    clips, axes = result["clips"], result["axes"]
    sentences = [
        f"{counted(len(result['methods']), 'method')} on {counted(len(clips), 'clip')} ({_listed(clips)}), "
        f"{counted(len(axes), 'kind')} of corruption. {_REFERENCES[result['reference']]}"
    ]
    broken = Counter({axis["name"]: len(axis["methods"]) - len(_unbroken(axis)) for axis in axes})
    if worst := [f"{name} ({number})" for name, number in broken.most_common(3) if number]:
        sentences.append(f"What breaks most methods: {_listed(worst)}.")
    harmless = [axis["name"] for axis in axes if _unbroken(axis) == set(axis["methods"])]
    if harmless:
        sentences.append(f"Every method holds over the whole range of {_listed(harmless)}.")
    held = [f"{name} {sum(name in _unbroken(axis) for axis in axes)}" for name in result["methods"]]
    sentences.append(f"Of {counted(len(axes), 'kind')}, each method holds over the whole range of: {', '.join(held)}.")
    alone = [axis for axis in axes if axis["best"] and axis["level_with"] == [] and len(axis["methods"]) > 1]
    best = Counter(axis["best"] for axis in alone)
    for name, number in best.most_common():
        sentences.append(f"At the greatest level, {name} is better than every other method, beyond noise, on {number}.")
    level = sum(bool(axis["level_with"]) for axis in axes)
    if level:
        sentences.append(f"On {level}, other methods are within noise of the best.")
    if any(axis["level_with"] is None for axis in axes):
        sentences.append("The clips are too short for intervals: expected five seconds or more in all.")
    return sentences


def breaking_tables(result: dict) -> list[Table]:
    """Return two tables of the levels at which methods break, by PCP and by hidden joints, with a row for each axis."""
    captions = {
        "pcp": f"Level at which PCP is {PCP_DROP:g} points below that of the same method on the uncorrupted clips",
        "hidden": f"Level at which the mean error of hidden joints passes {HIDDEN_ERROR:g} mm",
    }
    return [
        Table(
            f"{caption}, with 95 % interval; > is beyond the range",
            ("corruption", "unit", *result["methods"]),
            [
                (axis["name"], axis["unit"], *(_break(axis, name, figure) for name in result["methods"]))
                for axis in result["axes"]
            ],
        )
        for figure, caption in captions.items()
    ]


def best_table(result: dict) -> Table:
    """Return a table of the best method at the greatest level of each axis."""
    rows = []
    for axis in result["axes"]:
        points = [method["points"][-1] for method in axis["methods"].values()]
        best = axis["best"] and axis["methods"][axis["best"]]["points"][-1]["pcp"]
        near = axis["level_with"]
        others = "not known" if near is None else _listed(near) if near else "no other method" if axis["best"] else ""
        rows.append((axis["name"], f"{points[0]['level']:g} {axis['unit']}", axis["best"] or "-", _value(best), others))
    header = ("corruption", "greatest level", "best", "PCP %", "within noise of it")
    return Table("The best method by PCP at the greatest level", header, rows)


def pair_tables(result: dict) -> list[Table]:
    """Return a table of PCP for each pair of axes, a row for each two levels."""
    return [
        Table(
            f"PCP, %, with both {pair['names'][0]} ({pair['units'][0]}) and {pair['names'][1]} ({pair['units'][1]})",
            (*pair["names"], *result["methods"]),
            [
                (
                    *(f"{level:g}" for level in point["levels"]),
                    *(_value(each["pcp"]) for each in point["methods"].values()),
                )
                for point in pair["points"]
            ],
        )
        for pair in result["pairs"]
    ]


def breaking_sentence(axis: dict) -> str:
    """Return a sentence with the level at which each method breaks on an axis."""
    breaks = {name: method["breaks"]["pcp"] for name, method in axis["methods"].items()}
    broken = [name for name, found in breaks.items() if found and found[0] is not None]
    parts = [f"{name} breaks at {_break(axis, name, 'pcp')}" for name in broken]
    if held := [name for name in breaks if name in _unbroken(axis)]:
        parts.append(f"{_listed(held)} hold{'s' if len(held) == 1 else ''} over the whole range")
    if unknown := [name for name, found in breaks.items() if found is None]:
        parts.append(f"not measured: {_listed(unknown)}")
    return f"By PCP, in {axis['unit']}: {'; '.join(parts)}."


def _unbroken(axis: dict) -> set[str]:
    breaks = {name: method["breaks"]["pcp"] for name, method in axis["methods"].items()}
    return {name for name, found in breaks.items() if found is not None and found[0] is None}


def _break(axis: dict, name: str, figure: str) -> str:
    method = axis["methods"][name]
    found, most = method["breaks"][figure], method["points"][-1]["level"]
    if found is None:
        return "-"
    level, low, high = (f"> {most:g}" if value is None else f"{value:.2g}" for value in found)
    return level if found[1] is None else f"{level} ({low} to {high})"


def _value(interval: Sequence[float | None] | None) -> str:
    if not interval or interval[0] is None:
        return "-"
    value, low, high = interval
    return f"{value:.1f}" if low is None else f"{value:.1f} ({low:.1f} to {high:.1f})"


def _listed(names: Sequence[str], most: int = 8) -> str:
    shown = [*names[:most], *([f"{len(names) - most} more"] if len(names) > most else [])]
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"
