"""Checks of the numbers, labels and detections of a clip. Each check returns descriptions of the problems it finds."""

from dataclasses import fields

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.labels import DetectionLabels, JointError, OcclusionLabels, Visibility

_EDGE = 0.05
"""Tolerance of projections, px. It is needed because truth is stored in single precision."""
_NEAR_CAMERA = 1e-3
"""Tolerance of distances from the camera's plane, m, for the same reason."""
_FAR_OFF = 0.15
"""A detection is wrong if its median joint is farther than this from its person, in heights of the person. This is used
if a clip has no offsets of joints."""
_MAX_OFF = 0.05
"""Greatest fraction of wrong detections in a clip. Some are expected, because detectors make such errors."""


def check_numbers(clip: Clip) -> list[str]:
    """Check that points are complete or NaN, numbers are finite, and confidences are from 0 to 1."""
    parts = {name: getattr(clip, name) for name in ("detections", "truth", "poses")}
    arrays = {
        f"{name}.{f.name}": getattr(part, f.name)
        for name, part in parts.items()
        if part is not None
        for f in fields(part)
        if f.name != "skeleton"
    }
    problems = []
    for name, array in arrays.items():
        if np.isinf(array).any():
            problems.append(f"{name}: {int(np.isinf(array).sum())} infinite numbers")
        if name.endswith((".xy", ".xyz")):
            torn = np.isnan(array).any(-1) != np.isnan(array).all(-1)
            if torn.any():
                problems.append(f"{name}: {int(torn.sum())} points with some, but not all, coordinates NaN")
    with np.errstate(invalid="ignore"):
        beyond = (clip.detections.score < 0) | (clip.detections.score > 1)
    if beyond.any():
        problems.append(f"detections.score: {int(beyond.sum())} confidences outside 0..1")
    return problems


def check_labels(clip: Clip) -> list[str]:
    """Check that codes and occluders exist, and that margins are known for hidden joints and only for these."""
    problems = []
    if clip.occlusion is not None:
        problems += _check_occlusion(clip.occlusion, clip.truth)
    if clip.detection_labels is not None:
        problems += _check_detection_labels(clip.detection_labels, clip.detections.observed)
    return problems


def _counted(wrong: dict[str, np.ndarray]) -> list[str]:
    return [f"{what}: {int(found.sum())} of {found.size}" for what, found in wrong.items() if found.any()]


def _check_occlusion(labels: OcclusionLabels, truth: Poses3D) -> list[str]:
    code, wrong = labels.visibility, {}
    persons = truth.xyz.shape[1]
    absent = np.broadcast_to(np.isnan(truth.xyz).any(-1)[:, None], code.shape)
    wrong["visibility is not ABSENT exactly where the truth is NaN"] = (code == Visibility.ABSENT) != absent
    if labels.occluder is not None:
        by, person = labels.occluder, np.arange(persons)[:, None]
        others = (Visibility.HIDDEN_BY_PERSON, Visibility.HIDDEN_BY_OBJECT)
        own = np.broadcast_to(person, code.shape)
        least = np.select([code == Visibility.HIDDEN_BY_SELF, np.isin(code, others)], [own, 0], -1)
        ends = [persons - 1, len(labels.objects) - 1]
        greatest = np.select([code == other for other in others], ends, least)
        oneself = (code == Visibility.HIDDEN_BY_PERSON) & (by == person)
        wrong["occluder does not match visibility"] = (by < least) | (by > greatest) | oneself
    if labels.depth_margin is not None:
        hidden = (code >= Visibility.HIDDEN_BY_SELF) & (code <= Visibility.HIDDEN_BY_OBJECT)
        wrong["depth_margin is not known exactly where joints are hidden"] = np.isnan(labels.depth_margin) == hidden
        wrong["depth_margin is not positive"] = labels.depth_margin <= 0
    if labels.amodal_pixels is not None:
        wrong["visible_pixels exceed amodal_pixels"] = labels.visible_pixels > labels.amodal_pixels
    return _counted(wrong)


