"""Rays from the most confident camera to each joint."""

import numpy as np

from dmae.reconstruction.association import NONE
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.reassignment import reassign

_MAX_DISTANCE = 0.3
"""m; the ray of a single camera is not used if it is farther than this from the expected place of the joint."""


def most_confident_rays(
    evidence: Evidence, absent: np.ndarray, expected: np.ndarray, assigned: np.ndarray, first_pass: np.ndarray
) -> np.ndarray:
    """Return the ray of the most confident view of each joint, (F, P, J, 2, 3); see `Poses3D.rays`.

    A measured joint takes the ray of a view that measured it. An absent joint takes that of the most confident
    detection near the place where it is expected; if there is none, of a detection that tracking assigned to its
    person.

    Args:
        evidence: Detections that the joints were measured from.
        absent: (F, P, J) True for joints that were not measured.
        expected: (F, P, J, 3) m, measured or interpolated places of the joints.
        assigned: (F, P, V, J) detections that the joints were measured from, or `NONE`.
        first_pass: (F, P, V, J) detections that tracking assigned, or `NONE`.
    """
    near = reassign(evidence, assigned, expected.astype(np.float64), _MAX_DISTANCE)
    near = np.where((near == NONE).all(2, keepdims=True), first_pass, near)
    near = np.where(absent[:, :, None], near, assigned).swapaxes(2, 3)
    frame, person, joint, views = np.ogrid[tuple(slice(n) for n in near.shape)]
    confidence = np.where(near == NONE, np.nan, evidence.confidence[frame, views, near, joint])
    view = np.nan_to_num(confidence, nan=-1).argmax(-1)
    frame, person, joint = frame[..., 0], person[..., 0], joint[..., 0]
    pixels = evidence.xy[frame, view, near[frame, person, joint, view], joint]
    directions = (
        evidence.rig.world_from_pixel[view] @ np.append(pixels, np.ones_like(pixels[..., :1]), -1)[..., None]
    )[..., 0]
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    unknown = np.isnan(confidence).all(-1)[..., None, None]
    return np.where(unknown, np.nan, np.stack([evidence.rig.centers[view], directions], -2))
