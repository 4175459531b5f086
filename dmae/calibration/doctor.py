"""The doctor: checks whether the cameras and the detections of a recording agree, and finds the faults if not.

In this order: the diagnosis, single cameras that differ from their calibration, and findings with their remedies.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.stats import ttest_rel

from dmae.calibration.bundle_adjustment import (
    CENTRE,
    FOCAL,
    K1,
    OFFSET,
    ROTATION,
    Calibration,
    Freedom,
    ImageTracks,
    Observations,
    adjust,
)
from dmae.calibration.epipolar import (
    CHECKED_FRAMES,
    SOUND,
    Agreement,
    Hypothesis,
    Pairs,
    ViewSample,
    mean_agreement,
    measure_agreement,
    pairs_to_compare,
    score_pairs,
    triangulate_matches,
)
from dmae.calibration.examination import BODIES, PARAMETERS, CameraDifference, Examination, Kind, examine
from dmae.calibration.faults import Correction, Fault, find_fault
from dmae.calibration.matching import match_tracks
from dmae.calibration.world import UPRIGHT, Floor, find_floor, relative_size, upright_direction
from dmae.data.cameras import CameraRig, camera_label
from dmae.data.clip import Clip
from dmae.formats.config import METRES, Convention, LengthUnit, UpDirection
from dmae.formats.reading import shift_views
from dmae.numerics.statistics import mean_known
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

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
    # Faults of which one is present; the recording does not show which
    alternatives: tuple[Fault, ...] = ()

    def __str__(self) -> str:
        return f"{self.fault}: {', '.join(self.cameras)}\n   because {self.evidence}\n   correction: {self.remedy}"


@dataclass(frozen=True)
class CameraFit:
    """How one camera fits the people that all cameras measure."""

    camera: str  # Its name
    residual: float | None  # Median distance between detection and reprojection, px; None if it shares too few people
    # By kind of difference (`moved` m, `turned` degrees, `focal` relative, `lens` k1, `late` frames) the smallest that
    # is certainly noticed in this recording, in any direction; None if no difference is
    limits: dict[str, float | None]


_MIN_SENSITIVITY = 0.08
"""Smallest loss of agreement at wrong time offsets from which the doctor decides whether cameras are synchronised."""
_SAME = 0.005  # Largest difference in agreement between two explanations that count as equally good
_WITH_AMOUNT = (Fault.scale, Fault.distorted, Fault.delay)
_LENSES = (Fault.distorted, Fault.undistorted, Fault.distortion_sign)
_POSES = (Kind.moved, Kind.turned, Kind.displaced)
_EXCLUSIVE = (Fault.inverse, Fault.centre, Fault.transposed_rotation, *_LENSES, Fault.focal, Fault.principal)


@dataclass(frozen=True)
class PairFit:
    """The fit of two cameras with each other."""

    cameras: tuple[str, str]  # Their names
    # Median distance of joints from epipolar lines in detections that agree, px; None if none agree
    residual: float | None
    agreeing: float  # Share of detections that agree with one of the other camera, in frames where both detect people
    agreement: float  # Mean agreement of these detections, from 0 to 1
    detections: int  # Number of these detections


@dataclass(frozen=True)
class Diagnosis:
    """The faults of a recording, and the fit of its cameras."""

    pairs: tuple[PairFit, ...]  # Fit of the pairs of cameras in the recording as it was read
    corrected: tuple[PairFit, ...]  # The same with the findings corrected
    findings: tuple[Finding, ...]  # Faults, in the order in which to correct them; empty for a recording without faults
    unknown: tuple[str, ...]  # Questions that could not be decided, and why
    # Fit of each camera with the findings corrected, and the smallest differences that would be noticed
    cameras: tuple[CameraFit, ...] = ()
    # Height of the floor and vertical direction, with the findings corrected; None if people cannot be measured
    floor: Floor | None = None

    def __repr__(self) -> str:
        """Return what was found, in words."""
        found = [f"{number}. {finding}" for number, finding in enumerate(self.findings, 1)]
        return "\n".join([*(found or ["nothing found wrong"]), *(f"not known: {unknown}" for unknown in self.unknown)])


def diagnose(
    clip: Clip, convention: Convention | None = None, offsets: list[int] | None = None, max_offset: int = 50
) -> Diagnosis:
    """Compare cameras and detections, and find the usual faults.

    Args:
        clip: F frames of V cameras; only cameras and detections are read.
        convention: How the files were assumed to write the calibration; None if the format has no such options.
        offsets: (V,) frames by which the files' detections are already delayed.
        max_offset: Largest time offset between two cameras that is tried, in frames, both ways.

    Raises:
        ValueError: `max_offset` is negative.
    """
    if max_offset < 0:
        raise ValueError(f"max_offset={max_offset}: expected a number of frames, 0 or more")
    as_read = Hypothesis.of(clip, convention or Convention())
    pairs = pairs_to_compare(len(clip.rig))
    frames = as_read.sample_frames(CHECKED_FRAMES)
    detected = np.isfinite(as_read.xy[..., 0]).any((0, 2, 3))
    unknown = tuple(
        f"{camera_label(name)} detects no people"
        for name, some in zip(clip.rig.names, detected, strict=True)
        if not some
    )
    if len(clip.rig) < 2 or not len(frames):
        reason = "there is one camera" if len(clip.rig) < 2 else "no two cameras detect people in the same frame"
        return Diagnosis((), (), (), (*unknown, f"nothing can be compared: {reason}"))
    fits = _pair_fits(as_read, pairs, frames)
    if sum(fit.detections for fit in fits) < MIN_DETECTIONS:
        return Diagnosis(fits, fits, (), (*unknown, "nothing can be compared: too few people are seen by two cameras"))
    undone = _undo_faults(as_read, pairs, convention, offsets, max_offset)
    findings, hypothesis = list(undone.findings), undone.hypothesis
    unknown += undone.unknown
    frames = hypothesis.sample_frames(CHECKED_FRAMES)
    sample = ViewSample.of(hypothesis, frames)
    found = measure_agreement(sample, pairs)
    people = triangulate_matches(sample, pairs, found)
    disagreeing, apart = disagreeing_cameras(hypothesis, people, found, pairs)
    floor = None
    if disagreeing:
        findings.append(unexplained_fault(hypothesis, disagreeing))
    unknown += tuple(f"{camera_label(name)} sees no people that the others see" for name in apart)
    if len(disagreeing) < len(clip.rig):
        if undone.sensitivity < _MIN_SENSITIVITY:
            unknown += ("people move too little to decide whether the cameras are synchronised",)
        more, undecided = world_faults(hypothesis, people, convention is not None)
        findings += more
        unknown += undecided
        if not more:
            floor = find_floor(
                capture(_corrected(clip, hypothesis, hypothesis.xy is not as_read.xy), CaptureConfig()), clip.fps
            )
            findings += tilt_fault(floor, clip.rig.names)
    findings += size_faults(hypothesis)
    if not disagreeing:
        unknown += undetermined(hypothesis, undone.examination)
    cameras = camera_fits(hypothesis, undone.examination)
    return Diagnosis(fits, _pair_fits(hypothesis, pairs, frames), tuple(findings), unknown, cameras, floor)


class _Undone(NamedTuple):
    """Faults that were found and undone, one after the other."""

    findings: tuple[Finding, ...]
    hypothesis: Hypothesis  # Cameras and detections without these faults
    sensitivity: float  # How much agreement is lost at wrong time offsets, see `find_fault`
    examination: Examination | None  # The last one of single cameras; None if they could not be examined
    unknown: tuple[str, ...]  # Questions that could not be decided


def _undo_faults(
    hypothesis: Hypothesis, pairs: Pairs, convention: Convention | None, offsets: list[int] | None, max_offset: int
) -> _Undone:
    """Find and undo one fault after the other, until none is left: one can hide another, and each camera can have one.

    A single camera that differs from its calibration is a finding where this explains the recording better than the
    usual faults do.
    """
    findings: list[Finding] = []
    named: set[tuple[str, ...]] = set()
    unknown: tuple[str, ...] = ()
    sensitivity, examination, frames = 0.0, None, hypothesis.sample_frames(CHECKED_FRAMES)
    for _ in range(len(hypothesis.rig) + 2):
        correction, sensitivity = find_fault(hypothesis, max_offset)
        examination = camera = None
        if not _of_all_cameras(hypothesis, correction):
            size = _size_of_people(hypothesis)
            human = _scaled(hypothesis, 1 / size)
            if examined_cameras := examined(human):
                examination = examined_cameras[0]
                camera = named_camera(human, *examined_cameras, offsets)
                camera = camera and (camera[0], _scaled(camera[1], size))
        if camera and camera[0].cameras not in named and _explains(camera[1], correction, hypothesis, pairs):
            finding, hypothesis = camera
            findings.append(finding)
            named.add(finding.cameras)
            continue
        if correction is None:
            break
        if not _confirmed(correction, hypothesis, examination, pairs):
            if len(hypothesis.rig) == 2:
                unknown = (_TWO_DISAGREE.format(" and ".join(hypothesis.rig.names)),)
            break
        findings.append(corrected_fault(correction, hypothesis, convention, offsets, frames))
        hypothesis = correction.hypothesis
        if correction.fault == Fault.inverse and len(correction.views) == len(hypothesis.rig):
            written = replace(hypothesis.convention, inverse=not hypothesis.convention.inverse)
            hypothesis = replace(hypothesis, convention=written)
    return _Undone(tuple(findings), hypothesis, sensitivity, examination, unknown)


def _corrected(clip: Clip, hypothesis: Hypothesis, changed: bool) -> Clip:
    """Return the corrected clip, with all its joints if the corrections concern only cameras and clocks."""
    if changed:
        return hypothesis.clip()
    found = Clip(clip.id, clip.fps, hypothesis.rig, clip.detections)
    return shift_views(found, hypothesis.offsets.tolist())


def _of_all_cameras(hypothesis: Hypothesis, correction: Correction | None) -> bool:
    """Return whether a fault of all cameras explains that people cannot be measured."""
    return correction is not None and len(correction.views) == len(hypothesis.rig) and correction.fault in _EXCLUSIVE


def _size_of_people(hypothesis: Hypothesis) -> float:
    """Return the size of people relative to humans if it is far from 1, as in another unit; otherwise 1."""
    pairs = pairs_to_compare(len(hypothesis.rig))
    sample = ViewSample.of(hypothesis, hypothesis.sample_frames(CHECKED_FRAMES))
    people = triangulate_matches(sample, pairs, measure_agreement(sample, pairs))
    ratio = relative_size(people, hypothesis.skeleton)
    return 1.0 if ratio is None or 0.5 < ratio < 2 else ratio


def _scaled(hypothesis: Hypothesis, scale: float) -> Hypothesis:
    """Return the hypothesis in a world that is larger by a factor."""
    if scale == 1:
        return hypothesis
    pose = hypothesis.rig.cam_from_world.copy()
    pose[:, :3, 3] *= scale
    return replace(hypothesis, rig=replace(hypothesis.rig, cam_from_world=pose))


def _explains(undone: Hypothesis, correction: Correction | None, hypothesis: Hypothesis, pairs: Pairs) -> bool:
    """Return whether a difference of one camera, undone, explains the recording better than the usual faults do."""
    if correction is None:
        return True
    ours, other = _agreements(hypothesis, pairs, undone, correction.hypothesis)
    return ours > other + (-_SAME if correction.fault in _WITH_AMOUNT else _SAME)


def _confirmed(correction: Correction, hypothesis: Hypothesis, found: Examination | None, pairs: Pairs) -> bool:
    """Return whether a fault of lenses, scale or time explains more than wrong poses of cameras, which are similar.

    A pose may explain more and still not be named, if the recording is too short for certainty. In a short recording,
    other offsets of one camera may also make up for the wrong pose of another.
    """
    if correction.fault in _LENSES:
        return lens_matters(hypothesis, correction.hypothesis)
    several = len(hypothesis.rig) > 2
    scaled = correction.fault == Fault.scale and (len(correction.views) == 1 or not several)
    if not (scaled or correction.fault == Fault.delay) or found is None:
        return True
    views = correction.views if scaled and several else range(len(hypothesis.rig))
    tried = [each for each in found.tried if each.view in views and each.kind in _POSES]
    if not tried:
        return True
    best = max(tried, key=lambda each: each.gain)
    posed = replace(hypothesis, rig=Calibration.of(hypothesis.rig).with_step(best.view, best.step).rig)
    ours, other = _agreements(hypothesis, pairs, correction.hypothesis, posed)
    return ours > other + _SAME


def _agreements(hypothesis: Hypothesis, pairs: Pairs, *others: Hypothesis) -> list[float]:
    """Return the mean agreement of other hypotheses, in the frames sampled for the check of one hypothesis."""
    frames = hypothesis.sample_frames(CHECKED_FRAMES)
    return [mean_agreement(score_pairs(each, frames, pairs)) for each in others]


def _pair_fits(hypothesis: Hypothesis, pairs: Pairs, frames: np.ndarray) -> tuple[PairFit, ...]:
    """Return the fit of each pair of cameras in frames (S,)."""
    found = measure_agreement(ViewSample.of(hypothesis, frames), pairs)
    fits = []
    for index, (a, b) in enumerate(pairs):
        residual, detections = found.residual[found.pair == index], int(found.detections[index].sum())
        fits.append(
            PairFit(
                (hypothesis.rig.names[a], hypothesis.rig.names[b]),
                float(np.nanmedian(residual)) if len(residual) else None,
                2 * len(residual) / max(detections, 1),
                float(found.total[index].sum() / max(detections, 1)),
                detections,
            )
        )
    return tuple(fits)


# Single cameras that differ from their calibration

_TWO_DISAGREE = (
    "{} disagree, and one that moved, turned, zoomed or started late would explain it: calibrate them again, or record "
    "with a third camera, which tells these apart"
)
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
_LENS_GAIN, _LENS_CHANCE = 1.03, 0.001
"""Smallest ratio of the costs before and after a change of lenses, and largest probability of a coincidence."""
_DETERMINED_BY = {
    Kind.moved: "people who walk towards this camera and away from it",
    Kind.turned: "people who walk towards this camera and away from it",
    Kind.displaced: "people who walk towards this camera and away from it",
    Kind.focal: "a calibration board in the image of this camera, or people at different depths",
    Kind.lens: "people, or a calibration board, near the edges of this camera's image",
    Kind.late: "people who move fast across this camera's image, or a light or sound at the start",
}


def examined(hypothesis: Hypothesis) -> tuple[Examination, ImageTracks] | None:
    """Examine the cameras of a hypothesis. Return None if too few people are seen by two of them."""
    if len(hypothesis.rig) < 2:
        return None
    tracks = match_tracks(hypothesis.clip())
    found = examine(tracks, Calibration.of(hypothesis.rig)) if tracks.xy.shape[1] else None
    return None if found is None else (found, tracks)


def named_camera(
    hypothesis: Hypothesis, found: Examination, tracks: ImageTracks, offsets: list[int] | None
) -> tuple[Finding, Hypothesis] | None:
    """Return the camera that differs by more than correct ones, and cameras and detections with this undone.

    Detections are late by offsets (V,), see `remedy`.
    """
    kinds = [each for each in found.kinds if _size(each, hypothesis.fps) >= _SMALLEST[each.kind]]
    if not kinds or len(kinds) < len(found.kinds):
        return None
    best, name = kinds[0], hypothesis.rig.names[kinds[0].view]
    fault = _FAULTS[best.kind] if len(kinds) == 1 else Fault.differs
    # The axes of the world, including its vertical, do not change.
    frames = int(np.rint(best.step[OFFSET] * hypothesis.fps))
    corrected = Calibration.of(hypothesis.rig).with_step(best.view, best.step)
    before, after = (_residual(tracks, each, best.view) for each in (Calibration.of(hypothesis.rig), corrected))
    undone = replace(hypothesis, rig=corrected.rig)
    if frames:
        undone = undone.delayed(np.where(np.arange(len(hypothesis.rig)) == best.view, -frames, 0))
    amounts = " or ".join(_amount(each, hypothesis.fps) for each in kinds)
    now = f"{after:.1f} px instead of {before:.1f} px"
    evidence = f"{amounts}; undone, the reprojection error of {camera_label(name)} is {now}"
    if len(kinds) > 1:
        by = dict.fromkeys(_DETERMINED_BY[each.kind] for each in kinds)
        evidence += f"; these fit about equally well; to distinguish them, record: {'; or '.join(by)}"
    alternatives = tuple(_FAULTS[each.kind] for each in kinds) if len(kinds) > 1 else ()
    return Finding(fault, (name,), evidence, _remedy(kinds, undone, hypothesis, offsets), alternatives), undone


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
    names = [camera_label(hypothesis.rig.names[view]) for view in found.suspects]
    if len(names) == 1:
        why = "it would fit better with another one, but not clearly"
    else:
        why = "one of them would fit better with another one, and the recording does not show which"
    question = f"whether {' or '.join(names)} differs from its calibration: {why}"
    return (f"{question}; record for longer, with more cameras, or people in more places",)


def lens_matters(before: Hypothesis, after: Hypothesis) -> bool:
    """Return whether other lenses fit better, for any poses of the cameras."""
    tracks = match_tracks(after.clip())
    observations = Observations.of(tracks, BODIES)
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
    return worse.mean() > better.mean() * _LENS_GAIN and ttest_rel(worse, better).pvalue < _LENS_CHANCE


def _residual(tracks: ImageTracks, calibration: Calibration, view: int) -> float:
    observations = Observations.of(tracks, BODIES)
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
    option = {Kind.focal: "focal", Kind.lens: "distortion", Kind.late: "offsets"}.get(kinds[0].kind)
    options = f" refine.{option}=true" if option else ""
    what = {
        Kind.focal: f"fx and fy of {camera_label(name)} times {np.exp(kinds[0].step[FOCAL]):.4f}",
        Kind.lens: f"k1 of {camera_label(name)} {hypothesis.rig.dist[view, 0] + kinds[0].step[K1]:.2f}",
    }.get(kinds[0].kind, f"calibrate {camera_label(name)} again")
    return f"{what}, or run dmae calibrate with the same data{options}"


# Findings and their remedies


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
    """Return the indices of cameras that disagree on matched people (m, J, 3), and the names of those that see none."""
    views, ends = len(hypothesis.rig), np.asarray(pairs)
    counted = found.detections.sum(1)
    agreement = np.where(counted >= MIN_DETECTIONS, found.total.sum(1) / np.maximum(counted, 1), np.nan)
    best = [np.nanmax(agreement[(ends == view).any(1)], initial=-1) for view in range(views)]
    usual = np.median([x for x in best if x >= 0] or [0])
    suspects = [view for view, x in enumerate(best) if 0 <= x < max(SOUND / 2, min(SOUND, usual / 2))]
    if len(suspects) == views:
        return tuple(suspects), ()
    disagreeing, apart = [], []
    for view in suspects:
        # Check whether this camera looks at the people that the other cameras measure.
        others = people[~(ends[found.pair] == view).any(1)].reshape(1, -1, 3)
        camera = hypothesis.rig[[view]]
        inside = camera.inside(camera.project(others)[0]).sum() / max(np.isfinite(others).all(-1).sum(), 1)
        if inside > _INSIDE:
            disagreeing.append(view)
        else:
            apart += camera.names
    return tuple(disagreeing), tuple(apart)


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
    findings, unknown, names = [], [], hypothesis.rig.names
    ratio, standing = relative_size(people, hypothesis.skeleton), upright_direction(people, hypothesis.skeleton)
    if ratio is None:
        unknown.append("too few people are measured to determine the unit of length")
    elif what := unit_remedy(ratio, hypothesis.convention, has_options):
        findings.append(Finding(Fault.unit, names, f"people are {ratio:.3g} times as large as adults", what))
    if standing is None or standing[1] < UPRIGHT:
        unknown.append("too few people stand upright to determine the vertical axis")
    elif what := up_remedy(standing[0], hypothesis.convention, has_options):
        axis = ", ".join(f"{x:.2f}" for x in standing[0])
        findings.append(Finding(Fault.up, names, f"people stand along ({axis}), not along z", what))
    return findings, tuple(unknown)


def tilt_fault(floor: Floor, names: tuple[str, ...]) -> list[Finding]:
    """Return the finding of a tilted world for all cameras, if it is one. Its height is the calibrator's choice."""
    if floor.up is None or floor.tilt_deg is None or floor.tilt_interval_deg is None:
        return []
    if floor.tilt_interval_deg[0] <= _SOUND_TILT_DEG:
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
        return "add to data.offsets " + ", ".join(
            f"{delay[view]:+d} for {camera_label(rig.names[view])}" for view in views
        )
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
        length = {0.001: LengthUnit.mm, 0.01: LengthUnit.cm}.get(float(power * METRES[before.unit]))
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
