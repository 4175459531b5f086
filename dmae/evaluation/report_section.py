"""Scores as a section of a report."""

from pathlib import Path

from dmae.files.structured import read_json
from dmae.metrics.tables import score_tables
from dmae.reporting.figures import gaps_figure
from dmae.reporting.page import CaptionedFigure, Section


def read_scores(path: Path) -> dict:
    """Return the scores in a file that `dmae evaluate` wrote.

    Raises:
        FileNotFoundError: the file does not exist.
        ValueError: the file does not contain scores, or lacks entries that `scores_section` shows.
    """
    scores = read_json(path)
    try:
        scores_section(scores)
    except (KeyError, TypeError, AttributeError, IndexError, ValueError, OverflowError) as error:
        raise ValueError(f"{path}: expected scores that dmae evaluate wrote, {error!r:.200}") from None
    return scores


def scores_section(scores: dict) -> Section:
    """Return the tables of scores, and a figure of the error by length of gap.

    Args:
        scores: Result of `dmae.evaluation.evaluate.evaluate`, or its JSON.
    """
    poses = f" ({scores['poses']})" if "poses" in scores else ""
    return Section(
        f"Scores on {scores['recording']}{poses}",
        "Strict protocol: one-to-one matching within 0.5 m; a missed person or joint fails its limbs. Views are "
        "numbers of cameras; mean and worst are over all subsets of that many.",
        tables=score_tables(scores),
        figures=[CaptionedFigure("Mean error of hidden joints by how long they were hidden.", gaps_figure(scores))],
    )
