"""The report: one page of clips, captured or not, and of scores; in words, with a player, tables and figures."""

from collections import Counter
from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import repeat
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dmae.data.clip import Clip, Poses3D, Source, person_name
from dmae.evaluation.config import TITLE
from dmae.evaluation.report.findings import (
    BY_CAUSE,
    BY_GAP,
    BY_JOINT,
    BY_MEASURING,
    BY_SEEING,
    PROBABILITIES,
    Findings,
    JointGroup,
    State,
    added,
    examine,
    residual_tables,
)
from dmae.evaluation.review import DECISIONS, ReviewVerdict, decisions_content, load_decisions
from dmae.evaluation.scores import read_scores
from dmae.formats.poses import REGIONS, source_word
from dmae.formats.reading import Clips
from dmae.metrics.angles import SHOWN_BY, leg_angles
from dmae.metrics.score_tables import score_tables
from dmae.numerics.filling import STRANGERS, are_stills
from dmae.numerics.kinematics import can_move
from dmae.progress import progress, waiting
from dmae.reporting.figures import COMPLETED, PERSONS, gaps_figure, plain
from dmae.reporting.page import CaptionedFigure, Section, write_report
from dmae.reporting.player import player_data, window
from dmae.reporting.tables import Choices, Moment, Table, counted, number_text

MOST_CLIPS = 6
"""Greatest number of clips in the player."""
MOST_FRAMES = 4500
"""Frames of all clips in the player together: three minutes at 25 frames/s."""
_FEW = 100  # Joints; of fewer a page states the number, not the share
_KINDS = {
    "error": "Largest errors of a joint",
    "missed": "True people without a captured one",
    "not measured": "Frames with the fewest measured joints of a person",
    "reprojection": "Measured joints farthest from their detection",
}
_MOST_MOMENTS = 8  # Rows of each table of moments
_SHOWN = "The player shows detections, and truth where there is one"  # Of a clip that is not captured


def write_clips_report(
    path: Path,
    clips: Sequence[Clip] | None,
    scores: Sequence[dict] = (),
    *,
    title: str = TITLE,
    about: Sequence[str] = (),
) -> list[Findings]:
    """Write the report of clips, captured or not, and of scores, as one HTML file that loads nothing from elsewhere.

    Clips are read one at a time, so that memory does not grow with their number; those in the player are read twice.
    Without clips the page has scores only. `about`: paragraphs under the title. Returns the findings of each clip.
    """
    findings, named = [], Counter()
    folders = clips.folders if isinstance(clips, Clips) else repeat(None)
    for clip, folder in zip(progress(clips or (), "reporting"), folders, strict=False):
        found = examine(clip, load_decisions(folder, clip.poses) if folder else ())
        # Clips of several data sets can have one id, by which tables open them in the player.
        named[found.id] += 1
        same = named[found.id]
        findings.append(found if same == 1 else replace(found, id=f"{found.id} ({same})"))
    shown = _worst_clips(findings)
    most = MOST_FRAMES // max(1, len(shown))
    cuts = {index: window(findings[index].frames, most, _worst_frame(findings[index])) for index in shown}
    ranges = {findings[index].id: range(cut.start, cut.stop) for index, cut in cuts.items()}
    sections = [
        *clips_section(findings, ranges),
        *people_section(findings),
        *moments_section(findings, ranges),
        *(angles_section(clips[0], cuts[0]) if clips is not None and len(findings) == 1 and cuts else []),
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
        summary=[*about, *(() if clips is None else summary(findings))],
        players=[] if clips is None else [_played(clips[index], findings[index], cut) for index, cut in cuts.items()],
    )
    return findings


def _worst_clips(findings: Sequence[Findings]) -> list[int]:
    """Return sorted indices of clips with the worst frames: the largest errors or, without truth, the fewest joints."""

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


