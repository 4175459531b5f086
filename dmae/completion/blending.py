"""Blending: how much of the network's correction is applied, by how noisy the poses are and how long a gap is."""

import numpy as np

from dmae.completion.features import bone_stretch
from dmae.completion.methods.gaussian_process import SHORT_GAP
from dmae.data.clip import Poses3D
from dmae.numerics.gaps import gap_lengths, neighbours

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


def correction_weight(poses: Poses3D, fps: float) -> np.ndarray:
    """Return the weight of a network's correction of interpolated, or of measured, joints, (F, P, J, 1).

    It is 1 for noisy poses. Of exact poses measured joints are not moved, and joints in short gaps hardly:
    interpolation is better there.
    """
    squared = gap_lengths(poses.measured) ** 2
    long = squared / (squared + (SHORT_GAP * fps) ** 2)
    noisy = noisiness(poses)
    return np.where(poses.measured, noisy, noisy + (1 - noisy) * long)[..., None]


def near_measurement(poses: Poses3D, fps: float) -> np.ndarray:
    """Return (F, P, 1) True where a joint of the person is measured within 0.2 s."""
    before, after = neighbours(poses.measured.any(-1))
    index, longest = np.arange(len(before))[:, None], _NEAR * fps
    since = (before >= 0) & (index - before <= longest)
    until = (after < len(after)) & (after - index <= longest)
    return (since | until)[..., None]
