"""Statistics of a detector's errors, measured in the same way on real and on simulated recordings."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert, convert_detections
from dmae.data.skeleton import Skeleton
from dmae.formats.reading import Clips, DataConfig
from dmae.numerics.filling import fill_world, smooth
from dmae.numerics.paths import gap_lengths, linear
from dmae.numerics.statistics import mean_known
from dmae.parallel import in_parallel
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from synth.detector.config import ErrorReference
from synth.detector.parts import kind_of

MATCHED = 0.2
"""A detection matches a person if the median distance of their joints is below this many heights of the person."""
FRAGMENT = 0.15
"""An unmatched detection within this many heights of a person's joints is a fragment of that person."""
_MIN_JOINTS = 4
"""Detections with fewer joints are noise. Persons with fewer joints in an image are not matched there."""


@dataclass(frozen=True)
class Match:
    """The assignment of D detections to P persons, in V views."""

    xy: np.ndarray  # (F, V, P, J, 2) joints of the reference, px; NaN where unknown or outside the image
    height: np.ndarray  # (F, V, P) height of the person, px; NaN where too few joints are in the image
    found: np.ndarray  # (F, V, P, J, 2) detected joints of each person, px; NaN where missed
    score: np.ndarray  # (F, V, P, J) confidences of the detected joints; NaN where missed
    matched: np.ndarray  # (F, V, P) True where a person in the image has a detection
    left_over: np.ndarray  # (F, V, D) True for detections without a person
    near: np.ndarray  # (F, V, D) True for detections without a person that are near a person


