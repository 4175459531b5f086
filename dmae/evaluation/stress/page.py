"""The page of a stress matrix: the results in words, then tables and curves."""

from pathlib import Path

from dmae.data.json_values import json_text
from dmae.data.store import write_atomic
from dmae.evaluation.corruption.registry import find_corruption
from dmae.evaluation.stress.curves import HIDDEN_ERROR, PCP_DROP
from dmae.evaluation.stress.figures import axis_figure
from dmae.evaluation.stress.words import best_table, breaking_sentence, breaking_tables, pair_tables, summary
from dmae.reporting.page import CaptionedFigure, Section, write_report
from dmae.reporting.tables import Table

_MEASURED = (
    "Strict PCP, one-to-one matching within 0.5 m. Hidden joints are the joints that the capture of the method did "
    "not measure, of people that it found; the error is over the hidden joints that the method filled. Intervals are "
    "of 95 %, from resampled whole seconds; they describe other moments of these clips, not other clips. Level 0 is "
    f"the original clip. A method breaks where its PCP is {PCP_DROP:g} points below its own at level 0, or where the "
    f"mean error of hidden joints exceeds {HIDDEN_ERROR:g} mm, interpolated linearly between levels."
)


def write_result(result: dict, out: Path) -> None:
    """Write `stress.json` and the page `stress.html`.

    Args:
        result: Result of `dmae.evaluation.stress.matrix.compute`.
        out: Output folder.
    """
    write_atomic(out / "stress.json", json_text(result))
    compared, *found = summary(result)
    paragraphs = [compared, " ".join(found)]
    write_report(out / "stress.html", "What breaks the methods", sections(result), summary=paragraphs)


def sections(result: dict) -> list[Section]:
    """Return the sections of the page."""
    found = [
        Section("Where methods break", tables=[*breaking_tables(result), best_table(result)]),
        *(_axis_section(axis) for axis in result["axes"]),
    ]
    if result["pairs"]:
        found.append(Section("Two corruptions", "PCP with two corruptions together.", tables=pair_tables(result)))
    methods = Table("Methods", ("method", "description"), list(result["methods"].items()))
    found.append(Section("How this was measured", " ".join([_MEASURED, *result["notes"]]), tables=[methods]))
    return found


def _axis_section(axis: dict) -> Section:
    caption = f"{axis['about']} Bands are 95 % intervals."
    return Section(
        axis["name"],
        f"{_documentation(axis)} {breaking_sentence(axis)}",
        figures=[CaptionedFigure(caption, axis_figure(axis))],
    )


def _documentation(axis: dict) -> str:
    """Return the first two paragraphs of a corruption's docstring, or its line of help if it is not installed."""
    try:
        text = find_corruption(axis["name"]).function.__doc__
    except ValueError:
        return axis["about"]
    return " ".join(" ".join(text.split("\n\n")[:2]).split())
