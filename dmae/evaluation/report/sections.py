"""The sections of the report: worst moments, errors by group, uncertainty, reprojection, and the clips."""

from collections.abc import Collection, Sequence

import numpy as np
from matplotlib.figure import Figure

from dmae.data.clip import Source
from dmae.evaluation.report.breakdown import BY_CAUSE, BY_GAP, BY_JOINT, BY_MEASURING, BY_SEEING
from dmae.evaluation.report.findings import Findings
from dmae.evaluation.report.joint_groups import JointGroup
from dmae.evaluation.report.moments import WorstMoment
from dmae.evaluation.report.pooled import pooled_groups, pooled_regions, pooled_truth
from dmae.evaluation.report.residual_tables import residual_tables
from dmae.evaluation.report.stated_uncertainty import PROBABILITIES
from dmae.evaluation.review.decisions import DECISIONS, FORMAT, ReviewVerdict
from dmae.reporting.figures import COMPLETED, PERSONS
from dmae.reporting.page import CaptionedFigure, Section
from dmae.reporting.tables import Choices, Moment, Table

_KINDS = {
    "error": "Largest errors of a joint",
    "missed": "True people without a captured one",
    "not measured": "Frames with the fewest measured joints of a person",
    "reprojection": "Measured joints farthest from their detection",
}
_MOST_MOMENTS = 8
"""Rows of each table of moments."""


def clips_section(findings: Sequence[Findings], played: Collection[str]) -> list[Section]:
    """Return the table of clips, if there are several. Its rows open the clips that the player contains."""
    if len(findings) < 2:
        return []
    rows = []
    for each in findings:
        residual = each.residuals.get("all", {}).get("all")
        shares = [
            each.share(*kinds) for kinds in ((Source.MEASURED, Source.DENOISED), (Source.COMPLETED,), (Source.ABSENT,))
        ]
        errors = [each.against_truth.get(name) for name in ("all", "completed")]
        rows.append(
            (
                each.id,
                str(each.state),
                str(each.frames),
                str(each.people) if each.sources else "-",
                *(text(None if part is None else 100 * part, 1) for part in shares),
                *(text(error and error.mean) for error in errors),
                text(residual and residual.mean, 1),
            )
        )
    header = ("clip", "state", "frames", "people", "measured %", "completed %", "missing %", "error mm",
              "completed mm", "reprojection px")  # fmt: skip
    moments = [Moment(each.id, 0) if each.id in played else None for each in findings]
    caption = (
        "Shares are of the joints of captured people; errors are means against the truth; reprojection is that of "
        "measured joints"
    )
    held = (
        f" The player contains {len(played)} of them, those with the greatest errors."
        if len(played) < len(findings)
        else ""
    )
    return [Section("Clips", held, [Table(caption, header, rows, bars=(7, 8), moments=moments)])]


def moments_section(findings: Sequence[Findings], played: dict[str, range]) -> list[Section]:
    """Return the worst moments of the clips in the player.

    Args:
        findings: Findings of all clips.
        played: Clips in the player, with their frames in it.
    """
    shown = [(each, moment) for each in findings if each.id in played for moment in each.moments]
    tables = []
    for kind, caption in _KINDS.items():
        found = sorted(((e, m) for e, m in shown if m.kind == kind), key=lambda pair: -pair[1].size)[:_MOST_MOMENTS]
        if found:
            tables.append(_moments_table(caption, found, played))
    return [Section("Worst moments", "Choose one to see it in the player.", tables)] if tables else []


def _moments_table(caption: str, found: Sequence[tuple[Findings, WorstMoment]], played: dict[str, range]) -> Table:
    several = len(played) > 1
    rows, places = [], []
    for each, moment in found:
        person = "-" if moment.person is None else str(moment.person)
        seconds = f"{moment.frame / each.fps:.2f}"
        rows.append((*((each.id,) if several else ()), str(moment.frame), moment.amount, person, moment.what, seconds))
        inside = moment.frame in played[each.id]
        places.append(Moment(each.id, moment.frame, moment.person) if inside else None)
    header = (*(("clip",) if several else ()), "frame", "amount", "person", "what", "at s")
    return Table(caption, header, rows, moments=places)