def match_detections(clip: Clip, reference: Poses3D) -> Match:
    """Assign to each person of the reference at most one detection of each view, by the median distance of joints."""
    seen, score = clip.detections.xy.astype(np.float64), clip.detections.score
    xy, _ = clip.rig.project(reference.xyz)
    # The height is computed from all known joints of a person. The detector cannot find joints outside the image.
    known = ~np.isnan(xy[..., 1])
    high, low = np.where(known, xy[..., 1], -np.inf).max(-1), np.where(known, xy[..., 1], np.inf).min(-1)
    xy = np.where(clip.rig.inside(xy)[..., None], xy, np.nan)
    there = (~np.isnan(xy[..., 0])).sum(-1) >= max(_MIN_JOINTS, len(clip.detections.skeleton) // 2)
    height = np.where(there & (high - low > 1), high - low, np.nan)
    frames, views, people = height.shape
    found = np.full(xy.shape, np.nan)
    found_score = np.full(xy.shape[:-1], np.nan)
    matched = np.zeros(height.shape, bool)
    left_over = (~np.isnan(score)).sum(-1) >= _MIN_JOINTS
    near = np.zeros(left_over.shape, bool)
    for frame in range(frames):
        off = np.linalg.norm(xy[frame, :, :, None] - seen[frame, :, None], axis=-1) / height[frame, :, :, None, None]
        for view in range(views):
            distance = _median(off[view])
            cost = np.where(distance < MATCHED, distance, 1e3)
            for person, detection in zip(*linear_sum_assignment(cost), strict=True):
                if cost[person, detection] < MATCHED:
                    matched[frame, view, person] = True
                    found[frame, view, person] = seen[frame, view, detection]
                    found_score[frame, view, person] = score[frame, view, detection]
                    left_over[frame, view, detection] = False
            if people:
                near[frame, view] = (distance < FRAGMENT).any(0)
    found = np.where(np.isnan(xy), np.nan, found)
    return Match(xy, height, found, np.where(np.isnan(found[..., 0]), np.nan, found_score), matched, left_over, near)


def _median(distances: np.ndarray) -> np.ndarray:
    """Return the medians (...) of the known values in (..., J); infinite if fewer than three are known."""
    ordered, count = np.sort(distances, -1), (~np.isnan(distances)).sum(-1)
    middle = np.take_along_axis(ordered, np.maximum(count - 1, 0)[..., None] // 2, -1)[..., 0]
    return np.where(count >= 3, middle, np.inf)


# Only detections and cameras are needed: capture reconstructs people, and the errors of a view are measured against the
# other views. A real recording and its simulation are thus measured against the same kind of reference, which makes the
# errors of both a little too large. If people are annotated, the annotation can be the reference instead.

GROSS = 0.1
"""Errors above this fraction of the height of a person are not noise."""
_SMOOTHING, _LONGEST_GAP = 0.1, 0.4
"""Time scale of the light smoothing of the reference, and the longest gap that is filled in it, s."""
_LAGS = (0.04, 0.2)
"""Times after which the correlation of errors is measured, s."""
_MIN_SIDE_DISTANCE = 0.05
"""Distance from the vertical through the middle of head or shoulders below which a joint is on neither side, m."""


@dataclass(frozen=True)
class DetectorStatistics:
    """Statistics of the detections of a recording in V views.

    A kind is a joint name without its side. Lengths are in heights of the person in the image.
    """

    name: str  # Name of the recording
    fps: float  # Frames per second
    kinds: tuple[str, ...]  # (K,) names of kinds
    kind: np.ndarray  # (n,) index into `kinds` of each detected joint that the reference locates
    error: np.ndarray  # (n,) its distance from the reference
    inverted: np.ndarray  # (n,) True where the same joint of the other side is nearer, by half and by `GROSS`
    score: np.ndarray  # (n,) its confidence
    missed: np.ndarray  # (V, K) fraction of missed joints among the joints in the image of detected persons
    # (K, 2) the same fraction of joints on the camera's side of the body, and on the far side
    missed_by_side: np.ndarray
    # {"a|b": fraction of the missed joints of kind b for which the joint of kind a on the same side is also missed}
    joint_misses: dict[str, float]
    views: np.ndarray  # (K, V + 1) fraction of the joints that are detected in 0..V views
    miss_seconds: np.ndarray  # (r,) lengths of uninterrupted misses, s
    # {time, s: correlation of errors that are this time apart; NaN if frames are further apart}
    autocorrelation: dict[float, float]
    constant: float  # Fraction of the energy of errors that is constant for a person, view and joint
    person_missed: np.ndarray  # (V,) fraction of the persons in the image that are not detected at all
    ghosts: np.ndarray  # (V,) number of ghosts per frame
    ghost_joints: float  # Median number of joints of a ghost
    ghost_score: float  # Median confidence of ghosts
    # (V,) number of detected pieces of persons per frame, without the largest piece of each person
    fragments: np.ndarray


def on_skeleton(recording: Clip, skeleton: Skeleton) -> Clip:
    """Return a recording with its detections on another skeleton, as those of a simulated detector.

    Joints that its detector does not have are absent. Raises ValueError if the skeletons have no joint in common.
    """
    if recording.detections.skeleton == skeleton:
        return recording
    try:
        detections = convert_detections(recording.detections, skeleton)
    except KeyError as error:
        raise ValueError(f"clip {recording.id!r}: {error.args[0]}") from None
    return replace(recording, detections=detections, poses=None, detection_labels=None)


def measure(clip: Clip, reference: ErrorReference = ErrorReference.others) -> DetectorStatistics:
    """Measure the statistics of a clip's detections.

    Raises ValueError if there are fewer than three cameras, so that no joint can be checked against the others, no
    annotation for `ErrorReference.annotated`, or no person detected in two views.
    """
    clip = _measurable(clip, reference)
    views = len(clip.rig)
    poses = _reference(clip, reference)
    whole = match_detections(clip, poses)
    if not whole.matched.any():
        raise ValueError(f"clip {clip.id!r}: no person is detected in two views or more, there is nothing to measure")
    joints = clip.detections.skeleton.joints
    kinds = tuple(dict.fromkeys(kind_of(joint) for joint in joints))
    kind_index = np.array([kinds.index(kind_of(joint)) for joint in joints])
    of_kind = [kind_index == k for k in range(len(kinds))]
    errors = [_errors_of_view(clip, view, reference) for view in range(views)]
    expected = whole.matched[..., None] & ~np.isnan(whole.xy[..., 0])
    missed = expected & np.isnan(whole.score)
    in_image = ~np.isnan(whole.height)
    # A joint that the detector never reports does not count in the lengths of misses.
    detected = (~np.isnan(clip.detections.score)).any((0, 1, 2))
    sides = _sides(clip, poses)
    ghosts = whole.left_over & ~whole.near
    ghost_joints = ~np.isnan(clip.detections.score) & ghosts[..., None]
    starts = missed & np.concatenate([np.ones_like(missed[:1]), ~missed[:-1]])
    # Only people in at least two images can be measured.
    count = (~np.isnan(whole.score)).sum(1)[in_image.sum(1) >= 2]
    histograms = [
        np.bincount(each.ravel(), minlength=views + 1) / max(each.size, 1)
        for each in (count[:, kind] for kind in of_kind)
    ]
    return DetectorStatistics(
        name=clip.id,
        fps=clip.fps,
        kinds=kinds,
        kind=kind_index[np.concatenate([each.joint for each in errors])],
        error=np.concatenate([each.error for each in errors]),
        inverted=np.concatenate([each.inverted for each in errors]),
        score=np.concatenate([each.score for each in errors]),
        missed=np.stack([_share(missed, expected, kind, (0, 2, 3)) for kind in of_kind], -1),
        missed_by_side=np.stack(
            [[_share(missed & side, expected & side, kind, (0, 1, 2, 3)) for side in sides] for kind in of_kind]
        ),
        joint_misses=_joint_misses(missed, expected, clip),
        views=np.stack(histograms),
        # Stretches in which a joint is missed, including those cut by the clip's end.
        miss_seconds=gap_lengths(~missed)[starts & expected & detected] / clip.fps,
        autocorrelation={lag: _mean_ratio([each.correlation[lag] for each in errors]) for lag in _LAGS},
        constant=_mean_ratio([each.constant for each in errors]),
        person_missed=_ratio((in_image & ~whole.matched).sum((0, 2)), in_image.sum((0, 2))),
        ghosts=ghosts.sum((0, 2)) / len(clip),
        ghost_joints=float(np.median(ghost_joints.sum(-1)[ghosts])) if ghosts.any() else float("nan"),
        ghost_score=float(np.median(clip.detections.score[ghost_joints])) if ghosts.any() else float("nan"),
        fragments=(whole.left_over & whole.near).sum((0, 2)) / len(clip),
    )


def _measurable(clip: Clip, reference: ErrorReference) -> Clip:
    """Return the frames that the reference knows, with the cameras of the truth if it is the annotations."""
    if reference == ErrorReference.annotated:
        known = np.zeros(len(clip), bool) if clip.truth is None else ~np.isnan(clip.truth.xyz).all((1, 2, 3))
        if not known.any():
            raise ValueError(
                f"clip {clip.id!r}: no person is annotated; measure against the other views with truth=others"
            )
        return replace(clip.select(frames=np.flatnonzero(known)), rig=clip.actual_rig)
    if len(clip.rig) < 3:
        raise ValueError(
            f"clip {clip.id!r}: errors are measured against the other views, which takes 3 cameras or more"
        )
    return clip


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.where(whole > 0, part / np.maximum(whole, 1), np.nan)


def _mean_ratio(parts: list[tuple[float, float]]) -> float:
    above, below = np.sum(parts, 0)
    return float(above / below) if below > 0 else float("nan")


def _share(event: np.ndarray, counted: np.ndarray, joints: np.ndarray, axis: tuple[int, ...]) -> np.ndarray:
    return _ratio(event[..., joints].sum(axis), counted[..., joints].sum(axis))


def _reference(clip: Clip, reference: ErrorReference) -> Poses3D:
    """Return annotated poses, or captured ones with short gaps filled."""
    if reference == ErrorReference.annotated:
        assert clip.truth is not None
        return convert(clip.truth, clip.detections.skeleton)
    poses = capture(clip, CaptureConfig())
    short = gap_lengths(poses.measured) <= _LONGEST_GAP * clip.fps
    filled = smooth(fill_world(poses, clip.fps, linear), clip.fps, _SMOOTHING)
    return Poses3D(poses.skeleton, np.where(short[..., None], filled.xyz, np.nan))


class _ViewErrors(NamedTuple):
    """Errors of the detected joints in a view. Fractions of energy are given as the sums to be divided."""

    error: np.ndarray  # (n,), and the following as in `DetectorStatistics`
    inverted: np.ndarray  # (n,)
    score: np.ndarray  # (n,)
    joint: np.ndarray  # (n,) index of the joint
    correlation: dict[float, tuple[float, float]]  # By time, s
    constant: tuple[float, float]


def _errors_of_view(clip: Clip, view: int, reference: ErrorReference) -> _ViewErrors:
    """Measure the errors of detected joints in one view, against the truth or people captured from the other views."""
    others = [other for other in range(len(clip.rig)) if other != view]
    match = match_detections(clip.select(views=[view]), _reference(clip.select(views=others), reference))
    off = (match.found - match.xy)[:, 0] / match.height[:, 0, :, None, None]
    mirror = np.asarray(clip.detections.skeleton.mirror)
    across = np.linalg.norm((match.found - match.xy[..., mirror, :])[:, 0], axis=-1) / match.height[:, 0, :, None]
    size = np.linalg.norm(off, axis=-1)
    known = ~np.isnan(size)
    inverted = (size > GROSS) & (across < size / 2) & (mirror != np.arange(len(mirror)))
    fine = np.where((size < GROSS)[..., None], off, np.nan)
    count = (~np.isnan(fine[..., 0])).sum(0)
    total = np.where(np.isnan(fine), 0, fine)
    long = count > clip.fps
    return _ViewErrors(
        size[known],
        inverted[known],
        match.score[:, 0][known],
        np.nonzero(known)[-1],
        {lag: _correlation(off, size, round(lag * clip.fps)) for lag in _LAGS},
        (
            float(((total.sum(0) ** 2).sum(-1)[long] / count[long]).sum()),
            float((total**2).sum((0, -1))[long].sum()),
        ),
    )


def _correlation(off: np.ndarray, size: np.ndarray, frames: int) -> tuple[float, float]:
    """Return the sums of products of errors `frames` apart, and of squared errors. Gross errors are left out."""
    if not frames:
        return 0.0, 0.0
    both = (size[:-frames] < GROSS) & (size[frames:] < GROSS)
    first, second = off[:-frames][both], off[frames:][both]
    return float((first * second).sum()), float(((first**2).sum() + (second**2).sum()) / 2)


def _joint_misses(missed: np.ndarray, expected: np.ndarray, clip: Clip) -> dict[str, float]:
    """Return the fractions `joint_misses` for elbow and wrist, and for knee and ankle."""
    index, shares = clip.detections.skeleton.index, {}
    for a, b in (("elbow", "wrist"), ("wrist", "elbow"), ("knee", "ankle"), ("ankle", "knee")):
        first, second = index(f"l_{a}", f"r_{a}"), index(f"l_{b}", f"r_{b}")
        both = expected[..., first] & expected[..., second] & missed[..., second]
        shares[f"{a}|{b}"] = float(_ratio((missed[..., first] & both).sum(), both.sum()))
    return shares


def _sides(clip: Clip, reference: Poses3D) -> tuple[np.ndarray, np.ndarray]:
    """Return two (F, V, P, J) masks of joints on the camera's side of the body, and on the far side.

    These are directions within 60 degrees of that to the camera, or its opposite: of the face from between the ears, of
    limbs from between the shoulders. Neck and trunk have no side.
    """
    flat, index = reference.xyz[..., :2].astype(np.float64), reference.skeleton.index
    middles = [flat[:, :, index(f"l_{part}", f"r_{part}")].mean(2, keepdims=True) for part in ("shoulder", "ear")]
    of_face = np.array([kind_of(joint) in ("nose", "eye", "ear") for joint in reference.skeleton.joints])
    out = flat - np.where(of_face[:, None], middles[1], middles[0])
    length = np.linalg.norm(out, axis=-1)
    sided = of_face | (np.array(reference.skeleton.mirror) != np.arange(len(of_face)))
    out = np.where(
        ((length > _MIN_SIDE_DISTANCE) & sided)[..., None],
        out / np.maximum(length, _MIN_SIDE_DISTANCE)[..., None],
        np.nan,
    )
    sight = clip.rig.centers[:, None, None, :2] - flat[:, None]
    along = (sight * out[:, None]).sum(-1) / np.linalg.norm(sight, axis=-1)
    return along > 0.5, along < -0.5


# Several clips

_SAMPLES = ("kind", "error", "inverted", "score", "miss_seconds")
"""Fields of `DetectorStatistics` that are concatenated. The other fields are averaged."""


def measure_all(
    clips: Iterable[Clip], count: int, workers: int = 1, reference: ErrorReference = ErrorReference.others
) -> DetectorStatistics:
    """Return the statistics of `count` clips as one: samples are concatenated, fractions averaged by clip length."""
    jobs = in_parallel(_measure, ((clip, reference) for clip in clips), workers)
    parts, frames = zip(*progress(jobs, "measuring", count), strict=True)
    return pool(parts, frames)


def _measure(clip: Clip, reference: ErrorReference) -> tuple[DetectorStatistics, int]:
    return measure(clip, reference), len(clip)


def pool(parts: Sequence[DetectorStatistics], frames: Sequence[int]) -> DetectorStatistics:
    """Return the pooled statistics of several clips; clip k has `frames[k]` frames.

    If clips have different numbers of cameras, shares by camera are replaced by their mean over all cameras, and
    `views` is empty.

    Raises ValueError if the clips have several skeletons.
    """
    if len({part.kinds for part in parts}) > 1:
        raise ValueError("clips of several skeletons cannot be measured as one")
    if len({len(part.ghosts) for part in parts}) > 1:
        of_views, no_views = ("missed", "person_missed", "ghosts", "fragments"), np.empty((len(parts[0].kinds), 0))
        parts = [
            replace(part, views=no_views, **{name: mean_known(getattr(part, name))[None] for name in of_views})
            for part in parts
        ]
    values = {f.name: [getattr(part, f.name) for part in parts] for f in fields(DetectorStatistics)}

    def mean(name: str) -> Any:
        if isinstance(values[name][0], dict):
            return {key: _mean([part[key] for part in values[name]], frames) for key in values[name][0]}
        return _mean(values[name], frames)

    shared = {"name": values["name"][0], "fps": values["fps"][0], "kinds": values["kinds"][0]}
    pooled: dict[str, Any] = {name: np.concatenate(values[name]) for name in _SAMPLES}
    return DetectorStatistics(
        **shared, **pooled, **{name: mean(name) for name in values if name not in shared | pooled}
    )


def _mean(values: list, weights: Sequence[int]):
    array = np.array(values, float)
    known = ~np.isnan(array)
    weight = np.where(known, np.reshape(np.asarray(weights, float), (-1, *(1,) * (array.ndim - 1))), 0)
    total = weight.sum(0)
    mean = np.where(total > 0, (weight * np.nan_to_num(array)).sum(0) / np.maximum(total, 1e-9), np.nan)
    return mean if mean.ndim else float(mean)


# Recordings of real detectors


def read_recording(path: Path, frames: Sequence[int] | None = None) -> Clip:
    """Read one recording, a clip or Shelf's text files. With `frames`, only the frames [first, end) are returned.

    Raises:
        FileNotFoundError: there is no such recording.
        ValueError: the recording has several clips, or does not have these frames.
    """
    kind = "shelf" if (path / "detection").is_dir() else "clip"
    try:
        clips = Clips(DataConfig(kind, str(path)))
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{error}; dmae convert makes clips of other recordings") from None
    if len(clips) != 1:
        raise ValueError(f"{path}: expected one recording, found {len(clips)} clips; {path / clips.names[0]} is one")
    clip = clips[0]
    if frames is None:
        return clip
    if len(frames) != 2 or not 0 <= frames[0] < frames[1] <= len(clip):
        raise ValueError(f"frames={list(frames)}: expected [first, end] within the {len(clip)} frames of {path}")
    return clip.select(frames=slice(*frames))
