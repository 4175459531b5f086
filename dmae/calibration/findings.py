"""Findings: faults with their evidence and remedy."""

from dataclasses import dataclass

import numpy as np

from dmae.calibration.agreement import SOUND, Agreement, Pairs, mean_agreement, pairs_to_compare, score_pairs
from dmae.calibration.corrections import Correction
from dmae.calibration.faults import Fault
from dmae.calibration.hypothesis import Hypothesis
from dmae.calibration.remedies import camera_names, remedy, unit_remedy, up_remedy
from dmae.calibration.world.floor import Floor
from dmae.calibration.world.gravity_and_scale import relative_size, upright_direction
from dmae.formats.config import Convention
from dmae.numerics.statistics import mean_known

MIN_DETECTIONS = 20
"""Smallest number of detections for which a pair of views is judged."""
_UPRIGHT = 0.7
"""Smallest agreement of people on the vertical direction."""
_SOUND_TILT_DEG, _SOUND_HEIGHT_M = 0.3, 0.005
"""A world has a fault if the whole interval of its tilt, or of the error of its floor's height, is above this."""
_INSIDE = 0.3
"""Share of joints inside the image above which a camera is expected to see the people of the others."""


@dataclass(frozen=True)
class Finding:
    """A fault of some cameras.

    Attributes:
        fault: The fault.
        cameras: Names of the cameras that have it.
        evidence: The reason for the finding.
        remedy: The change that corrects it.
        alternatives: Possible faults, one of which is present, if the recording does not determine which.
    """

    fault: Fault
    cameras: tuple[str, ...]
    evidence: str
    remedy: str
    alternatives: tuple[Fault, ...] = ()


def corrected_fault(
    correction: Correction,
    before: Hypothesis,
    convention: Convention | None,
    offsets: list[int] | None,
    frames: np.ndarray,
) -> Finding:
    """Return the finding of a fault that was corrected.

    Args:
        before: Cameras and detections with the fault.
        convention: The assumed convention of the files; None if the format has no options for it.
        offsets: (V,) frames by which detections are already delayed, see `remedy`.
        frames: (S,) frames over which the views are compared.
    """
    rig, views = before.rig, correction.views
    pairs = [pair for pair in pairs_to_compare(len(rig)) if set(pair) & set(views)]
    worse, better = (mean_agreement(score_pairs(each, frames, pairs)) for each in (before, correction.hypothesis))
    evidence = f"mean agreement between views is {worse:.3f}, and {better:.3f} with the correction"
    if correction.fault == Fault.delay:
        delay = correction.hypothesis.offsets - before.offsets
        evidence = f"frame offsets: {', '.join(f'{rig.names[v]} {delay[v]:+d}' for v in views)}; {evidence}"
    names = tuple(rig.names[view] for view in views)
    return Finding(
        correction.fault, names, evidence, remedy(correction, before.convention, convention is not None, offsets)
    )


def disagreeing_cameras(
    hypothesis: Hypothesis, people: np.ndarray, found: Agreement, pairs: Pairs
) -> tuple[tuple[int, ...], tuple[str, ...]]:
    """Find cameras that agree with no other.

    Args:
        people: (m, J, 3) matched detections as points.

    Returns:
        disagreeing: Indices of cameras that see the same people as the others but disagree with them.
        apart: Names of cameras that do not see any people that the others see.
    """
    views, ends = len(hypothesis.rig), np.asarray(pairs)
    counted = found.detections.sum(1)
    agreement = np.where(counted >= MIN_DETECTIONS, found.total.sum(1) / np.maximum(counted, 1), np.nan)
    best = [np.nanmax(agreement[(ends == view).any(1)], initial=-1) for view in range(views)]
    usual = np.median([x for x in best if x >= 0] or [0])
    suspects = [view for view, x in enumerate(best) if 0 <= x < max(SOUND / 2, min(SOUND, usual / 2))]
    if len(suspects) == views:
        return tuple(suspects), ()
    disagreeing, apart = [], ()
    for view in suspects:
        # Check whether this camera looks at the people that the other cameras measure.
        others = people[~(ends[found.pair] == view).any(1)].reshape(1, -1, 3)
        camera = hypothesis.rig[[view]]
        inside = camera.inside(camera.project(others)[0]).sum() / max(np.isfinite(others).all(-1).sum(), 1)
        if inside > _INSIDE:
            disagreeing.append(view)
        else:
            apart += camera.names
    return tuple(disagreeing), apart


