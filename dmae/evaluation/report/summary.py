"""The report in words: its subject and its main figures."""

from collections.abc import Sequence

from dmae.data.clip import Source
from dmae.evaluation.report.findings import Findings, State
from dmae.evaluation.report.joint_groups import JointGroup
from dmae.evaluation.report.pooled import pooled_groups, pooled_regions, pooled_truth
from dmae.evaluation.report.stated_uncertainty import PROBABILITIES


def summary(findings: Sequence[Findings]) -> list[str]:
    """Return the paragraphs under the title."""
    return [
        " ".join(sentences)
        for sentences in (
            [*_subject(findings), *_states(findings)],
            _sources(findings),
            [*_errors(findings), *_uncertainty(findings), *_residuals(findings), *_floor(findings)],
            _pictures(findings),
        )
        if sentences
    ]


def _subject(findings: Sequence[Findings]) -> list[str]:
    if not findings:
        return ["This data set has no clip that was made without an error."]
    seconds = sum(each.frames / each.fps for each in findings)
    frames = sum(each.frames for each in findings)
    cameras = sorted({each.cameras for each in findings})
    rig = number(cameras[0], "camera") if len(cameras) == 1 else f"{cameras[0]} to {cameras[-1]} cameras"
    rates = sorted({each.fps for each in findings})
    rate = f" at {rates[0]:g} frames/s" if len(rates) == 1 else ""
    length = f"{number(frames, 'frame')}{rate} ({seconds:.1f} s) from {rig}"
    if len(findings) > 1:
        return [f"{len(findings)} clips: {length}."]
    people = findings[0].people
    captured = f", with {number(people, 'captured person', 'captured people')}" if people else ""
    return [f"Clip {findings[0].id}: {length}{captured}."]


def _states(findings: Sequence[Findings]) -> list[str]:
    one = len(findings) == 1
    found = []
    for state, words in (
        (State.empty, "no frames, so there is nothing to show"),
        (
            State.not_captured,
            "not captured yet: run dmae capture. The player shows detections, and truth where there is one",
        ),
        (State.no_person, "captured, but capture found no person"),
    ):
        clips = [each for each in findings if each.state == state]
        if clips:
            verb = "has" if state == State.empty else "is"
            verb = verb if one or len(clips) == 1 else {"has": "have", "is": "are"}[verb]
            subject = "It" if one else number(len(clips), "clip")
            found.append(f"{subject} {verb} {words}.")
    return found


def _sources(findings: Sequence[Findings]) -> list[str]:
    counts = {source: sum(each.sources.get(source, 0) for each in findings) for source in Source}
    total = sum(counts.values())
    if not total:
        return []
    measured = counts[Source.MEASURED] + counts[Source.DENOISED]
    text = [f"Of {total:,} joints of captured people, cameras measured {share(measured, total)}."]
    if counts[Source.COMPLETED]:
        text.append(f"{_first(counts[Source.COMPLETED], total)} are completed: no camera measured them.")
    else:
        text.append("No joint is completed.")
    if counts[Source.ABSENT]:
        text.append(f"{_first(counts[Source.ABSENT], total)} are missing.")
    if counts[Source.DENOISED]:
        text.append(f"{_first(counts[Source.DENOISED], total)} were measured, then moved by denoising or smoothing.")
    return text


def _errors(findings: Sequence[Findings]) -> list[str]:
    truth = pooled_truth(findings)
    if not truth:
        captured = any(each.sources for each in findings)
        return ["There is no truth to compare with, so no error is stated."] if captured else []
    everything = truth["all"]
    if everything.mean is None:
        return ["No captured person matches a true one, so there is no error to state."]
    parts = [
        f"{name} joints {truth[name].mean:.0f}\N{NO-BREAK SPACE}mm"
        for name in ("measured", "completed")
        if truth[name].compared
    ]
    text = [f"Against the truth the mean error is {everything.mean:.0f}\N{NO-BREAK SPACE}mm ({', '.join(parts)})."]
    absent = everything.joints - everything.compared
    if absent:
        text.append(f"{_first(absent, everything.joints)} of the true joints were not found.")
    return text


def _uncertainty(findings: Sequence[Findings]) -> list[str]:
    regions = pooled_regions(findings)
    at = 1 + PROBABILITIES.index(0.9)
    parts = [f"{share(counts[at], counts[0])} of the {name}" for name, counts in regions.items()]
    if not parts:
        return []
    sentence = f"{' and '.join(parts)} lie within their stated 90\N{NO-BREAK SPACE}% regions."
    return [sentence[0].upper() + sentence[1:]]


def _residuals(findings: Sequence[Findings]) -> list[str]:
    overall: JointGroup | None = pooled_groups(findings, "residuals").get("all", {}).get("all")
    if overall is None or overall.mean is None:
        return []
    return [f"Measured joints reproject {overall.mean:.1f}\N{NO-BREAK SPACE}px from their detections on average."]


def _floor(findings: Sequence[Findings]) -> list[str]:
    floors = [each.floor for each in findings if each.floor is not None]
    return [f"Estimated from feet and bodies: {floors[0].describe()}."] if len(floors) == len(findings) == 1 else []


def _pictures(findings: Sequence[Findings]) -> list[str]:
    if not findings or any(each.has_images for each in findings):
        return []
    return ["There are no pictures, so the camera's view has a plain background."]


def number(count: int, one: str, several: str | None = None) -> str:
    """Return a count with its noun, as "1 frame" or "1,200 frames"."""
    return f"{count:,} {one if count == 1 else several or one + 's'}"


def _first(part: int, total: int) -> str:
    """Return a share as the first word of a sentence."""
    return share(part, total).capitalize()


def share(part: int, total: int) -> str:
    """Return a share in percent. A share is rounded to 0 % or 100 % only if it is exactly none or all."""
    percent = 100 * part / total
    if 0 < percent < 0.05:
        return "under 0.1\N{NO-BREAK SPACE}%"
    if 99.95 <= percent < 100:
        return "over 99.9\N{NO-BREAK SPACE}%"
    return f"{percent:.1f}\N{NO-BREAK SPACE}%"
