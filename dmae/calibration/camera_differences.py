"""Findings of single cameras that differ from their calibration: kind, amount and evidence of each difference."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import ttest_rel

from dmae.calibration.adjustment.bundle import adjust
from dmae.calibration.adjustment.examination import BODIES, PARAMETERS, CameraDifference, Examination, Kind, examine
from dmae.calibration.adjustment.freedom import Freedom
from dmae.calibration.adjustment.image_tracks import ImageTracks
from dmae.calibration.adjustment.matching import match_tracks
from dmae.calibration.adjustment.observations import Observations
from dmae.calibration.adjustment.parameters import CENTRE, FOCAL, K1, OFFSET, ROTATION, Calibration, Q
from dmae.calibration.corrections import Correction
from dmae.calibration.faults import Fault
from dmae.calibration.findings import Finding
from dmae.calibration.hypothesis import Hypothesis
from dmae.calibration.remedies import remedy

_FAULTS = {
    Kind.moved: Fault.moved,
    Kind.turned: Fault.turned,
    Kind.displaced: Fault.displaced,
    Kind.focal: Fault.focal_length,
    Kind.lens: Fault.lens,
    Kind.late: Fault.delay,
}
_SMALLEST = {
    Kind.moved: 0.015,
    Kind.turned: np.radians(0.2),
    Kind.focal: 0.01,
    Kind.lens: 0.03,
    Kind.late: 0.6,
    Kind.displaced: 0.015,
}
"""m, rad, relative, k1, frames; a calibration with smaller differences counts as correct."""
_MIN_BODIES = 40
_LENS_GAIN, _CHANCE = 1.03, 0.001
"""Smallest ratio of the costs before and after a change of lenses, and largest probability of a coincidence."""
_DETERMINED_BY = {
    Kind.moved: "people who walk towards this camera and away from it",
    Kind.turned: "people who walk towards this camera and away from it",
    Kind.displaced: "people who walk towards this camera and away from it",
    Kind.focal: "a calibration board in the image of this camera, or people at different depths",
    Kind.lens: "people, or a calibration board, near the edges of this camera's image",
    Kind.late: "people who move fast across this camera's image, or a light or sound at the start",
}


@dataclass(frozen=True)
class CameraFit:
    """How one camera fits the people that all cameras measure.

    Attributes:
        camera: Its name.
        residual: Median distance between detection and reprojection, px; None if it shares too few people.
        limits: By kind of difference (`moved` m, `turned` degrees, `focal` relative, `lens` k1, `late` frames) the
            smallest that is certainly noticed in this recording, in any direction; None if no difference is.
    """

    camera: str
    residual: float | None
    limits: dict[str, float | None]


@dataclass(frozen=True)
class Named:
    """A camera that differs from its calibration.

    Attributes:
        finding: The finding.
        hypothesis: Cameras and detections with the difference undone.
        view: The camera.
    """

    finding: Finding
    hypothesis: Hypothesis
    view: int


def examined(hypothesis: Hypothesis) -> tuple[Examination, ImageTracks] | None:
    """Examine the cameras of a hypothesis. Return None if too few people are seen by two of them."""
    if len(hypothesis.rig) < 2:
        return None
    tracks = match_tracks(hypothesis.clip())
    found = examine(tracks, Calibration.of(hypothesis.rig)) if tracks.xy.shape[1] else None
    return found and (found, tracks)


def named_camera(
    hypothesis: Hypothesis, found: Examination, tracks: ImageTracks, offsets: list[int] | None
) -> Named | None:
    """Return the camera that an examination names, if it differs by more than correct calibrations do.

    Args:
        offsets: (V,) frames by which detections are delayed already, see `remedy`.
    """
    kinds = [each for each in found.kinds if _size(each, hypothesis.fps) >= _SMALLEST[each.kind]]
    if not kinds or len(kinds) < len(found.kinds):
        return None
    best, name = kinds[0], hypothesis.rig.names[kinds[0].view]
    fault = _FAULTS[best.kind] if len(kinds) == 1 else Fault.differs
    # The axes of the world, including its vertical, do not change.
    step = np.zeros((len(hypothesis.rig), Q))
    step[best.view] = best.step
    frames = int(np.rint(best.step[OFFSET] * hypothesis.fps))
    corrected = Calibration.of(hypothesis.rig).changed(step)
    before, after = (_residual(tracks, each, best.view) for each in (Calibration.of(hypothesis.rig), corrected))
    undone = replace(hypothesis, rig=corrected.rig)
    if frames:
        delay = np.zeros(len(step), int)
        delay[best.view] = -frames
        undone = undone.delayed(delay)
    amounts = " or ".join(_amount(each, hypothesis.fps) for each in kinds)
    evidence = (
        f"{amounts}; undone, the reprojection error of camera {name} is {after:.1f} px instead of {before:.1f} px"
    )
    if len(kinds) > 1:
        by = dict.fromkeys(_DETERMINED_BY[each.kind] for each in kinds)
        evidence += f"; these fit about equally well; to distinguish them, record: {'; or '.join(by)}"
    alternatives = tuple(_FAULTS[each.kind] for each in kinds) if len(kinds) > 1 else ()
    finding = Finding(fault, (name,), evidence, _remedy(kinds, undone, hypothesis, offsets), alternatives)
    return Named(finding, undone, best.view)


def camera_fits(hypothesis: Hypothesis, found: Examination | None) -> tuple[CameraFit, ...]:
    """Return the fit of each camera, and the smallest differences that would be noticed."""
    if found is None:
        return ()
    residual = found.base.error_px.swapaxes(0, 1).reshape(len(hypothesis.rig), -1)
    fits = []
    for view, name in enumerate(hypothesis.rig.names):
        known = residual[view][np.isfinite(residual[view])]
        limits = {}
        for kind in (Kind.moved, Kind.turned, Kind.focal, Kind.lens, Kind.late):
            unit = {Kind.turned: np.degrees(1), Kind.late: hypothesis.fps}.get(kind, 1)
            limit = max(float(found.limits[kind][view]) * unit, _SMALLEST[kind] * (unit if kind == Kind.turned else 1))
            limits[kind.name] = limit if np.isfinite(limit) and len(known) else None
        fits.append(CameraFit(name, float(np.median(known)) if len(known) else None, limits))
    return tuple(fits)


def undetermined(hypothesis: Hypothesis, found: Examination | None) -> tuple[str, ...]:
    """Return the suspicions of an examination that the recording does not decide, as text."""
    if found is None:
        return ("too few people are seen by two cameras to find small differences: some seconds are needed",)
    best = max((each for each in found.tried if each.view in found.suspects), key=lambda each: each.gain, default=None)
    # Every calibration has small errors. Smaller differences than this are not reported.
    if best is None or _size(best, hypothesis.fps) < 2 * _SMALLEST[best.kind]:
        return ()
    names = " and ".join(hypothesis.rig.names[view] for view in found.suspects)
    return (
        f"one of the cameras {names} seems to differ from its calibration; this recording does not determine which; "
        "use more cameras, or people in more places",
    )


def lens_matters(before: Hypothesis, after: Hypothesis) -> bool:
    """Return whether other lenses fit better, for any poses of the cameras."""
    tracks = match_tracks(after.clip())
    observations = Observations.of(tracks, Calibration.of(after.rig), BODIES)
    if len(observations) < _MIN_BODIES:
        return True
    poses = Freedom.of(len(after.rig), rotation=True, centre=True)
    poses.prior[:, CENTRE], poses.prior[:, ROTATION] = 0.1, np.radians(1)
    train, test = np.arange(len(observations)) % 20 < 10, np.arange(len(observations)) % 20 >= 10
    costs = []
    for rig in (before.rig, after.rig):
        fitted = adjust(observations.at(train), Calibration.of(rig), poses, iterations=10, tolerance=1e-4)
        costs.append(adjust(observations.at(test), fitted.calibration, iterations=10, tolerance=1e-4).cost)
    worse, better = costs
    return worse.mean() > better.mean() * _LENS_GAIN and ttest_rel(worse, better).pvalue < _CHANCE


def _residual(tracks: ImageTracks, calibration: Calibration, view: int) -> float:
    observations = Observations.of(tracks, calibration, BODIES)
    return float(np.nanmedian(adjust(observations, calibration, iterations=8, tolerance=1e-4).error_px[:, view]))


def _size(difference: CameraDifference, fps: float) -> float:
    step = difference.step
    if difference.kind == Kind.displaced:
        # 1.5 cm or 0.2 degrees, whichever is more.
        turned = np.linalg.norm(step[ROTATION]) * _SMALLEST[Kind.moved] / _SMALLEST[Kind.turned]
        return max(float(np.linalg.norm(step[CENTRE])), float(turned))
    size = float(np.linalg.norm(step[list(PARAMETERS[difference.kind])]))
    return size * fps if difference.kind == Kind.late else size


def _amount(difference: CameraDifference, fps: float) -> str:
    """Return the kind of a difference and its amount, as text."""
    step = difference.step
    moved, turned = 100 * np.linalg.norm(step[CENTRE]), np.degrees(np.linalg.norm(step[ROTATION]))
    return {
        Kind.moved: f"it is {moved:.1f} cm from its position in the calibration",
        Kind.turned: f"it is turned by {turned:.2f} degrees",
        Kind.displaced: f"it is {moved:.1f} cm from its position in the calibration, turned by {turned:.2f} degrees",
        Kind.focal: f"its focal length is {100 * np.expm1(step[FOCAL]):+.1f} %",
        Kind.lens: f"its k1 is larger by {step[K1]:+.2f}",
        Kind.late: f"it is {-step[OFFSET] * fps:+.1f} frames off",
    }[difference.kind]


def _remedy(
    kinds: list[CameraDifference], undone: Hypothesis, hypothesis: Hypothesis, offsets: list[int] | None
) -> str:
    """Return the remedy that undoes a difference, as text."""
    view = kinds[0].view
    name = hypothesis.rig.names[view]
    if len(kinds) == 1 and kinds[0].kind == Kind.late:
        return remedy(Correction(Fault.delay, (view,), undone), hypothesis.convention, True, offsets)
    option = {Kind.focal: " focal=true", Kind.lens: " distortion=true", Kind.late: " offsets=true"}
    options = "".join(option.get(each.kind, "") for each in kinds[:1])
    what = {
        Kind.focal: f"fx and fy of camera {name} times {np.exp(kinds[0].step[FOCAL]):.4f}",
        Kind.lens: f"k1 of camera {name} {hypothesis.rig.dist[view, 0] + kinds[0].step[K1]:.2f}",
    }.get(kinds[0].kind, f"calibrate camera {name} again")
    return f"{what}, or run dmae calibrate with the same data{options}"