def unexplained_fault(hypothesis: Hypothesis, views: tuple[int, ...]) -> Finding:
    """Return the finding of cameras that disagree without a known fault."""
    rig = hypothesis.rig
    names = camera_names(rig, views)
    what = f"calibrate {names} again: moved, zoomed or focused since? Or leave out"
    if len(views) == len(rig):
        what = "check that calibration and detections are of the same recording, and of the same cameras"
    evidence = f"{names}: hardly any detection agrees with another camera's, and no known fault explains it"
    return Finding(Fault.unexplained, tuple(rig.names[view] for view in views), evidence, what)


def world_faults(
    hypothesis: Hypothesis, people: np.ndarray, has_options: bool
) -> tuple[list[Finding], tuple[str, ...]]:
    """Return findings of a wrong unit of length and of a wrong vertical axis.

    Args:
        people: (m, J, 3) matched detections as points.
        has_options: Whether unit and up are options of the files' format.

    Returns:
        findings: The faults.
        unknown: Questions that could not be decided.
    """
    findings, unknown, names = [], (), hypothesis.rig.names
    ratio, standing = relative_size(people, hypothesis.skeleton), upright_direction(people, hypothesis.skeleton)
    if ratio is None:
        unknown += ("too few people are measured to determine the unit of length",)
    elif what := unit_remedy(ratio, hypothesis.convention, has_options):
        findings.append(Finding(Fault.unit, names, f"people are {ratio:.3g} times as large as adults", what))
    if standing is None or standing[1] < _UPRIGHT:
        unknown += ("too few people stand upright to determine the vertical axis",)
    elif what := up_remedy(standing[0], hypothesis.convention, has_options):
        axis = ", ".join(f"{x:.2f}" for x in standing[0])
        findings.append(Finding(Fault.up, names, f"people stand along ({axis}), not along z", what))
    return findings, unknown


def floor_faults(floor: Floor, expected_m: float, names: tuple[str, ...]) -> list[Finding]:
    """Return findings of a tilted world, or of a floor at an unexpected height.

    Args:
        expected_m: Expected z of the floor.
        names: Names of all cameras.
    """
    findings = []
    what = "dmae calibrate with the same data refine.extrinsics=false refine.level=true, or dmae capture level=true"
    if floor.tilt_deg is not None and floor.tilt_interval_deg[0] > _SOUND_TILT_DEG:
        low, high = floor.tilt_interval_deg
        axis = ", ".join(f"{x:.3f}" for x in floor.up)
        evidence = (
            f"feet and bodies have ({axis}) as the vertical, {floor.tilt_deg:.1f} degrees from z "
            f"(95 %: {low:.1f} to {high:.1f})"
        )
        findings.append(Finding(Fault.tilted, names, evidence, what))
    if floor.height_m is not None:
        low, high = floor.height_interval_m
        if max(low - expected_m, expected_m - high) > _SOUND_HEIGHT_M:
            evidence = (
                f"feet stand at z = {100 * floor.height_m:+.0f} cm (95 %: {100 * low:+.0f} to {100 * high:+.0f}), "
                f"not at {100 * expected_m:+.0f} cm"
            )
            findings.append(Finding(Fault.floor, names, evidence, what))
    return findings


def size_faults(hypothesis: Hypothesis) -> list[Finding]:
    """Return findings of image sizes with exchanged width and height. All cameras with one size share the fault."""
    findings = []
    for width, height in np.unique(hypothesis.rig.size, axis=0):
        views = np.flatnonzero((hypothesis.rig.size == (width, height)).all(-1))
        xy = hypothesis.xy[:, views].swapaxes(0, 1)
        xy, known = np.nan_to_num(xy), np.isfinite(xy).all(-1).reshape(len(views), -1)
        outside = [((xy < -1) | (xy > wh)).any(-1).reshape(known.shape) for wh in ((width, height), (height, width))]
        as_written, exchanged = (np.nanmax(mean_known(np.where(known, far, np.nan), 1), initial=0) for far in outside)
        if as_written > 0.1 and exchanged < 0.05:
            names = tuple(hypothesis.rig.names[view] for view in views)
            evidence = f"up to {as_written:.0%} of a camera's joints lie outside {width} x {height} px"
            what = f"write the image size as {height} x {width} (data.size if it is in no file)"
            findings.append(Finding(Fault.size, names, evidence, what))
    return findings