def _played(clip: Clip, findings: Findings, cut: slice) -> dict:
    """Return the data of a clip for the player, with notes on what it lacks."""
    notes = []
    if findings.state == State.not_captured:
        shown = "detections and its truth" if clip.truth else "detections"
        notes.append(f"Not captured yet: run dmae capture. These are its {shown}.")
    if findings.state == State.no_person:
        notes.append("Capture found no person in this clip.")
    if cut.stop - cut.start < findings.frames:
        notes.append(f"The clip is long: the player shows frames {cut.start} to {cut.stop - 1} of {findings.frames}.")
    error = None if findings.error is None else findings.error[cut]
    return player_data(replace(clip.select(frames=cut), id=findings.id), cut.start, error, notes)


# In words


def summary(findings: Sequence[Findings]) -> list[str]:
    """Return the paragraphs under the title."""
    images = not findings or any(each.has_images for each in findings)
    background = [] if images else ["There are no images, so the camera's view has a plain background."]
    paragraphs = ([*_subject(findings), *_states(findings)], _sources(findings), _errors(findings), background)
    return [" ".join(sentences) for sentences in paragraphs if sentences]


def _subject(findings: Sequence[Findings]) -> list[str]:
    if not findings:
        return ["This data set has no clip that was made without an error."]
    seconds = sum(each.frames / each.fps for each in findings)
    frames = sum(each.frames for each in findings)
    cameras = sorted({each.cameras for each in findings})
    rig = counted(cameras[0], "camera") if len(cameras) == 1 else f"{cameras[0]} to {cameras[-1]} cameras"
    rates = sorted({each.fps for each in findings})
    rate = f" at {rates[0]:g} frames/s" if len(rates) == 1 else ""
    length = f"{counted(frames, 'frame')}{rate} ({seconds:.1f} s) from {rig}"
    if len(findings) > 1:
        return [f"{len(findings)} clips: {length}."]
    people = findings[0].people
    captured = f", with {counted(people, 'captured person', 'captured people')}" if people else ""
    followed = [f"In stills nobody is followed: {STRANGERS}."] if people and are_stills(findings[0].fps) else []
    return [f"Clip {findings[0].id}: {length}{captured}.", *followed]


def _states(findings: Sequence[Findings]) -> list[str]:
    found = []
    for state, (one, several), words in (
        (State.empty, ("has", "have"), "no frames, so there is nothing to show"),
        (State.not_captured, ("is", "are"), f"not captured yet: run dmae capture. {_SHOWN}"),
        (State.no_person, ("is", "are"), "captured, but capture found no person"),
    ):
        clips = sum(each.state == state for each in findings)
        if clips:
            subject = "It" if len(findings) == 1 else counted(clips, "clip")
            found.append(f"{subject} {one if clips == 1 else several} {words}.")
    return found


def _sources(findings: Sequence[Findings]) -> list[str]:
    counts = {source: sum(each.sources.get(source, 0) for each in findings) for source in Source}
    total = sum(counts.values())
    if not total:
        return []
    denoised, rejected = counts[Source.DENOISED], sum(each.rejected for each in findings)
    measured = counts[Source.MEASURED] + denoised
    some = "" if denoised == measured else f"{share(denoised, total)} "
    then = f" ({some}smoothed or denoised afterwards)" if denoised else ""
    said = [
        f"Of {total:,} joints of captured people, in the frames in which any is known, cameras measured "
        f"{share(measured, total)}{then}."
    ]
    if not counts[Source.COMPLETED]:
        said.append("No joint is completed.")
    for count, words in (
        (counts[Source.COMPLETED] - rejected, "are completed: not measured, as fewer than two cameras agree on them"),
        (
            rejected,
            "are rejected and replaced: measured, but contradicted by the frames around, or with a large stated error",
        ),
        (counts[Source.ABSENT], "are absent: neither measured nor completed"),
    ):
        if count:
            said.append(f"{share(count, total).capitalize()} {words}.")
    unused, detections = sum(each.unused for each in findings), sum(each.detections for each in findings)
    if unused:
        said.append(f"{unused:,} of {detections:,} detections fit no captured person.")
    return said


