"""Findings: faults with their evidence, and their remedy in words."""

from dataclasses import dataclass

import numpy as np

from dmae.calibration.epipolar import SOUND, Agreement, Hypothesis, Pairs, mean_agreement, pairs_to_compare, score_pairs
from dmae.calibration.faults import Correction, Fault
from dmae.calibration.world import UPRIGHT, Floor, relative_size, upright_direction
from dmae.data.cameras import CameraRig
from dmae.formats.config import METRES, Convention, LengthUnit, UpDirection
from dmae.numerics.statistics import mean_known

MIN_DETECTIONS = 20
"""Smallest number of detections for which a pair of views is judged."""
_SOUND_TILT_DEG = 0.3  # A world has a fault if the whole interval of its tilt is above this
_INSIDE = 0.3  # Share of joints inside the image above which a camera is expected to see the people of the others


@dataclass(frozen=True)
class Finding:
    """A fault of some cameras."""

    fault: Fault  # The fault
    cameras: tuple[str, ...]  # Names of the cameras that have it
    evidence: str  # The reason for the finding
    remedy: str  # The change that corrects it
    # Possible faults, one of which is present, if the recording does not determine which
    alternatives: tuple[Fault, ...] = ()


def corrected_fault(
    correction: Correction,
    before: Hypothesis,
    convention: Convention | None,
    offsets: list[int] | None,
    frames: np.ndarray,
) -> Finding:
    """Return the finding of a fault of `before` that was corrected, judged over frames (S,).

    The convention of the files is None if the format has no options for it. Offsets (V,) are as in `remedy`.
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
    """Return cameras that see matched people (m, J, 3) but disagree, by index, and those that see none, by name."""
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
    """Return findings of a wrong unit or vertical axis, from matched people (m, J, 3), and what was not
    decided.

    `has_options` is whether unit and up are options of the files' format.
    """
    findings, unknown, names = [], (), hypothesis.rig.names
    ratio, standing = relative_size(people, hypothesis.skeleton), upright_direction(people, hypothesis.skeleton)
    if ratio is None:
        unknown += ("too few people are measured to determine the unit of length",)
    elif what := unit_remedy(ratio, hypothesis.convention, has_options):
        findings.append(Finding(Fault.unit, names, f"people are {ratio:.3g} times as large as adults", what))
    if standing is None or standing[1] < UPRIGHT:
        unknown += ("too few people stand upright to determine the vertical axis",)
    elif what := up_remedy(standing[0], hypothesis.convention, has_options):
        axis = ", ".join(f"{x:.2f}" for x in standing[0])
        findings.append(Finding(Fault.up, names, f"people stand along ({axis}), not along z", what))
    return findings, unknown


def tilt_fault(floor: Floor, names: tuple[str, ...]) -> list[Finding]:
    """Return the finding of a tilted world for all cameras, if it is one. Its height is the calibrator's choice."""
    if floor.tilt_deg is None or floor.tilt_interval_deg[0] <= _SOUND_TILT_DEG:
        return []
    low, high = floor.tilt_interval_deg
    axis = ", ".join(f"{x:.3f}" for x in floor.up)
    evidence = (
        f"feet and bodies have ({axis}) as the vertical, {floor.tilt_deg:.1f} degrees from z "
        f"(95 %: {low:.1f} to {high:.1f})"
    )
    what = "dmae calibrate with the same data refine.extrinsics=false refine.level=true, or dmae capture level=true"
    return [Finding(Fault.tilted, names, evidence, what)]


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


_IN_DETECTIONS = {
    Fault.mirrored: "replace x by width - 1 - x (and exchange left and right joints if the images were mirrored "
    "before people were detected), or detect in the images as filmed",
    Fault.flipped: "replace y by height - 1 - y: rows count from the top",
    Fault.upside_down: "replace x, y by width - 1 - x, height - 1 - y, or turn the images before detecting",
    Fault.turned_left: "replace x, y by width - 1 - y, x, or turn the images back before detecting",
    Fault.turned_right: "replace x, y by y, height - 1 - x, or turn the images back before detecting",
    Fault.swapped_axes: "exchange x and y: column first, then row",
}
_IN_CALIBRATION = {
    Fault.inverse: "invert the extrinsics: R -> R^T, t -> -R^T t",
    Fault.centre: "t holds the camera's centre C: write t = -R C",
    Fault.transposed_rotation: "transpose R and leave t as it is",
    Fault.focal: "exchange fx and fy (K[0][0] and K[1][1])",
    Fault.principal: "exchange cx and cy (K[0][2] and K[1][2])",
    Fault.undistorted: "set the distortion to 0: the detections come from undistorted images",
    Fault.distortion_sign: "change the sign of the distortion coefficients",
}


