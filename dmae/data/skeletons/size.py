"""The size of bodies: worlds in which a body of any size is as large as a person.

The lengths of configurations and methods are those of people. Bodies of other sizes are scaled to that size, and their
poses are scaled back. Accelerations and durations are not scaled: animals of all sizes reach about the same
accelerations.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import wraps

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.clip import Poses3D, Source
from dmae.data.skeletons.tree import PERSON_M
from dmae.files.mapped import by_frames

Fill = Callable[[Poses3D, float], Poses3D]

_USUAL = 0.8
"""Quantile of the extents of poses that counts as size: bodies are bent, and rarely longer than they are."""
_WHOLE = 0.6
"""Smallest share of joints in a pose; extents of fewer joints are not informative."""
_MOST = 400
"""Frames that are measured, evenly spaced."""


def resized_poses(poses: Poses3D, factor: float) -> Poses3D:
    """Return the poses of a world `factor` times as large."""

    def resized(values: np.ndarray, by: float) -> np.ndarray:
        return by_frames(lambda values: (values.astype(np.float64) * by).astype(np.float32), values)

    rays = by_frames(lambda rays: rays * np.array([[factor], [1]], np.float32), poses.rays)
    return replace(poses, xyz=resized(poses.xyz, factor), cov=resized(poses.cov, factor**2), rays=rays)


def resized_rig(rig: CameraRig, factor: float) -> CameraRig:
    """Return the cameras of a world `factor` times as large; they see the same."""
    world = rig.cam_from_world.copy()
    world[:, :3, 3] *= factor
    return replace(rig, cam_from_world=world)


def usual_size(xyz: np.ndarray) -> float | None:
    """Return the usual distance, m, between the two joints farthest apart in bodies (..., J, 3). None if too few joints
    are known, or all are at one place.
    """
    flat = xyz.reshape(-1, *xyz.shape[-2:]).astype(np.float64)
    known = ~np.isnan(flat).any(-1)
    flat = flat[known.sum(-1) >= max(2, _WHOLE * known.any(0).sum())]
    flat = flat[np.unique(np.linspace(0, len(flat) - 1, _MOST).astype(int))] if len(flat) else flat
    extents = [extent(body) for body in flat]
    size = float(np.quantile(extents, _USUAL)) if extents else 0.0
    return size if size > 0 else None


def scale_of(poses: Poses3D) -> float:
    """Return the size of bodies as a multiple of that of people: 1 for people, else as stated, or as measured.

    It is 1 where too few joints are known.
    """
    skeleton = poses.skeleton
    if not skeleton.defined or skeleton.size_m is not None:
        return skeleton.scale
    finite = np.where(np.isfinite(poses.xyz).all(-1, keepdims=True), poses.xyz, np.nan)
    return (usual_size(finite) or PERSON_M) / PERSON_M


def extent(body: np.ndarray) -> float:
    """Return the distance between the two joints farthest apart of a body (J, 3), NaN where a joint is absent."""
    distance = np.linalg.norm(body[:, None] - body[None], axis=-1)
    return float(np.nanmax(distance, initial=0.0))


def for_any_size(fill: Fill) -> Fill:
    """Return a function that fills poses of people, and does so for bodies of any size.

    Poses of other sizes are filled in a world in which they are as large as people. Measured joints do not change.
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
