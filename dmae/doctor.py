"""What is wrong with a recording: do its cameras and its detections fit, and if not, why."""

import json
import sys
from dataclasses import asdict, dataclass, field, replace
from io import BytesIO
from pathlib import Path

import numpy as np

from dmae.clip import Clip
from dmae.conventions import Convention
from dmae.data import DataConfig, is_data_set, load, written_convention
from dmae.epipolar import Agreement, Reading, Sight, agree, all_pairs, frames_of, look, people
from dmae.faults import Fault, Mending, mean_agreement, scores
from dmae.metrics import mean_known
from dmae.progress import progress
from dmae.remedies import cameras, remedy, unit_remedy, up_remedy
from dmae.searches import CHECKED, SOUND, explain
from dmae.store import write_atomic
from dmae.tables import Table, print_tables
from dmae.world import size, upright

_LEAST_DETECTIONS = 20
"""Of a pair of views; fewer tell nothing."""
_STILL = 0.08
"""Agreement that motion has to cost at wrong times, to tell of time at all."""
_UPRIGHT = 0.7
"""How much people have to agree in where up is."""


@dataclass(frozen=True)
class PairFit:
    """How two cameras fit.

    Attributes:
        cameras: Their names.
        residual: px, median distance of joints from epipolar lines in detections that agree; None where none do.
        agreeing: Share of detections that agree with one of the other camera, where that sees anybody.
        agreement: Mean agreement of all these, from 0 to 1.
        detections: How many these are.
    """

    cameras: tuple[str, str]
    residual: float | None
    agreeing: float
    agreement: float
    detections: int


@dataclass(frozen=True)
class Finding:
    """A fault: what, of which cameras, why it is thought to be there, and what mends it."""

    fault: Fault
    cameras: tuple[str, ...]
    evidence: str
    remedy: str


@dataclass(frozen=True)
class Diagnosis:
    """What is wrong with a recording.

    Attributes:
        pairs: How the cameras fit as the recording was read.
        mended: The same with the findings mended.
        findings: In the order to mend them in; none where nothing is wrong.
        unknown: What could not be decided, and why.
    """

    pairs: tuple[PairFit, ...]
    mended: tuple[PairFit, ...]
    findings: tuple[Finding, ...]
    unknown: tuple[str, ...]


def diagnose(
    clip: Clip, convention: Convention | None = None, offsets: list[int] | None = None, most_delay: int = 50
) -> Diagnosis:
    """Compare cameras and detections, and find the usual mistakes in them.

    Args:
        clip: Cameras and detections; nothing else of it is read.
        convention: How the files were taken to write the calibration; None where the format has no such options.
        offsets: (V,) frames by which the files' detections are put off already.
        most_delay: Frames by which two cameras are tried to be out of step, either way.

    Raises:
        ValueError: `most_delay` is negative.
    """
    if most_delay < 0:
        raise ValueError(f"most_delay={most_delay}: expected a number of frames, 0 or more")
    reading = Reading.of(clip, convention or Convention())
    pairs = all_pairs(len(clip.rig))
    frames = frames_of(reading, CHECKED)
    seen = np.isfinite(reading.xy[..., 0]).any((0, 2, 3))
    unknown = tuple(
        f"camera {name} detects nobody" for name, sees in zip(clip.rig.names, seen, strict=True) if not sees
    )
    if len(clip.rig) < 2 or not len(frames):
        why = "there is one camera" if len(clip.rig) < 2 else "no two cameras see anybody in the same frame"
        return Diagnosis((), (), (), (*unknown, f"nothing can be compared: {why}"))
    fits, mended = _fits(reading, pairs, frames), reading
    if sum(fit.detections for fit in fits) < _LEAST_DETECTIONS:
        return Diagnosis(fits, fits, (), (*unknown, "nothing can be compared: too few people are seen by two cameras"))
    findings, telling = [], 0.0
    # A fault can hide another; every camera can have one.
    for _ in range(len(clip.rig) + 2):
        mending, telling = explain(mended, most_delay)
        if mending is None:
            break
        findings.append(_finding(mending, mended, convention, offsets, frames))
        mended = mending.reading
        if mending.fault == Fault.inverse and len(mending.views) == len(clip.rig):
            mended = replace(mended, convention=replace(mended.convention, inverse=not mended.convention.inverse))
    frames = frames_of(mended, CHECKED)
    sight = look(mended, frames)
    found = agree(sight, pairs)
    body = people(sight, pairs, found)
    bad, apart = _bad(mended, sight, body, found, pairs)
    if bad:
        findings.append(_unexplained(mended, bad))
    unknown += tuple(f"camera {name} shares nobody with the others" for name in apart)
    if telling < _STILL and len(bad) < len(clip.rig):
        unknown += ("people move too little to tell whether the cameras are in step",)
    if len(bad) < len(clip.rig):
        more, less = _of_world(mended, body, convention is not None)
        findings += more
        unknown += less
    findings += _of_size(mended)
    return Diagnosis(fits, _fits(mended, pairs, frames), tuple(findings), unknown)


