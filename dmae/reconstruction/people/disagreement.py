"""Cameras that see a person with a constant offset from the other cameras."""

from collections.abc import Callable, Sequence

import numpy as np

from dmae.files.mapped import empty, frame_blocks, release, total
from dmae.numerics.statistics import median_over_frames
from dmae.reconstruction.association import NONE
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.triangulation import Points

_OFFSET = 0.7
"""Sigmas of the detections; a larger constant offset between a camera and the points is not noise.

Offsets are up to 0.3 for the people of Shelf, and 0.85 and 1.06 in Pose2Sim's demonstration, with cameras that are 5 to
8 cm off."""
_MIN_FRAMES = 25
"""Smallest number of frames in which a camera sees a person, for the estimate of a constant offset."""


def cameras_disagree(evidence: Evidence, assigned: np.ndarray, points: Points) -> np.ndarray:
    """Return (P,) True for people on which cameras disagree by a constant, as after an inexact calibration.

    The offset of a camera is the median, over joints and frames, of the reprojected minus the detected position, in
    sigmas of the detection. Noise has no direction and cancels; the error of a displaced camera does not.

    Args:
        evidence: Detections of F frames.
        assigned: (F, P, V, J) index of the detection that shows the joint in the view, or `NONE`.
        points: (F, P, J) points triangulated from them.
    """
    return _disagree(standardised_offsets(evidence, assigned, points.xyz))


def _disagree(offset: np.ndarray) -> np.ndarray:
    """Return (P,) True for people on which cameras disagree, by offsets (F, P, V, J, 2)."""
    persons, views = offset.shape[1:3]
    if not offset.size:
        return np.zeros(persons, bool)
    seen = total(lambda offset: np.isfinite(offset[..., 0]).any(-1), offset)
    constant = np.zeros((persons, views, 2))
    for person, view, axis in np.ndindex(constant.shape):
        one = np.concatenate([offset[part, person, view, :, axis].copy() for part in frame_blocks(offset)])
        constant[person, view, axis] = median_over_frames(one.ravel())
    return ((np.linalg.norm(constant, axis=-1) > _OFFSET) & (seen >= _MIN_FRAMES)).any(-1)


def standardised_offsets(evidence: Evidence, assigned: np.ndarray, xyz: np.ndarray) -> np.ndarray:
    """Return reprojected minus detected positions of joints (F, P, J, 3), as (F, P, V, J, 2), in sigmas."""
    rig, noise, absent = evidence.rig, evidence.config.noise, assigned == NONE
    frame, view, joint = (
        np.arange(len(assigned))[:, None, None, None],
        np.arange(len(rig))[:, None],
        np.arange(assigned.shape[-1]),
    )
    pixels, depth = (part.swapaxes(1, 2) for part in rig.project(xyz))
    focal = rig.focal[:, None]
    sigma = np.hypot(noise.min_sigma_px, focal * noise.sigma(evidence.confidence[frame, view, assigned, joint]) / depth)
    offset = (pixels - evidence.xy[frame, view, assigned, joint]) / sigma[..., None]
    return np.where(absent[..., None], np.nan, offset)


def settle_disagreement(
    evidence_of: Callable[[slice], Evidence], blocks: Sequence[slice], assigned: np.ndarray, points: Points
) -> None:
    """Triangulate the people on which cameras disagree again, in place, from the cameras that agree most.

    Joints on which too few cameras then agree are not changed.

    Args:
        evidence_of: Returns the evidence of a block.
        blocks: The frames, in pieces.
        assigned, points: As in `cameras_disagree`.
    """
    offset = empty((*assigned.shape, 2), np.float64)
    for part in blocks:
        offset[part] = standardised_offsets(evidence_of(part), assigned[part], points.xyz[part])
        release(offset, assigned, points.xyz)
    people = np.flatnonzero(_disagree(offset))
    if not len(people):
        return
    for part in blocks:
        chosen = assigned[part][:, people]
        frame = np.arange(len(chosen))[:, None, None, None]
        again = evidence_of(part).triangulate(frame, chosen, selective=True)
        known, person = ~np.isnan(again.xyz[..., 0]), people[None, :, None]
        frame, _, joint = np.ogrid[tuple(slice(n) for n in known.shape)]
        place = tuple(np.broadcast_to(axis, known.shape)[known] for axis in (frame, person, joint))
        for name in ("xyz", "cov", "used", "residual"):
            getattr(points, name)[part][place] = getattr(again, name)[known]