def _errors(findings: Sequence[Findings]) -> list[str]:
    said, truth = [], added(*(each.against_truth for each in findings))
    if not truth:
        captured = any(each.sources for each in findings)
        said += ["There is no truth to compare with, so no error is stated."] if captured else []
    elif truth["all"].mean is None:
        said.append("No captured person matches a true one, so there is no error to state.")
    else:
        everything = truth["all"]
        parts = [
            f"{name} joints {truth[name].mean:.0f}\N{NO-BREAK SPACE}mm"
            for name in ("measured", "completed")
            if truth[name].compared
        ]
        said.append(
            f"Against the truth the mean error{_on_skeletons(findings)} is {everything.mean:.0f}\N{NO-BREAK SPACE}mm "
            f"({', '.join(parts)})."
        )
        if absent := everything.joints - everything.compared:
            said.append(f"{share(absent, everything.joints).capitalize()} of the true joints were not found.")
    at = 1 + PROBABILITIES.index(0.9)
    regions = added(*(each.regions for each in findings))
    within = [
        f"{share(counts[at], counts[0])} of the {name}" if counts[0] >= _FEW else f"{counts[at]} of {counts[0]} {name}"
        for name, counts in regions.items()
    ]
    if within:
        sentence = f"{' and '.join(within)} lie within their stated 90\N{NO-BREAK SPACE}% regions{_widened(findings)}."
        said.append(sentence[0].upper() + sentence[1:])
    elif any(each.states_completed for each in findings):
        said.append(f"{REGIONS[0].upper()}{REGIONS[1:]}.")
    residual = added(*(each.residuals for each in findings)).get("all", {}).get("all")
    if residual is not None and residual.mean is not None:
        said.append(
            f"Measured joints reproject {residual.mean:.1f}\N{NO-BREAK SPACE}px from their detections on average."
        )
    if len(findings) == 1 and findings[0].floor is not None:
        said.append(f"Estimated from feet and bodies: {findings[0].floor.describe()}.")
    return said


def _on_skeletons(findings: Sequence[Findings]) -> str:
    """Return the skeletons on which poses are compared with the truth."""
    names = sorted({each.skeleton for each in findings if each.has_truth and each.skeleton})
    return f" of joints of {' and '.join(names)}" if names else ""


def _widened(findings: Sequence[Findings]) -> str:
    """Return what regions allow for besides the stated error; empty where the truth is exact."""
    errors = [each.truth_error for each in findings if each.truth_error is not None]
    if not errors:
        return ""
    return (
        f", widened by the error of the truth itself, {np.mean(errors):.0f}\N{NO-BREAK SPACE}mm in the median, "
        "which a person or another system placed"
    )


def share(part: int, total: int) -> str:
    """Return a share in percent. A share is rounded to 0 % or 100 % only if it is exactly none or all."""
    percent = 100 * part / total
    if 0 < percent < 0.05:
        return "under 0.1\N{NO-BREAK SPACE}%"
    if 99.95 <= percent < 100:
        return "over 99.9\N{NO-BREAK SPACE}%"
    return f"{percent:.1f}\N{NO-BREAK SPACE}%"


# Sections


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
                *(number_text(None if part is None else 100 * part) for part in shares),
                *(number_text(None if error is None else error.mean, 0) for error in errors),
                number_text(None if residual is None else residual.mean),
            )
        )
    header = ("clip", "state", "frames", "people", "measured %", "completed %", "absent %", "error mm",
              "completed mm", "reprojection px")  # fmt: skip
    moments = [Moment(each.id, 0) if each.id in played else None for each in findings]
    caption = (
        f"Shares are of the joints of captured people; errors are means{_on_skeletons(findings)} against the truth; "
        "reprojection errors are of measured joints"
    )
    held = (
        f" The player contains {len(played)} of them, those with the greatest errors."
        if len(played) < len(findings)
        else ""
    )
    return [Section("Clips", held, [Table(caption, header, rows, bars=(7, 8), moments=moments)])]