def _fits(reading: Reading, pairs: list[tuple[int, int]], frames: np.ndarray) -> tuple[PairFit, ...]:
    found = agree(look(reading, frames), pairs)
    fits = []
    for index, (a, b) in enumerate(pairs):
        off, detections = found.off[found.pair == index], int(found.detections[index].sum())
        fits.append(
            PairFit(
                (reading.rig.names[a], reading.rig.names[b]),
                float(np.nanmedian(off)) if len(off) else None,
                2 * len(off) / max(detections, 1),
                float(found.total[index].sum() / max(detections, 1)),
                detections,
            )
        )
    return tuple(fits)


def _finding(
    mending: Mending, before: Reading, convention: Convention | None, offsets: list[int] | None, frames: np.ndarray
) -> Finding:
    views = mending.views
    pairs = [pair for pair in all_pairs(len(before.rig)) if set(pair) & set(views)]
    worse, better = (mean_agreement(scores(reading, frames, pairs)) for reading in (before, mending.reading))
    evidence = f"{cameras(before.rig, views)} and the others agree {better:.3f} without it, {worse:.3f} with it"
    if mending.fault == Fault.delay:
        late = mending.reading.delay - before.delay
        evidence = f"frames late: {', '.join(f'{before.rig.names[v]} {late[v]:+d}' for v in views)}; {evidence}"
    names = tuple(before.rig.names[view] for view in views)
    return Finding(mending.fault, names, evidence, remedy(mending, before.convention, convention is not None, offsets))