def doubts_section(findings: Sequence[Findings], played: dict[str, range]) -> list[Section]:
    """Return the joints of the clips in the player that are most likely to be off, so that a reader can review them."""
    tables = [_doubts_table(each, played[each.id]) for each in findings if each.id in played and each.doubts]
    text = (
        "The joints that are most likely wrong, by signs that need no truth: stated error, bones that change their "
        "length, jumps, distance from detections. Choose one to see it in the player, and decide: accept, blank, or "
        "hand back to completion. Put the saved file into the folder of the clip: dmae export and dmae complete "
        "follow it."
    )
    return [Section("Doubtful joints", text, tables)] if tables else []


def _doubts_table(found: Findings, played: range) -> Table:
    rows, places, choices = [], [], []
    for entry, doubt in enumerate(found.doubts, 1):
        inside = doubt.worst in played
        rows.append(
            (str(entry), str(doubt.person), doubt.joint, f"{doubt.worst}", f"{1000 * doubt.doubt:.0f}", doubt.reason,
             doubt.source.name.lower(), str(doubt.views))
        )  # fmt: skip
        places.append(Moment(found.id, doubt.worst, doubt.person) if inside else None)
        choices.append({"person": doubt.person, "joint": doubt.joint, "first": doubt.first, "last": doubt.last})
    return Table(
        f"Doubtful joints of {found.id}",
        ("entry", "person", "joint", "frame", "doubt mm", "largest sign", "source", "cameras"),
        rows,
        bars=(4,),
        moments=places,
        choices=Choices(DECISIONS, [*ReviewVerdict], choices, {"format": FORMAT, "poses": found.poses_checksum}),
    )


def breakdown_sections(findings: Sequence[Findings]) -> list[Section]:
    """Return errors, or counts where there is no truth, by gap, joint, cause of occlusion and number of cameras."""
    groups = pooled_groups(findings, "breakdowns")
    if not groups:
        return []
    truth = pooled_truth(findings)
    known = bool(truth)
    names = [name for name in (BY_GAP, BY_CAUSE, BY_SEEING, BY_MEASURING, BY_JOINT) if name in groups]
    tables = [_breakdown_table(name, groups[name], known) for name in names]
    text = (
        "Every true joint is counted once: measured, completed or not found. Lengths of gaps are in frames at 25/s."
        if known
        else "There is no truth, so these are counts of the joints of captured people. Gaps are in frames at 25/s."
    )
    if BY_CAUSE in groups:
        text += " The cause is the most frequent reason for which cameras do not see the joint."
    figures = []
    if known:
        figures = [
            CaptionedFigure("Error by length of the gap: mean and 90 % quantile.", _gap_figure(groups[BY_GAP])),
            CaptionedFigure("Share of joints within an error, measured and completed ones.", _error_figure(truth)),
        ]
    return [Section("Errors" if known else "What was not measured", text, tables, figures)]


def uncertainty_section(findings: Sequence[Findings]) -> list[Section]:
    """Return how often the truth is in regions of stated probability; nothing if no uncertainty is stated."""
    regions = pooled_regions(findings)
    if not regions:
        return []
    rows = [
        (f"{100 * stated:.0f}", *(f"{100 * counts[1 + i] / counts[0]:.1f}" for counts in regions.values()))
        for i, stated in enumerate(PROBABILITIES)
    ]
    counted = " and ".join(f"{int(counts[0]):,} {name}" for name, counts in regions.items())
    table = Table("Truth found in the region, %, by its stated probability", ("stated %", *regions), rows)
    text = (
        f"{counted} have a stated uncertainty and a truth. Above the diagonal it is too cautious, below overconfident."
    )
    caption = "Stated against measured probability; on the diagonal the uncertainty is correct."
    return [Section("Is the uncertainty right?", text, [table], [CaptionedFigure(caption, _regions_figure(regions))])]


