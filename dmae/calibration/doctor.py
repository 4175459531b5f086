"""The doctor: checks whether the cameras and the detections of a recording agree, and finds the faults if not."""

from dataclasses import dataclass, replace

import numpy as np

from dmae.calibration.adjustment_problem import Calibration, ImageTracks
from dmae.calibration.epipolar import (
    CHECKED_FRAMES,
    Hypothesis,
    Pairs,
    ViewSample,
    mean_agreement,
    measure_agreement,
    pairs_to_compare,
    score_pairs,
    triangulate_matches,
)
from dmae.calibration.examination import (
    CameraFit,
    Examination,
    Kind,
    Named,
    camera_fits,
    examined,
    lens_matters,
    named_camera,
    undetermined,
)
from dmae.calibration.faults import Correction, Fault, find_fault
from dmae.calibration.findings import (
    MIN_DETECTIONS,
    Finding,
    corrected_fault,
    disagreeing_cameras,
    size_faults,
    tilt_fault,
    unexplained_fault,
    world_faults,
)
from dmae.calibration.world import Floor, find_floor, relative_size
from dmae.data.clip import Clip
from dmae.formats.config import Convention
from dmae.formats.reading import shift_views
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture

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


def diagnose(
    clip: Clip, convention: Convention | None = None, offsets: list[int] | None = None, max_offset: int = 50
) -> Diagnosis:
    """Compare cameras and detections, and find the usual faults.

    Args:
        clip: F frames of V cameras; only cameras and detections are read.
        convention: How the files were assumed to write the calibration; None if the format has no such options.
        offsets: (V,) frames by which the files' detections are already delayed.
            max_offset: Largest time offset between two cameras that is tried, in frames, both ways; negative is a
            ValueError.
    """
    if max_offset < 0:
        raise ValueError(f"max_offset={max_offset}: expected a number of frames, 0 or more")
    hypothesis = Hypothesis.of(clip, convention or Convention())
    as_read = hypothesis.xy
    pairs = pairs_to_compare(len(clip.rig))
    frames = hypothesis.sample_frames(CHECKED_FRAMES)
    detected = np.isfinite(hypothesis.xy[..., 0]).any((0, 2, 3))
    unknown = tuple(
        f"camera {name} detects no people" for name, some in zip(clip.rig.names, detected, strict=True) if not some
    )
    if len(clip.rig) < 2 or not len(frames):
        reason = "there is one camera" if len(clip.rig) < 2 else "no two cameras detect people in the same frame"
        return Diagnosis((), (), (), (*unknown, f"nothing can be compared: {reason}"))
    fits = _pair_fits(hypothesis, pairs, frames)
    if sum(fit.detections for fit in fits) < MIN_DETECTIONS:
        return Diagnosis(fits, fits, (), (*unknown, "nothing can be compared: too few people are seen by two cameras"))
    findings, sensitivity, named = [], 0.0, set()
    # A fault can hide another one, and every camera can have a fault.
    for _ in range(len(clip.rig) + 2):
        correction, sensitivity = find_fault(hypothesis, max_offset)
        examination = _examine(hypothesis, correction)
        camera = None
        if examination is not None:
            camera = named_camera(hypothesis, *examination, offsets)
            if camera is not None and (camera.view in named or not _explains(camera, correction, hypothesis, pairs)):
                camera = None
        if camera is not None:
            findings.append(camera.finding)
            named.add(camera.view)
            hypothesis = camera.hypothesis
            continue
        if correction is None or not _confirmed(correction, hypothesis, examination and examination[0], pairs):
            break
        findings.append(corrected_fault(correction, hypothesis, convention, offsets, frames))
        hypothesis = correction.hypothesis
        if correction.fault == Fault.inverse and len(correction.views) == len(clip.rig):
            written = replace(hypothesis.convention, inverse=not hypothesis.convention.inverse)
            hypothesis = replace(hypothesis, convention=written)
    frames = hypothesis.sample_frames(CHECKED_FRAMES)
    sample = ViewSample.of(hypothesis, frames)
    found = measure_agreement(sample, pairs)
    people = triangulate_matches(sample, pairs, found)
    disagreeing, apart = disagreeing_cameras(hypothesis, people, found, pairs)
    floor = None
    if disagreeing:
        findings.append(unexplained_fault(hypothesis, disagreeing))
    unknown += tuple(f"camera {name} sees no people that the others see" for name in apart)
    if len(disagreeing) < len(clip.rig):
        if sensitivity < _MIN_SENSITIVITY:
            unknown += ("people move too little to decide whether the cameras are synchronised",)
        more, undecided = world_faults(hypothesis, people, convention is not None)
        findings += more
        unknown += undecided
        if not more:
            floor = find_floor(
                capture(_corrected(clip, hypothesis, hypothesis.xy is not as_read), CaptureConfig()), clip.fps
            )
            findings += tilt_fault(floor, clip.rig.names)
    findings += size_faults(hypothesis)
    if not disagreeing:
        unknown += undetermined(hypothesis, examination and examination[0])
    cameras = camera_fits(hypothesis, examination and examination[0])
    return Diagnosis(fits, _pair_fits(hypothesis, pairs, frames), tuple(findings), unknown, cameras, floor)