def _bad(
    reading: Reading, sight: Sight, body: np.ndarray, found: Agreement, pairs: list[tuple[int, int]]
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Cameras that fit no other although they should, and names of those that share nobody with the others."""
    views, ends = len(reading.rig), np.asarray(pairs)
    counted = found.detections.sum(1)
    agreement = np.where(counted >= _LEAST_DETECTIONS, found.total.sum(1) / np.maximum(counted, 1), np.nan)
    best = [np.nanmax(agreement[(ends == view).any(1)], initial=-1) for view in range(views)]
    usual = np.median([x for x in best if x >= 0] or [0])
    suspects = [view for view, x in enumerate(best) if 0 <= x < max(SOUND / 2, min(SOUND, usual / 2))]
    if len(suspects) == views:
        return tuple(suspects), ()
    bad, apart = [], ()
    for view in suspects:
        # People as the other cameras have them: does this one look where they are?
        theirs = body[~(ends[found.pair] == view).any(1)].reshape(1, -1, 3)
        camera = reading.rig[[view]]
        inside = camera.inside(camera.project(theirs)[0]).sum() / max(np.isfinite(theirs).all(-1).sum(), 1)
        bad, apart = (bad + [view], apart) if inside > 0.3 else (bad, apart + camera.names)
    return tuple(bad), apart


def _unexplained(reading: Reading, bad: tuple[int, ...]) -> Finding:
    names, who = tuple(reading.rig.names[view] for view in bad), cameras(reading.rig, bad)
    remedy = f"calibrate {who} anew: moved, zoomed or focused since? Or do without"
    if len(bad) == len(reading.rig):
        remedy = "look whether calibration and detections are of the same recording, and of the same cameras"
    evidence = f"{who}: hardly a detection fits another camera's; no usual mistake explains it"
    return Finding(Fault.unexplained, names, evidence, remedy)


def _of_world(reading: Reading, body: np.ndarray, options: bool) -> tuple[list[Finding], tuple[str, ...]]:
    """Wrong units and axes, by people (n, J, 3); and what they do not tell."""
    findings, unknown, names, ratio = [], (), reading.rig.names, size(body, reading.skeleton)
    if ratio is None:
        unknown += ("too few people are measured to tell the unit of length",)
    elif mend := unit_remedy(ratio, reading.convention, options):
        findings.append(Finding(Fault.unit, names, f"people are {ratio:.3g} times as large as adults", mend))
    standing = upright(body, reading.skeleton)
    if standing is None or standing[1] < _UPRIGHT:
        unknown += ("too few people are seen upright to tell which axis is up",)
    elif mend := up_remedy(standing[0], reading.convention, options):
        axis = ", ".join(f"{x:.2f}" for x in standing[0])
        findings.append(Finding(Fault.up, names, f"people stand along ({axis}), not along z", mend))
    return findings, unknown


def _of_size(reading: Reading) -> list[Finding]:
    """Image sizes whose width and height are exchanged; where one is, so are the same of the other cameras."""
    findings = []
    for width, height in np.unique(reading.rig.size, axis=0):
        views = np.flatnonzero((reading.rig.size == (width, height)).all(-1))
        xy = reading.xy[:, views].swapaxes(0, 1)
        xy, known = np.nan_to_num(xy), np.isfinite(xy).all(-1).reshape(len(views), -1)
        outside = [((xy < -1) | (xy > wh)).any(-1).reshape(known.shape) for wh in ((width, height), (height, width))]
        as_written, exchanged = (np.nanmax(mean_known(np.where(known, far, np.nan), 1), initial=0) for far in outside)
        if as_written > 0.1 and exchanged < 0.05:
            names = tuple(reading.rig.names[view] for view in views)
            evidence = f"up to {as_written:.0%} of a camera's joints lie outside {width} x {height} px"
            remedy = f"write the image size as {height} x {width} (data.size where no file says it)"
            findings.append(Finding(Fault.size, names, evidence, remedy))
    return findings


@dataclass(frozen=True)
class DoctorCommand:
    """`dmae doctor`."""

    data: DataConfig = field(default_factory=DataConfig)
    most_delay: int = 50
    """Frames by which two cameras are tried to be out of step, either way."""
    out: str = "runs/doctor"


def run_doctor(config: DoctorCommand, out: Path) -> None:
    """Print how the cameras fit and what to mend; exits with status 1 if there is anything."""
    clips, ill = load(config.data), 0
    for clip, folder in progress(zip(clips, clips.folders, strict=True), "examining", len(clips)):
        offsets = None if config.data.cameras else list(config.data.offsets or [0] * len(clip.rig))
        diagnosis = diagnose(clip, written_convention(config.data), offsets, config.most_delay)
        _tell(clip, diagnosis)
        to = out / folder.name if is_data_set(config.data) else out
        write_atomic(to / "doctor.json", json.dumps({"clip": clip.id, **asdict(diagnosis)}, indent=1))
        if diagnosis.pairs:
            write_atomic(to / "doctor.png", _picture(clip, diagnosis))
        ill += bool(diagnosis.findings)
    if ill:
        sys.exit(1)


def _tell(clip: Clip, diagnosis: Diagnosis) -> None:
    """Print a diagnosis."""
    for note in clip.provenance.get("notes", ()):
        print(f"{clip.id}: {note}")
    header = ("cameras", "residual px", "agreeing", "agreement", "detections")
    rows = [_row(fit) for fit in diagnosis.pairs]
    if diagnosis.findings:
        header += ("mended: residual px", "agreeing", "agreement")
        rows = [(*row, *_row(fit)[1:4]) for row, fit in zip(rows, diagnosis.mended, strict=True)]
    if rows:
        print_tables([Table(f"{clip.id}: epipolar residuals", header, rows)])
    for number, finding in enumerate(diagnosis.findings, 1):
        print(f"{number}. {finding.fault}: {', '.join(finding.cameras)}\n   because {finding.evidence}")
        print(f"   mend: {finding.remedy}")
    for unknown in diagnosis.unknown:
        print(f"not known: {unknown}")
    if diagnosis.pairs and not diagnosis.findings:
        print(f"{clip.id}: nothing found wrong")


def _row(fit: PairFit) -> tuple[str, ...]:
    residual = "-" if fit.residual is None else f"{fit.residual:.1f}"
    return ("-".join(fit.cameras), residual, f"{fit.agreeing:.0%}", f"{fit.agreement:.2f}", str(fit.detections))


def _picture(clip: Clip, diagnosis: Diagnosis) -> bytes:
    """PNG: agreement of every two cameras, as read and, where there are findings, mended."""
    from matplotlib.figure import Figure

    sides = {"as read": diagnosis.pairs} | ({"mended": diagnosis.mended} if diagnosis.findings else {})
    figure = Figure(figsize=(0.5 + 4.5 * len(sides), 4), layout="constrained")
    for axes, (title, fits) in zip(figure.subplots(1, len(sides), squeeze=False)[0], sides.items(), strict=True):
        matrix = np.full((len(clip.rig),) * 2, np.nan)
        for fit in fits:
            a, b = (clip.rig.names.index(name) for name in fit.cameras)
            matrix[a, b] = matrix[b, a] = fit.agreement
            for place in ((a, b), (b, a)):
                axes.text(*place, _row(fit)[1], ha="center", va="center", fontsize=8)
        drawn = axes.imshow(matrix, vmin=0, vmax=0.8, cmap="RdYlGn")
        axes.set_xticks(range(len(clip.rig)), clip.rig.names, rotation=90)
        axes.set_yticks(range(len(clip.rig)), clip.rig.names)
        axes.set_title(f"{clip.id}, {title}: median residual, px", fontsize=9)
    figure.colorbar(drawn, ax=figure.axes, label="agreement, 0 to 1")
    figure.savefig(buffer := BytesIO(), format="png", dpi=100)
    return buffer.getvalue()