def _check_detection_labels(labels: DetectionLabels, observed: np.ndarray) -> list[str]:
    wrong = {}
    for name, there in (("person", observed.any(-1)), ("joint_person", observed)):
        person = getattr(labels, name)
        if person is not None:
            wrong[f"{name} is set where nothing is detected"] = (person >= 0) & ~there
    if labels.error is not None:
        absent = labels.error == JointError.ABSENT
        wrong["error is not ABSENT exactly where nothing is detected"] = absent == observed
    return _counted(wrong)


def check_projection(clip: Clip) -> list[str]:
    """Check that the projections of joints agree with their labels: in the image, outside it, or behind the camera."""
    if clip.occlusion is None:
        return []
    visibility = clip.occlusion.visibility
    rig = clip.rig if clip.true_rig is None else clip.true_rig
    xy, depth = rig.project(clip.truth.xyz)
    size = rig.size[:, None, None]
    with np.errstate(invalid="ignore"):
        inside = ((xy >= -0.5 - _EDGE) & (xy <= size - 0.5 + _EDGE)).all(-1)
        well_inside = ((xy >= -0.5 + _EDGE) & (xy <= size - 0.5 - _EDGE)).all(-1)
        wrong = {
            "in an image project outside it": (visibility <= Visibility.HIDDEN_BY_OBJECT) & ~inside,
            "outside an image project into it": (visibility == Visibility.OUTSIDE_IMAGE) & well_inside,
            "outside an image are behind its camera": (visibility == Visibility.OUTSIDE_IMAGE)
            & (depth < -_NEAR_CAMERA),
            "behind a camera are before it": (visibility == Visibility.BEHIND_CAMERA) & (depth > _NEAR_CAMERA),
        }
    return [
        f"{int(found.sum())} joints labelled {what}, first in frame {at[0]}, camera {clip.rig.names[at[1]]}, "
        f"person {at[2]}, joint {clip.truth.skeleton.joints[at[3]]}"
        for what, found in wrong.items()
        if found.any()
        for at in (np.argwhere(found)[0],)
    ]


def check_detections(clip: Clip) -> list[str]:
    """Check that detections are inside their image, and near their person."""
    problems, rig = [], clip.rig if clip.true_rig is None else clip.true_rig
    xy = clip.detections.xy
    outside = clip.detections.observed & ~clip.rig.inside(xy)
    if outside.any():
        problems.append(f"{int(outside.sum())} detected joints lie outside their image")
    labels = clip.detection_labels
    if clip.truth is None or labels is None:
        return problems
    columns = _columns(clip.truth, clip.detections.skeleton.joints, clip.detections.skeleton.name)
    frame, view, place = np.nonzero(labels.person >= 0)
    person = labels.person[frame, view, place]
    valid = person < clip.truth.xyz.shape[1]
    frame, view, place, person = (index[valid] for index in (frame, view, place, person))
    if columns is None:
        return problems
    true, found = rig.project(clip.truth.xyz[:, :, columns])[0][frame, view, person], xy[frame, view, place]
    distance = np.linalg.norm(found - true, axis=-1)
    if labels.offset_px is not None:
        wrong = np.abs(labels.offset_px[frame, view, place] - distance) > _EDGE
        if wrong.any():
            problems.append(f"offset_px is not the distance from the true joint: {int(wrong.sum())} of {wrong.size}")
        return problems
    some = np.isfinite(distance).any(-1)
    height = np.ptp(np.where(np.isnan(true[some]), np.nanmean(true[some], 1, keepdims=True), true[some]), 1).max(-1)
    off = np.nanmedian(distance[some], -1) > _FAR_OFF * height
    if some.any() and off.mean() > _MAX_OFF:
        problems.append(f"{off.mean():.0%} of the detections lie far from the person that they are labelled with")
    return problems


def _columns(truth: Poses3D, joints: tuple[str, ...], skeleton: str) -> list[int] | None:
    """Return the indices of the detected joints among the true joints; None if the skeletons do not match."""
    for prefix in ("", f"{skeleton}."):
        if set(names := [prefix + joint for joint in joints]) <= set(truth.skeleton.joints):
            return truth.skeleton.index(*names)
    return None