def _corrected(clip: Clip, hypothesis: Hypothesis, changed: bool) -> Clip:
    """Return the corrected clip, with all its joints if the corrections concern only cameras and clocks."""
    if changed:
        return hypothesis.clip()
    found = Clip(clip.id, clip.fps, hypothesis.rig, clip.detections)
    return shift_views(found, hypothesis.offsets.tolist())


def _examine(hypothesis: Hypothesis, correction: Correction | None) -> tuple[Examination, ImageTracks] | None:
    """Examine single cameras, unless a fault of all cameras explains that people cannot be measured."""
    if correction is not None and len(correction.views) == len(hypothesis.rig) and correction.fault in _EXCLUSIVE:
        return None
    pairs, sample = (
        pairs_to_compare(len(hypothesis.rig)),
        ViewSample.of(hypothesis, hypothesis.sample_frames(CHECKED_FRAMES)),
    )
    people = triangulate_matches(sample, pairs, measure_agreement(sample, pairs))
    ratio = relative_size(people, hypothesis.skeleton)
    if ratio is None or 0.5 < ratio < 2:
        return examined(hypothesis)
    # Give people that are far from human size this size.
    pose = hypothesis.rig.cam_from_world.copy()
    pose[:, :3, 3] *= 1 / ratio
    return examined(replace(hypothesis, rig=replace(hypothesis.rig, cam_from_world=pose)))


def _explains(camera: Named, correction: Correction | None, hypothesis: Hypothesis, pairs: Pairs) -> bool:
    """Return whether a difference of one camera explains the recording better than the usual faults do."""
    if correction is None:
        return True
    ours, other = _agreements(hypothesis, pairs, camera.hypothesis, correction.hypothesis)
    return ours > other + (-_SAME if correction.fault in _WITH_AMOUNT else _SAME)


def _confirmed(correction: Correction, hypothesis: Hypothesis, found: Examination | None, pairs: Pairs) -> bool:
    """Return whether a fault of lenses or scale explains more than wrong poses of cameras, which are similar.

    A pose may explain more and still not be named, if the recording is too short for certainty.
    """
    if correction.fault in _LENSES:
        return lens_matters(hypothesis, correction.hypothesis)
    if correction.fault != Fault.scale or len(correction.views) > 1 or found is None:
        return True
    tried = [each for each in found.tried if each.view in correction.views and each.kind in _POSES]
    if not tried:
        return True
    best = max(tried, key=lambda each: each.gain)
    posed = replace(hypothesis, rig=Calibration.of(hypothesis.rig).with_step(best.view, best.step).rig)
    scaled, other = _agreements(hypothesis, pairs, correction.hypothesis, posed)
    return scaled > other + _SAME


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
