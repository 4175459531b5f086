"""The page of a data set: its contents in words, tables and one figure."""

import json
from pathlib import Path

import numpy as np

from dmae.data.labels import Visibility
from dmae.data.store import MANIFEST, read_manifest, write_atomic
from synth.datasets.statistics.contacts import spread
from synth.datasets.statistics.histograms import QUANTITIES, Statistics, measure
from synth.datasets.statistics.picture import draw
from synth.datasets.statistics.terms import terms

PAGE, PICTURE, NUMBERS = "README.md", "statistics.png", "statistics.json"
FORMAT = 1
_HIDDEN = (Visibility.HIDDEN_BY_SELF, Visibility.HIDDEN_BY_PERSON, Visibility.HIDDEN_BY_OBJECT)
_OCCLUDERS = 12
"""Greatest number of listed occluders."""


def describe(data: Path | list[Path], out: Path, *, workers: int = 1) -> Statistics:
    """Write the page of data sets, its figure, and the numbers of both.

    Args:
        data: The data set or clip, or several.
        out: Folder to write; it must not exist, be empty, or contain an earlier page.
        workers: Processes; -1 for one per core.

    Raises:
        FileNotFoundError: there is neither a clip nor a data set.
        ValueError: the folder contains something else, or a clip is damaged.
    """
    data, out = [Path(path) for path in (data if isinstance(data, list) else [data])], Path(out)
    if workers == 0:
        raise ValueError("workers: expected a number of processes, or -1 for one per core; got 0")
    if out.is_dir() and any(out.iterdir()) and not (out / NUMBERS).is_file():
        raise ValueError(
            f"{out}: expected no such folder, an empty one, or one with an earlier {NUMBERS}; choose another out"
        )
    found = measure(data, workers=workers)
    lines = [line for path in data if (path / MANIFEST).is_file() for line in read_manifest(path)]
    failed = sum(line["status"] != "ok" for line in lines)
    picture = draw(found)
    write_atomic(out / PICTURE, picture)
    write_atomic(out / PAGE, page(found, ", ".join(path.resolve().name for path in data), failed))
    write_atomic(out / NUMBERS, json.dumps(numbers(found, failed), indent=1))
    return found


def numbers(found: Statistics, failed: int) -> dict:
    """Return the statistics for JSON."""
    histograms = {
        name: {"unit": QUANTITIES[name].unit, "edges": QUANTITIES[name].edges.tolist(), "counts": counts.tolist()}
        for name, counts in found.histograms.items()
    }
    causes = {} if found.causes is None else {
        joint: dict(zip((cause.name.lower() for cause in Visibility), row, strict=True))
        for joint, row in zip(found.joints, found.causes.tolist(), strict=True)
    }  # fmt: skip
    return {
        "format": FORMAT,
        "counts": dict(found.counts) | {"clips_failed": failed},
        "different": {"persons": len(found.persons), "takes": len(found.takes), "rigs": len(found.rigs)},
        "scenes": dict(found.scenes),
        "contacts": {kind: spread(clips) for kind, clips in sorted(found.contacts.items())},
        "occlusion": causes,
        "occluders": dict(found.occluders),
        "histograms": histograms,
    }


def page(found: Statistics, name: str, failed: int) -> str:
    """Return the page in Markdown."""
    counts = found.counts
    rows = [
        ("clips", f"{counts['clips']}{f', and {failed} that failed' if failed else ''}"),
        ("frames", f"{counts['frames']}, {counts['seconds']:.0f} s"),
        ("views of frames", str(counts["pictures"])),
        ("clips by persons", _listed(counts, "persons=")),
        ("clips by cameras", _listed(counts, "cameras=")),
        *((f"clips by {key}", _listed(found.scenes, f"{key}=")) for key in ("arena", "motion", "interaction")),
        ("different persons, motions, rigs", ", ".join(str(len(x)) for x in (found.persons, found.takes, found.rigs))),
    ]
    if counts["clips_without_truth"]:
        rows.append(("clips without truth", f"{counts['clips_without_truth']}; nothing below is of them"))
    parts = [
        f"# {name}\n\nSimulated people who hide each other: clips of calibrated cameras with exact joints.",
        f"![Histograms]({PICTURE})",
        _table(("", ""), rows),
        "## Occlusion\n\n" + _occlusion(found),
        "## Contacts between people\n\n" + _contacts(found),
        "## Quantities\n\n" + _quantities(found),
        "## Rights\n\n" + terms(found),
    ]
    return "\n\n".join(parts) + "\n"


