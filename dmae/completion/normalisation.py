"""The frame of a window: where its origin is and where it faces; and the rest pose in that frame."""

from dataclasses import dataclass

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.numerics.body import body_heading, rotate_z


@dataclass(frozen=True)
class Normalisation:
    """Frames of windows: window = rotated by -heading about z (world - origin).

    Attributes:
        origin: (B, 3) m, world: the mid hip, or its estimate, in the middle frame.
        heading: (B,) rad, the heading in the world that is +x in the window.
    """

    origin: np.ndarray
    heading: np.ndarray

    def apply(self, xyz: np.ndarray) -> np.ndarray:
        """Return points of the world (B, ..., 3) in the window."""
        return rotate_z(xyz - self._broadcast(self.origin, xyz.ndim), -self._broadcast(self.heading, xyz.ndim - 1))

    def undo(self, xyz: np.ndarray) -> np.ndarray:
        """Return points of the window (B, ..., 3) in the world."""
        return rotate_z(xyz, self._broadcast(self.heading, xyz.ndim - 1)) + self._broadcast(self.origin, xyz.ndim)

    @staticmethod
    def _broadcast(array: np.ndarray, ndim: int) -> np.ndarray:
        return array.reshape(len(array), *(1,) * (ndim - array.ndim), *array.shape[1:])


def mid_hip(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the mid hip of bodies (..., J, 3), by that name or between the hips, (..., 3); NaN where unknown.

    Raises:
        KeyError: the skeleton has no hips.
    """
    if "mid_hip" in skeleton.joints:
        return xyz[..., skeleton.index("mid_hip")[0], :]
    return xyz[..., skeleton.index("l_hip", "r_hip"), :].mean(-2)


def rest_pose(xyz: np.ndarray, skeleton: Skeleton) -> np.ndarray:
    """Return the mean of bodies (..., J, 3) about their mid hip, facing +x, (J, 3) m; used for joints never measured.

    Of two skeletons side by side the mid hip and the heading are those of the first.

    Raises:
        ValueError: a joint is never known together with the hips and a pair of hips or shoulders.
    """
    flat = xyz.reshape(-1, *xyz.shape[-2:]).astype(np.float64)
    first = skeleton.parts[0]
    upright = Normalisation(mid_hip(flat, first), body_heading(flat, first)).apply(flat)
    known = ~np.isnan(upright).any(-1)
    never = [joint for joint, count in zip(skeleton.joints, known.sum(0), strict=True) if not count]
    if never:
        raise ValueError(f"skeleton {skeleton.name!r}: nothing to learn {never} from, the truth never has them")
    return np.where(known[..., None], upright, 0).sum(0) / known.sum(0)[:, None]