def residuals_section(findings: Sequence[Findings]) -> list[Section]:
    """Return reprojection errors by camera, joint and, for a single clip, person."""
    measured, completed = (pooled_groups(findings, name) for name in ("residuals", "residuals_completed"))
    names = ("camera", "person", "joint") if len(findings) == 1 else ("camera", "joint")
    tables = residual_tables(measured, completed, names)
    if not tables:
        return []
    words = (
        "Each joint is reprojected into each camera and compared with the detection that fits the person best there; "
        "joints that the camera did not detect are not counted."
    )
    return [Section("Reprojection", words, tables)]


def _breakdown_table(name: str, groups: dict[str, JointGroup], known: bool) -> Table:
    columns = {
        name: list(groups),
        "joints": [f"{each.joints:,}" for each in groups.values()],
    }
    if known:
        columns["mean mm"] = [text(each.mean) for each in groups.values()]
        columns["90 % under"] = [text(each.quantile(0.9)) for each in groups.values()]
    if any(each.completed for each in groups.values()):
        columns["completed %"] = [text(100 * each.completed / each.joints, 1) for each in groups.values()]
    if any(each.missing for each in groups.values()):
        heading = "not found %" if known else "missing %"
        columns[heading] = [text(100 * each.missing / each.joints, 1) for each in groups.values()]
    return Table(f"By {name}", list(columns), list(zip(*columns.values(), strict=True)), bars=(2,))


def _error_figure(truth: dict[str, JointGroup]) -> Figure:
    figure = Figure(figsize=(5.2, 3), layout="constrained")
    axes = figure.subplots()
    shown = {"measured": PERSONS[0], "completed": COMPLETED}
    for name, colour in shown.items():
        if truth[name].compared:
            within = 100 * np.cumsum(truth[name].histogram) / truth[name].compared
            axes.plot(np.arange(1, len(within) + 1), within, color=colour, label=name)
    most = max(50, 1.5 * (truth["all"].quantile(0.95) or 0))
    axes.set(xlabel="error [mm]", ylabel="joints within [%]", xlim=(0, most))
    return _finished(figure)


def _gap_figure(groups: dict[str, JointGroup]) -> Figure:
    shown = {name: each for name, each in groups.items() if each.compared}
    figure = Figure(figsize=(5.2, 3), layout="constrained")
    axes = figure.subplots()
    places = range(len(shown))
    axes.plot(places, [each.mean for each in shown.values()], "o-", color=PERSONS[0], label="mean")
    axes.plot(places, [each.quantile(0.9) for each in shown.values()], "s--", color=COMPLETED, label="90 % under")
    axes.set_xticks(places, [name.replace(" ", "\n", 1) for name in shown], fontsize=9)
    axes.set_ylabel("error [mm]")
    return _finished(figure)


def _regions_figure(regions: dict[str, Sequence[int]]) -> Figure:
    figure = Figure(figsize=(5.2, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.plot([0, 100], [0, 100], color="#8d9bac", linewidth=1, label="right")
    stated = [100 * each for each in PROBABILITIES]
    colours = {"measured joints": PERSONS[0], "completed joints": COMPLETED}
    for name, counts in regions.items():
        found = [100 * count / counts[0] for count in counts[1:]]
        axes.plot(stated, found, "o-", markersize=4, color=colours[name], label=name)
    axes.set(xlabel="stated [%]", ylabel="found [%]", xlim=(0, 100))
    return _finished(figure)


def _finished(figure: Figure) -> Figure:
    (axes,) = figure.axes
    axes.set_ylim(bottom=0)
    axes.grid(color="#dddddd", linewidth=0.5)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    return figure


def text(value: float | None, digits: int = 0) -> str:
    """Return a number as text, "-" if it is not known."""
    return "-" if value is None else f"{value:.{digits}f}"