def people_section(findings: Sequence[Findings]) -> list[Section]:
    """Return in how many frames each person of a single clip is captured; nothing for stills, or if always all are."""
    (found,) = findings if len(findings) == 1 else (None,)
    if found is None or are_stills(found.fps) or min(found.captured, default=found.frames) == found.frames:
        return []
    rows = [
        (person_name(person), f"{count:,}", number_text(100 * count / found.frames), f"{more:,}")
        for person, (count, more) in enumerate(zip(found.captured, found.only_completed, strict=True))
    ]
    words = (
        "A person is captured in a frame where cameras measured at least one joint, and only completed in one where "
        "joints are completed and none was measured. In the other frames the person was away, or was there and not "
        "found: joints of those frames count nowhere on this page."
    )
    table = Table(
        "Frames in which each is captured, and only completed", ("person", "captured", "%", "only completed"), rows
    )
    return [Section("People", words, [table])]


def moments_section(findings: Sequence[Findings], played: dict[str, range]) -> list[Section]:
    """Return the worst moments of the clips in the player; `played` are their frames in it."""
    shown = [(each, moment) for each in findings if each.id in played for moment in each.moments]
    several = len(played) > 1
    header = (*(("clip",) if several else ()), "frame", "amount", "person", "what", "at s")
    tables = []
    for kind, caption in _KINDS.items():
        found = sorted(((e, m) for e, m in shown if m.kind == kind), key=lambda pair: -pair[1].size)[:_MOST_MOMENTS]
        rows, places = [], []
        for each, moment in found:
            person = "-" if moment.person is None else person_name(moment.person)
            row = (str(moment.frame), moment.amount, person, moment.what, f"{moment.frame / each.fps:.2f}")
            rows.append((each.id, *row) if several else row)
            inside = moment.frame in played[each.id]
            places.append(Moment(each.id, moment.frame, moment.person) if inside else None)
        if found:
            tables.append(Table(caption, header, rows, moments=places))
    return [Section("Worst moments", "Choose one to see it in the player.", tables)] if tables else []


def doubts_section(findings: Sequence[Findings], played: dict[str, range]) -> list[Section]:
    """Return the joints of the clips in the player that are most likely to be off, so that a reader can review them."""
    tables = []
    for found in (each for each in findings if each.id in played and each.doubts):
        rows, places, choices = [], [], []
        for entry, doubt in enumerate(found.doubts, 1):
            size, source = f"{1000 * doubt.doubt:.0f}", source_word(doubt.source, doubt.views)
            person = person_name(doubt.person)
            cameras = f"{doubt.detected} / {doubt.views}"
            cells = (entry, person, doubt.joint, doubt.worst, size, doubt.reason, source, cameras)
            rows.append(tuple(map(str, cells)))
            inside = doubt.worst in played[found.id]
            places.append(Moment(found.id, doubt.worst, doubt.person) if inside else None)
            choices.append({"person": doubt.person, "joint": doubt.joint, "first": doubt.first, "last": doubt.last})
        header = ("entry", "person", "joint", "frame", "doubt mm", "largest sign", "source", "detect / agree")
        file = decisions_content(found.poses_checksum, found.decisions)
        decisions = Choices(DECISIONS, [*ReviewVerdict], choices, file)
        kept = f"; the file keeps {counted(len(found.decisions), 'earlier decision')}" if found.decisions else ""
        caption = f"Doubtful joints of {found.id}{kept}"
        tables.append(Table(caption, header, rows, bars=(4,), moments=places, choices=decisions))
    words = (
        "The joints that are most likely wrong, by signs that need no truth: stated error, bones that change their "
        "length, jumps, distance from detections. The last column is the number of cameras that detect the joint, and "
        "of those that agree on it. Choose one to see it in the player, and decide: accept, blank, or "
        "hand back to completion. Put the saved file into the folder of the clip: dmae export and dmae complete "
        "follow it."
    )
    return [Section("Doubtful joints", words, tables)] if tables else []