def camera_names(rig: CameraRig, views: tuple[int, ...]) -> str:
    """Return cameras by name: "all cameras", "camera a" or "cameras a, b"."""
    if len(views) == len(rig):
        return "all cameras"
    return f"camera{'s' * (len(views) > 1)} {', '.join(rig.names[view] for view in views)}"


def remedy(correction: Correction, before: Convention, has_options: bool, offsets: list[int] | None) -> str:
    """Return the remedy for a fault of geometry or time, as text.

    Args:
        before: The assumed convention of the extrinsics in the files.
        has_options: Whether unit, up and inverse are options of the files' format.
        offsets: Frames by which detections are already delayed; None if some cameras of the files are not read.
    """
    rig, views, fault = correction.hypothesis.rig, correction.views, correction.fault
    names = camera_names(rig, views)
    if fault == Fault.inverse and has_options and len(views) == len(rig):
        return f"data.inverse={str(not before.inverse).lower()}"
    if fault == Fault.delay:
        delay = correction.hypothesis.offsets
        if offsets is not None:
            return f"data.offsets={[int(k) for k in delay + offsets]}".replace(" ", "")
        return "add to data.offsets " + ", ".join(f"{delay[view]:+d} for camera {rig.names[view]}" for view in views)
    if fault == Fault.order:
        a, b = (rig.names[view] for view in views)
        return (
            f"exchange the detections of cameras {a} and {b} (rename their files or folders), or these two names in "
            "the calibration"
        )
    if fault == Fault.scale:
        width, height = np.round(correction.amount * rig.size[views[0]]).astype(int)
        return (
            f"in the calibration of {names}, multiply fx, fy, cx, cy and the image size by {correction.amount:.4g}, or "
            f"detect in images of the size that was calibrated, not of about {width} x {height} px"
        )
    if fault == Fault.distorted:
        k1 = f"k1 is about {correction.amount:.2f}"
        return f"add the lens of {names} to the calibration ({k1}), or detect in undistorted images"
    if fault in _IN_DETECTIONS:
        return f"in the detections of {names}, {_IN_DETECTIONS[fault]}"
    return f"in the calibration of {names}, {_IN_CALIBRATION[fault]}"


def unit_remedy(ratio: float, before: Convention, has_options: bool) -> str | None:
    """Return the remedy for people that are `ratio` times as large as humans, as text; None if their size is right."""
    low, high = 0.45, 1.6
    if low <= ratio <= high:
        return None
    for unit, metres in METRES.items():
        if has_options and low <= ratio * metres / METRES[before.unit] <= high:
            return f"data.unit={unit}"
    power = 10.0 ** -np.round(np.log10(ratio))
    if low <= ratio * power <= high:
        length = {0.001: LengthUnit.mm, 0.01: LengthUnit.cm}.get(power * METRES[before.unit])
        reason = f": they are in {length}" if length else ""
        return f"multiply the translations of all cameras by {power:g}{reason}"
    return (
        f"multiply the translations of all cameras by about {1 / ratio:.2g}: was the square of the calibration board "
        "measured, and in the same unit?"
    )


def up_remedy(direction: np.ndarray, before: Convention, has_options: bool) -> str | None:
    """Return the remedy if people stand along `direction` (3,) instead of z, as text; None if they stand along z."""
    steep = 0.8
    if direction[2] >= steep:
        return None
    axis = before.written_points(direction) * METRES[before.unit]
    for up in UpDirection:
        if Convention(up=up).points(axis)[2] >= steep:
            if has_options:
                return f"data.up={up}"
            R = Convention(up=up).points(np.eye(3)).T.round().astype(int).tolist()
            return f"in all extrinsics, replace R by R Q^T, where Q = {R} turns {up} into z"
    components = ", ".join(f"{x:.2f}" for x in axis)
    return f"turn the world of the calibration so that ({components}) becomes z: data.up has no name for it"
