"""Convert poses to other skeletons, and to bodies of other sizes.

Skeletons are converted by geometry: shared names, midpoints, and a formula for the head. Lengths in configurations and
methods are valid for people, so bodies of other sizes are scaled to the size of people, and the resulting poses are
scaled back. Accelerations and durations are not scaled, because animals of all sizes have about the same accelerations.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import wraps

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import NOT_KNOWN, Detections2D, Poses3D, Source
from dmae.data.skeleton import PERSON_M, Skeleton
from dmae.files.mapped import by_frames
from dmae.numerics.statistics import evenly_spaced

_MIDPOINTS = {"neck": ("l_shoulder", "r_shoulder"), "mid_hip": ("l_hip", "r_hip")}
_HEAD = ("bottom_head", "top_head")
_FACE = {"l_shoulder", "r_shoulder", "l_ear", "r_ear"}
_NEEDS = {joint: set(pair) for joint, pair in _MIDPOINTS.items()} | dict.fromkeys(_HEAD, _FACE)
"""Joints that a derived joint needs."""
DERIVED = tuple(_NEEDS)
"""Joints that `convert` derives from others."""

# m; top of the annotated heads of Shelf and Campus, from the conversion in the 4DAssociation release (Zhang et al.
# 2020).
_TOP_FORWARD, _TOP_UP = 0.125, 0.145
# m; averages of adults: half the distance between the ears, and the distances from the line between the ears to the tip
# of the nose and to the eyes.
_HALF_HEAD, _EARS_TO_NOSE, _EARS_TO_EYES = 0.075, 0.11, 0.085


def convert(poses: Poses3D, target: Skeleton) -> Poses3D:
    """Return the same poses on another skeleton.

    Joints with the same name are copied. If the source is a fused skeleton (`a+b`), they are copied from the part that
    equals the target, or else from the first part. Missing joints are derived where possible: `neck` and `mid_hip` are
    midpoints, and `head_ends` gives `bottom_head` and `top_head`. All others are absent. A derived joint has the
    weakest source and the smallest number of views of the joints that it is computed from, and no ray. The covariance
    of a midpoint follows from two independent joints, and is NaN for the ends of the head.

    Raises:
        KeyError: no joint of the target can be derived from the source.
    """
    source = poses.skeleton
    if source == target:
        return poses
    parts = source.parts
    if len(parts) > 1:
        part = target if target in parts else parts[0]
        return convert(Poses3D(part, **_take(poses, [f"{part.name}.{joint}" for joint in part.joints])), target)

    there = set(source.joints)
    derived = [joint for joint in target.joints if joint not in there and joint in _NEEDS and _NEEDS[joint] <= there]
    if not derived and not set(target.joints) & there:
        raise KeyError(
            f"no way from skeleton {source.name!r} to {target.name!r}: "
            f"it has none of {list(target.joints)}, but {list(source.joints)}"
        )
    arrays = _take(poses, target.joints)
    for joint in derived:
        for name, values in _derive(poses, joint).items():
            arrays[name][:, :, target.index(joint)[0]] = values
    return Poses3D(target, **arrays)


def convert_detections(detections: Detections2D, target: Skeleton) -> Detections2D:
    """Return the same detections on another skeleton.

    Joints with the same name are copied. If the source lacks `neck` or `mid_hip`, it becomes the midpoint of two joints
    with the lower of their confidences. All others are absent, also the ends of the head, because their formula needs
    3D positions. Raises KeyError if the skeletons have no joint in common.
    """
    source = detections.skeleton
    if source == target:
        return detections
    if not set(target.joints) & set(source.joints):
        raise KeyError(f"no way from skeleton {source.name!r} to {target.name!r}: they have no joint in common")
    shape = (*detections.score.shape[:-1], len(target))
    xy, score = np.full((*shape, 2), np.nan, np.float32), np.full(shape, np.nan, np.float32)
    for number, joint in enumerate(target.joints):
        names = (joint,) if joint in source.joints else _MIDPOINTS.get(joint, ())
        if names and set(names) <= set(source.joints):
            index = source.index(*names)
            xy[..., number, :] = detections.xy[..., index, :].mean(-2)
            score[..., number] = detections.score[..., index].min(-1)
    return Detections2D(target, xy, score)


def _take(poses: Poses3D, joints: Sequence[str]) -> dict[str, np.ndarray]:
    """Return the fields of poses on some joints; joints that the poses lack are absent."""
    known = poses.skeleton.joints
    index = np.array([known.index(joint) if joint in known else -1 for joint in joints])
    arrays = {name: array[:, :, index] for name, array in poses.arrays.items()}
    for name, value in NOT_KNOWN.items():
        arrays[name][:, :, index < 0] = value
    return arrays


def _derive(poses: Poses3D, joint: str) -> dict[str, np.ndarray]:
    """Return xyz, source, cov and views of one derived joint, (F, P, ...) each."""
    if joint in _HEAD:
        ends, used = head_ends(poses)
        xyz = ends[:, :, _HEAD.index(joint)]
        names = list(poses.skeleton.joints)
        cov = np.full((*xyz.shape, 3), np.nan)
    else:
        names = list(_MIDPOINTS[joint])
        used = np.ones((*poses.xyz.shape[:2], 2), bool)
        index = poses.skeleton.index(*names)
        xyz = poses.xyz[:, :, index].mean(2)
        cov = poses.cov[:, :, index].sum(2) / 4
    index = poses.skeleton.index(*names)
    absent = np.isnan(xyz).any(-1)
    # ABSENT < MEASURED < DENOISED < COMPLETED: the weakest source of the used joints, none absent, is the largest.
    source = np.where(absent, Source.ABSENT, np.where(used, poses.source[:, :, index], 0).max(-1))
    views = np.where(absent, 0, np.where(used, poses.views[:, :, index], 255).min(-1))
    return {"xyz": xyz, "source": source, "cov": np.where(absent[..., None, None], np.nan, cov), "views": views}


def head_ends(poses: Poses3D) -> tuple[np.ndarray, np.ndarray]:
    """Return bottom and top of the head, derived from shoulders, ears, eyes and nose.

    The bottom is midway between the centre of the shoulders and the centre of the ears. The top is 0.125 m from the
    bottom along the face normal, and 0.145 m up (world z). The face normal is horizontal and perpendicular to the line
    from right to left ear. If an ear is unknown, the line between the eyes replaces this line, or else the line between
    the shoulders: a head turns less than 90 degrees from the shoulders. If only one ear is known, the centre of the
    ears is half the width of a head from it along this line. If no ear is known, the nose or else an eye is moved back
    by its average distance from the ears. Without both shoulders, or without any joint of the face, the head is absent.
    Completed joints are used only where the measured joints are not enough.

    Returns:
        ends: (F, P, 2, 3) bottom and top, m; NaN where underdetermined.
        used: (F, P, J) True for the joints from which the ends are derived.
    """
    xyz = poses.xyz.astype(np.float64)
    ends, used = _head_ends(np.where(poses.measured[..., None], xyz, np.nan), poses.skeleton)
    lacking = np.isnan(ends).any((2, 3))
    ends[lacking], used[lacking] = (part[lacking] for part in _head_ends(xyz, poses.skeleton))
    return ends, used


def _head_ends(xyz: np.ndarray, skeleton: Skeleton) -> tuple[np.ndarray, np.ndarray]:
    nowhere = np.full((*xyz.shape[:2], 3), np.nan)
    at = {
        name: xyz[:, :, skeleton.index(name)[0]] if name in skeleton.joints else nowhere
        for name in ("l_ear", "r_ear", "l_eye", "r_eye", "nose", "l_shoulder", "r_shoulder")
    }
    used = np.zeros(xyz.shape[:3], bool)

    def choose(*options: tuple[np.ndarray, tuple[str, ...]]) -> np.ndarray:
        """Return the first known option for each frame and person, (F, P, 3)."""
        chosen = nowhere.copy()
        for value, names in options:
            here = np.isnan(chosen).any(-1) & ~np.isnan(value).any(-1)
            chosen[here] = value[here]
            for name in names:
                if name in skeleton.joints:
                    used[here, skeleton.index(name)[0]] = True
        return chosen

    def pair(part: str) -> tuple[str, str]:
        return f"l_{part}", f"r_{part}"

    left = choose(*((_level(at[f"l_{part}"] - at[f"r_{part}"]), pair(part)) for part in ("ear", "eye", "shoulder")))
    forward = np.stack([left[..., 1], -left[..., 0], left[..., 2]], -1)
    half = _HALF_HEAD * left
    ears = choose(
        ((at["l_ear"] + at["r_ear"]) / 2, pair("ear")),
        (at["l_ear"] - half, ("l_ear",)),
        (at["r_ear"] + half, ("r_ear",)),
        (at["nose"] - _EARS_TO_NOSE * forward, ("nose",)),
        ((at["l_eye"] + at["r_eye"]) / 2 - _EARS_TO_EYES * forward, pair("eye")),
        (at["l_eye"] - _EARS_TO_EYES * forward, ("l_eye",)),
        (at["r_eye"] - _EARS_TO_EYES * forward, ("r_eye",)),
    )
    shoulders = choose(((at["l_shoulder"] + at["r_shoulder"]) / 2, pair("shoulder")))
    bottom = (ears + shoulders) / 2
    top = bottom + _TOP_FORWARD * forward + (0, 0, _TOP_UP)
    return np.stack([bottom, top], 2), used


def _level(vector: np.ndarray) -> np.ndarray:
    """Return unit vectors along the horizontal part of vectors (..., 3); NaN where this part is zero."""
    level = vector * (1, 1, 0)
    length = np.linalg.norm(level, axis=-1, keepdims=True)
    return np.divide(level, length, out=np.full_like(level, np.nan), where=length > 1e-6)


Fill = Callable[[Poses3D, float], Poses3D]

SIZE_QUANTILE = 0.8
"""Quantile of the extents of poses that is the size. Bodies are often bent; errors rarely make them longer."""
_MIN_KNOWN_SHARE = 0.6
"""Smallest share of known joints in a pose that is measured. The extent of fewer joints is not informative."""
_MAX_MEASURED = 400  # Largest number of poses that are measured, evenly spaced


def resized_poses(poses: Poses3D, factor: float) -> Poses3D:
    """Return the poses in a world that is `factor` times as large."""

    def resized(values: np.ndarray, by: float) -> np.ndarray:
        return by_frames(lambda values: (values.astype(np.float64) * by).astype(np.float32), values)

    rays = by_frames(lambda rays: rays * np.array([[factor], [1]], np.float32), poses.rays)
    return replace(poses, xyz=resized(poses.xyz, factor), cov=resized(poses.cov, factor**2), rays=rays)


def resized_rig(rig: CameraRig, factor: float) -> CameraRig:
    """Return the cameras in a world that is `factor` times as large. Their images do not change."""
    world = rig.cam_from_world.copy()
    world[:, :3, 3] *= factor
    return replace(rig, cam_from_world=world)


def usual_size(xyz: np.ndarray) -> float | None:
    """Return the usual extent, m, of bodies (..., J, 3) between the joints farthest apart; None if unknown or 0."""
    flat = xyz.reshape(-1, *xyz.shape[-2:]).astype(np.float64)
    known = ~np.isnan(flat).any(-1)
    flat = flat[known.sum(-1) >= max(2, _MIN_KNOWN_SHARE * known.any(0).sum())]
    extents = [extent(body) for body in flat[evenly_spaced(len(flat), _MAX_MEASURED)]]
    size = float(np.quantile(extents, SIZE_QUANTILE)) if extents else 0.0
    return size if size > 0 else None


def scale_of(poses: Poses3D) -> float:
    """Return the size of bodies as a multiple of people's, stated or measured: 1 for our skeletons, or if unknown."""
    skeleton = poses.skeleton
    if not skeleton.defined or skeleton.size_m is not None:
        return skeleton.scale
    finite = np.where(np.isfinite(poses.xyz).all(-1, keepdims=True), poses.xyz, np.nan)
    return (usual_size(finite) or PERSON_M) / PERSON_M


def extent(body: np.ndarray) -> float:
    """Return the distance, m, between the two joints farthest apart of a body (J, 3); absent joints are NaN."""
    distance = np.linalg.norm(body[:, None] - body[None], axis=-1)
    return float(np.nanmax(distance, initial=0.0))


def for_any_size(fill: Fill) -> Fill:
    """Return a function that fills poses of bodies of any size, from one that fills poses of people.

    Bodies of other sizes are scaled to the size of people, filled, and scaled back. Measured joints do not change.
    """

    @wraps(fill)
    def filled(poses: Poses3D, fps: float) -> Poses3D:
        skeleton = poses.skeleton
        if not skeleton.defined:
            return fill(poses, fps)
        factor = scale_of(poses)
        body = replace(resized_poses(poses, 1 / factor), skeleton=replace(skeleton, size_m=factor * PERSON_M))
        done = resized_poses(fill(body, fps), factor)
        kept = (done.source == Source.MEASURED)[..., None]
        return replace(
            done,
            skeleton=skeleton,
            xyz=np.where(kept, poses.xyz, done.xyz),
            cov=np.where(kept[..., None], poses.cov, done.cov),
            rays=poses.rays,
        )

    return filled