def breakdown_sections(findings: Sequence[Findings]) -> list[Section]:
    """Return errors, or counts where there is no truth, by gap, joint, cause of occlusion and number of cameras."""
    groups = added(*(each.breakdowns for each in findings))
    if not groups:
        return []
    truth = added(*(each.against_truth for each in findings))
    known = bool(truth)
    names = [name for name in (BY_GAP, BY_CAUSE, BY_SEEING, BY_MEASURING, BY_JOINT) if name in groups]
    tables = [_breakdown_table(name, groups[name], known) for name in names]
    words = (
        "Every true joint is counted once: measured, completed or not found. Errors are means"
        f"{_on_skeletons(findings)}. Lengths of gaps are in frames at 25/s."
        if known
        else "There is no truth, so these are counts of the joints of captured people. Gaps are in frames at 25/s."
    )
    if BY_CAUSE in groups:
        words += " The cause is the most frequent reason for which cameras do not see the joint."
    figures = []
    if known:
        figures = [
            CaptionedFigure("Error by length of the gap: mean and 90 % quantile.", _gap_figure(groups[BY_GAP])),
            CaptionedFigure("Share of joints within an error, measured and completed ones.", _error_figure(truth)),
        ]
    return [Section("Errors" if known else "What was not measured", words, tables, figures)]


def uncertainty_section(findings: Sequence[Findings]) -> list[Section]:
    """Return how often the truth is in regions of stated probability; nothing if no uncertainty is stated."""
    regions = added(*(each.regions for each in findings))
    if not regions:
        return []
    rows = [
        (f"{100 * stated:.0f}", *(f"{100 * counts[1 + i] / counts[0]:.1f}" for counts in regions.values()))
        for i, stated in enumerate(PROBABILITIES)
    ]
    compared = " and ".join(f"{int(counts[0]):,} {name}" for name, counts in regions.items())
    table = Table("Truth found in the region, %, by its stated probability", ("stated %", *regions), rows)
    words = (
        f"{compared} have a stated uncertainty and a truth. Above the diagonal it is too cautious, below overconfident."
    )
    if widened := _widened(findings):
        words += (
            f" Regions are those stated{widened}. That error is the same in all frames: where cameras hardly see a "
            "joint, people place it less exactly, too, and fewer completed joints lie inside."
        )
    caption = "Stated against measured probability; on the diagonal the uncertainty is correct."
    return [Section("Is the uncertainty right?", words, [table], [CaptionedFigure(caption, _regions_figure(regions))])]


def angles_section(clip: Clip, frames: slice) -> list[Section]:
    """Return the angles of the legs of each person in some frames of a clip; nothing for stills or other bodies."""
    poses = None if clip.poses is None else clip.poses.select(frames)
    if poses is None or are_stills(clip.fps) or not can_move(poses.skeleton):
        return []
    poses = poses.without(np.isinf(poses.xyz).any(-1))  # Files cannot hold infinite coordinates, but users can.
    with waiting("fitting bodies"):
        values, spread = leg_angles(poses)
    seconds = (frames.start + np.arange(len(values))) / clip.fps
    figures = []
    known = np.isfinite(values).any((0, 1, 3))
    persons = np.flatnonzero(np.isfinite(values).any((0, 2, 3))).tolist()
    for person in progress(persons, "drawing joint angles"):
        guessed = [_guessed(poses, person, joints) for joints in SHOWN_BY.values()]
        shown = {name: number for number, name in enumerate(SHOWN_BY) if known[number]}
        figure = _angles_figure(seconds, values[:, person], spread[:, person], np.stack(guessed, 1), shown)
        figures.append(CaptionedFigure(f"{person_name(person)}, with one standard deviation on both sides.", figure))
    words = (
        "Flexion of hips and knees and dorsiflexion of ankles, as in the joint angles for OpenSim (format=mot). There "
        "is no line where joints do not determine an angle; where it is underlaid in red, one of the joints that show "
        "it is completed."
    )
    if lacking := [name for name, there in zip(SHOWN_BY, known, strict=True) if not there]:
        words += f" No joints of {poses.skeleton.name} show {' and '.join(lacking)} here."
    return [Section("Joint angles", words, figures=figures)] if figures else []


def _guessed(poses: Poses3D, person: int, joints: Sequence[str]) -> np.ndarray:
    """Return (F, 2) True where one of the joints is completed, of the right and of the left side."""
    names = [[f"{side}_{joint}" for joint in joints] for side in "rl"]
    index = [[poses.skeleton.joints.index(name) for name in side if name in poses.skeleton.joints] for side in names]
    return np.stack([(poses.source[:, person, side] == Source.COMPLETED).any(-1) for side in index], -1)


