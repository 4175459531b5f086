"""`dmae doctor`: find faults of a calibration and its detections."""

import json
import sys
from dataclasses import asdict
from io import BytesIO
from pathlib import Path

import numpy as np

from dmae.calibration.config import describe_shortness
from dmae.calibration.doctor import Diagnosis, PairFit, diagnose
from dmae.calibration.epipolar import SOUND, Hypothesis, draw_arrows
from dmae.calibration.faults import Fault
from dmae.commands.config import DoctorCommand
from dmae.commands.data_sets import describe_sides, each_clip
from dmae.data.clip import Clip
from dmae.files.checks import child
from dmae.files.contents import write_atomic
from dmae.formats.config import Convention
from dmae.formats.reading import written_convention
from dmae.formats.recordings import offsets_of_all
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from dmae.reporting.tables import Table, print_tables

_COLUMNS = f"""residual px: median distance of joints from the epipolar lines of the other camera, of people who agree
agreeing: share of people who match one in the other camera, if both cameras detect people
agreement: mean fit of all of them, 0 to 1; {SOUND} and more is usual where cameras see the same people
of others: median agreement of the pairs without this camera"""
_BY_OPTION = (Fault.inverse, Fault.unit, Fault.up)  # Faults that data.inverse, data.unit and data.up correct
_FARTHEST = 10.0  # m; larger movements of a camera are not stated: two cameras do not show one along the line between
_FAR = 2.5  # A camera is named if its residual is this many times that of the others, though no fault is found
_SIDES_FRAMES = 600  # Frames, from the first on, in which exchanged sides are looked for


def run(config: DoctorCommand, out: Path) -> None:
    """Print how the cameras fit and what to correct; exits with status 1 if there is anything."""
    faulty, fitted = 0, False
    for clip, _, to in each_clip(config.data, out, "examining"):
        offsets = (
            None
            if config.data.cameras
            else offsets_of_all("data.offsets", config.data.offsets or [0] * len(clip.rig), clip.rig.names)
        )
        convention = written_convention(config.data)
        diagnosis = diagnose(clip, convention, offsets, config.max_offset)
        _print(clip, diagnosis, convention is not None)
        _print_sides(clip)
        write_atomic(to / "doctor.json", json.dumps({"clip": clip.id, **asdict(diagnosis)}, indent=1))
        if diagnosis.pairs:
            write_atomic(to / "doctor.png", _picture(clip, diagnosis))
            hypothesis = Hypothesis.of(clip, convention or Convention())
            arrows = draw_arrows(hypothesis, clip.id, _images(clip))
            for name, picture in zip(clip.rig.names, arrows, strict=True):
                write_atomic(child(to, f"arrows_{name}.png", "camera"), picture)
        faulty += bool(diagnosis.findings)
        fitted |= bool(diagnosis.pairs)
    if fitted:
        print(_COLUMNS)
    print(out)
    if faulty:
        sys.exit(1)


def _print(clip: Clip, diagnosis: Diagnosis, has_options: bool) -> None:
    for note in clip.provenance.get("notes", ()):
        print(f"{clip.id}: {note}")
    header: tuple[str, ...] = ("cameras", "residual px", "agreeing", "agreement", "detections")
    rows = [_row(fit) for fit in diagnosis.pairs]
    if diagnosis.findings:
        header += ("corrected: residual px", "agreeing", "agreement")
        rows = [(*row, *_row(fit)[1:4]) for row, fit in zip(rows, diagnosis.corrected, strict=True)]
    if rows:
        worst_first = sorted(range(len(rows)), key=lambda row: diagnosis.pairs[row].agreement)
        print_tables([Table(f"{clip.id}: pairs of cameras, worst first", header, [rows[row] for row in worst_first])])
    if diagnosis.cameras:
        print_tables([_cameras(clip, diagnosis)])
    if diagnosis.floor is not None:
        print(f"{clip.id}: {diagnosis.floor.describe()}")
    for number, finding in enumerate(diagnosis.findings, 1):
        print(f"{number}. {finding}")
    if not has_options and any(finding.fault in _BY_OPTION for finding in diagnosis.findings):
        print("   or by an option, which dmae doctor names if data.calibration= is the file of this calibration")
    short = describe_shortness(len(clip) / clip.fps)
    if short and any("or run dmae calibrate" in finding.remedy for finding in diagnosis.findings):
        print(f"{clip.id}: {short}")
    unknown = [*diagnosis.unknown, *([] if diagnosis.findings or diagnosis.unknown else unexplained(diagnosis))]
    for each in unknown:
        print(f"not known: {each}")
    if diagnosis.pairs and not diagnosis.findings:
        doubt = "; what is not known is listed above" if unknown else ""
        print(f"{clip.id}: nothing found wrong{doubt}")


