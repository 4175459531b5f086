"""The size of bodies, and scaling of poses and cameras to the size of people.

Lengths in configurations and methods are valid for people. Bodies of other sizes are scaled to the size of people, and
the resulting poses are scaled back. Accelerations and durations are not scaled, because animals of all sizes have about
the same accelerations.
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

_SIZE_QUANTILE = 0.8
"""Quantile of the extents of poses that is the size. Bodies are often bent; errors rarely make them longer."""
_MIN_KNOWN_SHARE = 0.6
"""Smallest share of known joints in a pose that is measured. The extent of fewer joints is not informative."""
_MAX_MEASURED = 400
"""Largest number of poses that are measured, evenly spaced."""


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
    """Return the usual extent, m, of bodies (..., J, 3): the distance between the two joints farthest apart.

    None if too few joints are known, or if all joints are at one place.
    """
    flat = xyz.reshape(-1, *xyz.shape[-2:]).astype(np.float64)
    known = ~np.isnan(flat).any(-1)
    flat = flat[known.sum(-1) >= max(2, _MIN_KNOWN_SHARE * known.any(0).sum())]
    flat = flat[np.unique(np.linspace(0, len(flat) - 1, _MAX_MEASURED).astype(int))] if len(flat) else flat
    extents = [extent(body) for body in flat]
    size = float(np.quantile(extents, _SIZE_QUANTILE)) if extents else 0.0
    return size if size > 0 else None


def scale_of(poses: Poses3D) -> float:
    """Return the size of bodies as a multiple of the size of people.

    It is 1 for the skeletons of this package. For other skeletons it is the stated size, or else the measured size; 1
    if too few joints are known.
    """
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
