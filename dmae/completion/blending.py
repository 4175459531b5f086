"""Blending: how much measured joints are corrected and poses are smoothed, by how noisy the poses are."""

from dataclasses import replace

import numpy as np

from dmae.completion.features import bone_stretch
from dmae.data.clip import Poses3D
from dmae.numerics.filling import smooth
from dmae.numerics.paths import neighbours

_EXACT, _NOISY = -1.5, -0.1
"""By `dmae.completion.features.bone_stretch` poses are exact up to the first (1 mm), noisy from the second (8 mm)."""
_NEAR = 0.2
"""s; farther from any measurement of a person, regions of 90 % held less than 80 % of the truth."""


def noisiness(poses: Poses3D) -> np.ndarray:
    """Return from 0 where poses are exact to 1 where they are as noisy as captured ones, (F, P, 1).

    It is judged by how much bones stretch.
    """
    stretch = bone_stretch(poses.xyz.astype(np.float64), poses.skeleton.bones)[:, :, :1, 0]
    return ((stretch - _EXACT) / (_NOISY - _EXACT)).clip(0, 1)


def correction_weight(poses: Poses3D) -> np.ndarray:
    """Return the weight of a network's correction of interpolated and of measured joints, (F, P, J, 1).

    It is 1 for interpolated joints. Measured joints are corrected the less the more exact the poses are.
    """
    return np.where(poses.measured[..., None], noisiness(poses)[..., None], 1.0)


def smooth_by_noise(filled: Poses3D, noisy: np.ndarray, fps: float, seconds: float) -> Poses3D:
    """Return filled poses smoothed (`dmae.numerics.filling.smooth`), the less the more exact they were measured.

    Poses from cameras are smoothed in full. Exact ones, as from motion capture with markers, do not change.

    Args:
        filled: F frames, P persons, of any skeleton.
        noisy: (F, P, 1) `noisiness` of the poses before they were filled.
    """
    smoothed = smooth(filled, fps, seconds)
    if (noisy == 1).all():
        return smoothed
    xyz = noisy[..., None] * smoothed.xyz + (1 - noisy[..., None]) * filled.xyz
    return replace(smoothed, xyz=xyz, source=np.where(noisy > 0, smoothed.source, filled.source))


def near_measurement(poses: Poses3D, fps: float) -> np.ndarray:
    """Return (F, P, 1) True where a joint of the person is measured within 0.2 s."""
    before, after = neighbours(poses.measured.any(-1))
    index, longest = np.arange(len(before))[:, None], _NEAR * fps
    since = (before >= 0) & (index - before <= longest)
    until = (after < len(after)) & (after - index <= longest)
    return (since | until)[..., None]