def unexplained(diagnosis: Diagnosis) -> list[str]:
    """Say of a camera that is much farther from the others than they are from each other why nothing may be found."""
    residuals = {fit.camera: fit.residual for fit in diagnosis.cameras if fit.residual is not None}
    if len(residuals) < 3:
        return []
    worst = max(residuals, key=residuals.__getitem__)
    others = float(np.median([px for camera, px in residuals.items() if camera != worst]))
    if residuals[worst] < _FAR * others:
        return []
    return [
        f"why {worst} lies {residuals[worst]:.0f} px from the others, which have {others:.0f}: no single difference "
        f"explains it, as where it is both displaced and late; try dmae calibrate refine.cameras=[{worst}], with and "
        "without refine.offsets=true"
    ]


def _print_sides(clip: Clip) -> None:
    some = clip.select(frames=slice(0, _SIDES_FRAMES))
    if len(some.rig) < 2 or not len(some):
        return
    for note in describe_sides(some, capture(some, CaptureConfig()), "which dmae capture corrects"):
        print(f"{clip.id}: {note}")


def _cameras(clip: Clip, diagnosis: Diagnosis) -> Table:
    """Return how each camera agrees with the others, and what would go unnoticed in it, worst first."""
    header = (
        "camera",
        "agreement",
        "of others",
        "residual px",
        "moved cm",
        "turned deg",
        "focal %",
        "k1",
        "frames late",
    )
    scales = {"moved": 100, "turned": 1, "focal": 100, "lens": 1, "late": 1}
    rows = []
    for fit in diagnosis.cameras:
        own = [pair.agreement for pair in diagnosis.pairs if fit.camera in pair.cameras]
        others = [pair.agreement for pair in diagnosis.pairs if fit.camera not in pair.cameras]
        limits = [fit.limits[kind] for kind in scales]
        if limits[0] is not None and limits[0] > _FARTHEST:
            limits[0] = None
        rows.append(
            (
                fit.camera,
                f"{np.mean(own):.2f}" if own else "-",
                f"{np.median(others):.2f}" if others else "-",
                "-" if fit.residual is None else f"{fit.residual:.1f}",
                *("-" if x is None else f"{scale * x:.2g}" for x, scale in zip(limits, scales.values(), strict=True)),
            )
        )
    rows.sort(key=lambda row: row[1])
    title = (
        f"{clip.id}: cameras, worst first; on the right the smallest differences that are reliably detected where they "
        "are the only ones"
    )
    return Table(title, header, rows)


def _images(clip: Clip) -> list[np.ndarray | None]:
    if clip.images is None or not clip.has_images:
        return [None] * len(clip.rig)
    return [next(iter(clip.images.select([0], (name,)).read("rgb", name)), None) for name in clip.rig.names]


def _row(fit: PairFit) -> tuple[str, ...]:
    residual = "-" if fit.residual is None else f"{fit.residual:.1f}"
    return ("-".join(fit.cameras), residual, f"{fit.agreeing:.0%}", f"{fit.agreement:.2f}", str(fit.detections))


def _picture(clip: Clip, diagnosis: Diagnosis) -> bytes:
    """PNG: agreement of every two cameras, as read and, where there are findings, corrected."""
    from matplotlib.figure import Figure

    sides = {"as read": diagnosis.pairs} | ({"corrected": diagnosis.corrected} if diagnosis.findings else {})
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