def _angles_figure(
    seconds: np.ndarray, values: np.ndarray, spread: np.ndarray, guessed: np.ndarray, shown: dict[str, int]
) -> Figure:
    """Draw angles (F, 3, 2), degrees, right sides first, with their standard deviations, where they are guessed too."""
    figure = Figure(figsize=(4 * len(shown), 3), layout="constrained")
    panels = figure.subplots(1, len(shown), squeeze=False)[0]
    for axes, (name, number) in zip(panels, shown.items(), strict=True):
        for side, (label, colour) in enumerate(zip(("right", "left"), PERSONS, strict=False)):
            value, sd = values[:, number, side], spread[:, number, side]
            axes.fill_between(seconds, value - sd, value + sd, color=colour, alpha=0.2, linewidth=0)
            marked = np.where(guessed[:, number, side], value, np.nan)
            axes.plot(seconds, marked, color=COMPLETED, alpha=0.5, linewidth=5)
            axes.plot(seconds, value, color=colour, linewidth=1.2, label=label)
        axes.set(title=name, xlabel="s", xlim=(seconds[0], seconds[-1] + 1e-3))
        plain(axes)
    panels[0].set_ylabel("degrees")
    panels[-1].legend(frameon=False)
    return figure


def residuals_section(findings: Sequence[Findings]) -> list[Section]:
    """Return reprojection errors by camera, joint and, for a single clip, person."""
    measured = added(*(each.residuals for each in findings))
    completed = added(*(each.residuals_completed for each in findings))
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
    columns = {name: list(groups), "joints": [f"{each.joints:,}" for each in groups.values()]}
    if known:
        columns["mean mm"] = [number_text(each.mean, 0) for each in groups.values()]
        columns["90 % under"] = [number_text(each.quantile(0.9), 0) for each in groups.values()]
    if any(each.completed for each in groups.values()):
        columns["completed %"] = [number_text(100 * each.completed / each.joints) for each in groups.values()]
    if any(each.missing for each in groups.values()):
        columns["not found %" if known else "absent %"] = [
            number_text(100 * each.missing / each.joints) for each in groups.values()
        ]
    return Table(f"By {name}", list(columns), list(zip(*columns.values(), strict=True)), bars=(2,))


def _error_figure(truth: dict[str, JointGroup]) -> Figure:
    figure = Figure(figsize=(5.2, 3), layout="constrained")
    axes = figure.subplots()
    for name, colour in {"measured": PERSONS[0], "completed": COMPLETED}.items():
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
    mean, most = np.array([(each.mean, each.quantile(0.9)) for each in shown.values()], float).reshape(-1, 2).T
    axes.plot(places, mean, "o-", color=PERSONS[0], label="mean")
    axes.plot(places, most, "s--", color=COMPLETED, label="90 % under")
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
    plain(axes)
    axes.legend(frameon=False)
    return figure


# Scores


def read_shown_scores(path: Path) -> dict:
    """Return scores as `read_scores` does; ValueError also if an entry is missing that a page shows."""
    scores = read_scores(path)
    try:
        scores_section(scores)
    except (KeyError, TypeError, AttributeError, IndexError, ValueError, OverflowError) as error:
        raise ValueError(f"{path}: expected scores that dmae evaluate wrote, {error!r:.200}") from None
    return scores


def scores_section(scores: dict) -> Section:
    """Return the score tables of `dmae evaluate`, and a figure of errors by gap length."""
    poses = f" ({scores['poses']})" if "poses" in scores else ""
    return Section(
        f"Scores on {scores['recording']}{poses}",
        "Strict protocol: one-to-one matching within 0.5 m; a missed person or joint fails its limbs. Views are "
        "numbers of cameras; mean and worst are over all subsets of that many.",
        tables=score_tables(scores),
        figures=[CaptionedFigure("Mean error of unmeasured joints by the length of the gap.", gaps_figure(scores))],
    )
