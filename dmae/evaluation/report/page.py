"""The page of one or more clips and of scores."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip, Source
from dmae.evaluation.report.findings import Findings, State, examine
from dmae.evaluation.report.sections import (
    breakdown_sections,
    clips_section,
    doubts_section,
    moments_section,
    residuals_section,
    uncertainty_section,
)
from dmae.evaluation.report.summary import summary
from dmae.evaluation.report_section import scores_section
from dmae.progress import progress
from dmae.reporting.page import write_report
from dmae.reporting.player import Played, player_data, window

TITLE = "Multi-view motion: measured and completed"
MOST_CLIPS = 6
"""Greatest number of clips in the player."""
MOST_FRAMES = 4500
"""Frames of all clips in the player together: three minutes at 25 frames/s."""


def write_clips_report(
    path: Path, clips: Sequence[Clip] | None, scores: Sequence[dict] = (), *, title: str = TITLE
) -> list[Findings]:
    """Write the report of clips, captured or not, and of scores, as one HTML file that loads nothing from elsewhere.

    Clips are read one at a time, so that memory does not grow with their number. Clips in the player are read twice.

    Args:
        path: The file to write.
        clips: Any number of clips; None for a page with scores only.
        scores: Scores that `dmae evaluate` wrote.
        title: Heading of the page.

    Returns:
        The findings of each clip, in order.
    """
    findings = [examine(clip) for clip in progress(clips or (), "reporting")]
    shown = _worst_clips(findings)
    most = MOST_FRAMES // max(1, len(shown))
    cuts = {index: window(findings[index].frames, most, _worst_frame(findings[index])) for index in shown}
    ranges = {findings[index].id: range(cut.start, cut.stop) for index, cut in cuts.items()}
    sections = [
        *clips_section(findings, ranges),
        *moments_section(findings, ranges),
        *doubts_section(findings, ranges),
        *breakdown_sections(findings),
        *uncertainty_section(findings),
        *residuals_section(findings),
        *(scores_section(each) for each in scores),
    ]
    write_report(
        path,
        title,
        sections,
        summary=() if clips is None else summary(findings),
        players=[player_data(_played(clips[index], findings[index], cut)) for index, cut in cuts.items()],
    )
    return findings


def _worst_clips(findings: Sequence[Findings]) -> list[int]:
    """Return the sorted indices of the clips that have the worst frames.

    These are the frames with the largest errors or, without truth, with the fewest measured joints.
    """

    def badness(index: int) -> tuple[float, float]:
        each = findings[index]
        mean = each.against_truth["all"].mean if each.against_truth else None
        return (mean or 0.0, each.share(Source.ABSENT, Source.COMPLETED) or 0.0)

    filled = [index for index, each in enumerate(findings) if each.state != State.empty]
    return sorted(sorted(filled, key=badness, reverse=True)[:MOST_CLIPS])


def _worst_frame(findings: Findings) -> int:
    if findings.error is not None and np.isfinite(findings.error).any():
        return int(np.nanargmax(findings.error))
    return findings.moments[0].frame if findings.moments else 0


def _played(clip: Clip, findings: Findings, cut: slice) -> Played:
    notes = []
    if findings.state == State.not_captured:
        shown = "detections and its truth" if clip.truth else "detections"
        notes.append(f"Not captured yet: run dmae capture. These are its {shown}.")
    if findings.state == State.no_person:
        notes.append("Capture found no person in this clip.")
    if cut.stop - cut.start < findings.frames:
        notes.append(f"The clip is long: the player shows frames {cut.start} to {cut.stop - 1} of {findings.frames}.")
    error = None if findings.error is None else findings.error[cut]
    return Played(clip.select(frames=cut), cut.start, error, tuple(notes))