def _listed(counts, prefix: str) -> str:
    found = {key.removeprefix(prefix): count for key, count in counts.items() if key.startswith(prefix)}
    order = sorted(found, key=lambda key: (not key.isdigit(), int(key) if key.isdigit() else 0, key))
    return ", ".join(f"{key}: {found[key]}" for key in order) or "not known"


def _table(head: tuple[str, ...], rows: list[tuple[str, ...]]) -> str:
    lines = [head, ("---",) * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _occlusion(found: Statistics) -> str:
    """Return a table of joints by cause of occlusion, and a table of occluders."""
    if found.causes is None:
        return "Not measured: the clips have no labels of visibility."
    judged = found.causes[:, : Visibility.ABSENT]
    total = judged.sum()
    if not total:
        return "Not measured: no clip contains a person."
    rows = [
        (joint.replace("_", " "), *(f"{share:.0%}" for share in row / max(1, row.sum())))
        for joint, row in [("all", judged.sum(0)), *zip(found.joints, judged, strict=True)]
    ]
    head = ("joint", *(cause.name.lower().replace("_", " ") for cause in Visibility if cause != Visibility.ABSENT))
    hidden = judged[:, _HIDDEN].sum()
    by = [(name, f"{count / max(1, hidden):.0%}") for name, count in found.occluders.most_common(_OCCLUDERS) if count]
    return (
        "Share of joints in views, of persons who are in the scene.\n\n"
        + _table(head, rows)
        + f"\n\nWhat hides the {hidden} hidden joints:\n\n"
        + _table(("occluder", "of the hidden joints"), by)
    )


def _contacts(found: Statistics) -> str:
    """Return a table of contacts by interaction."""
    if not found.contacts:
        return "Not measured: no clip has the state of its bodies."
    return (
        "Share of frames in which a person touches another, number of touches, and greatest force in such a frame; of "
        "clips the least, the median and the greatest.\n\n" + _table(CONTACT_HEAD, contact_rows(numbers(found, 0)))
    )


CONTACT_HEAD = ("interaction", "clips", "frames in contact", "touches", "force, N")


def contact_rows(kept: dict) -> list[tuple[str, ...]]:
    """Return the rows of the table of contacts, from the content of `statistics.json`."""

    def three(row: dict, name: str, style: str) -> str:
        return " / ".join(format(row[f"{name}_{which}"], style) for which in ("least", "median", "most"))

    return [
        (kind, str(row["clips"]), three(row, "share", ".0%"), three(row, "touches", ".0f"), three(row, "force", ".0f"))
        for kind, row in kept["contacts"].items()
    ]


def _quantities(found: Statistics) -> str:
    rows = []
    for name, quantity in QUANTITIES.items():
        counts = found.histograms.get(name)
        if counts is None or not counts.sum():
            rows.append((quantity.meaning, quantity.unit, "not measured", "", ""))
            continue
        rows.append((quantity.meaning, quantity.unit, *(f"{value:.3g}" for value in quantiles(counts, quantity.edges))))
    return "Precision is the bin width of the histograms in `statistics.json`.\n\n" + _table(
        ("quantity", "unit", "5 % below", "median", "95 % below"), rows
    )


def quantiles(counts: np.ndarray, edges: np.ndarray, shares: tuple[float, ...] = (0.05, 0.5, 0.95)) -> list[float]:
    """Return the approximate quantiles of a histogram (N,): the middles of the bins that reach these shares."""
    reached = np.cumsum(counts) / counts.sum()
    bins = [int(np.searchsorted(reached, share - 1e-9)) for share in shares]
    return [float((edges[each] + edges[each + 1]) / 2) for each in bins]
