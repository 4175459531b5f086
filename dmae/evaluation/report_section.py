"""Scores as a section of a report."""

from dmae.metrics.tables import score_tables
from dmae.reporting.figures import gaps_figure
from dmae.reporting.page import CaptionedFigure, Section


def scores_section(scores: dict) -> Section:
    """Return the tables of scores, and a figure of the error by length of gap.

    Args:
        scores: What `dmae.evaluation.evaluate.evaluate` returned, or its JSON.
    """
    poses = f" ({scores['poses']})" if "poses" in scores else ""
    return Section(
        f"Scores on {scores['recording']}{poses}",
        "Strict protocol: one-to-one matching within 0.5 m; a missed person or joint fails its limbs. Views are "
        "numbers of cameras; mean and worst are over all subsets of that many.",
        tables=score_tables(scores),
        figures=[CaptionedFigure("Mean error of hidden joints by how long they were hidden.", gaps_figure(scores))],
    )
