"""The reference motion at every step of the physics, interpolated from the planned motion of every frame."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from synth.people.segments import PARENTS, SEGMENTS


@dataclass(frozen=True)
class ReferenceMotion:
    """The reference motion of P people at each of S steps.

    Attributes:
        root: (S, P, 3) mid points of the hip joints, m.
        velocity: (S, P, 3) velocity of those points, m / s.
        quats: (S, P, 16, 4) orientation (w first) of each segment in its parent, of the pelvis in the world.
        spin: (S, P, 16, 3) angular velocity of each segment relative to its parent, in its own axes, rad / s.
        bearing: (S, P, 2) share of the weight that is on the left and the right foot.
    """

    root: np.ndarray
    velocity: np.ndarray
    quats: np.ndarray
    spin: np.ndarray
    bearing: np.ndarray

    def still(self) -> "ReferenceMotion":
        """Return the first pose, at rest, as a reference of one step."""
        return ReferenceMotion(
            self.root[:1], 0 * self.velocity[:1], self.quats[:1], 0 * self.spin[:1], self.bearing[:1]
        )


def make_reference(
    root: np.ndarray, rotations: np.ndarray, bearing: np.ndarray, fps: float, substeps: int, last: int = 0
) -> ReferenceMotion:
    """Return a smooth interpolation, `substeps` steps per frame, from the first frame to the last or slightly beyond.

    Args:
        root: (F, P, 3) m, world.
        rotations: (F, P, 16, 3, 3) world orientation of each of `SEGMENTS`.
        bearing: (F, P, 2) as in `ReferenceMotion`.
        fps: Frames per second.
        substeps: Steps per frame.
        last: Number of the last step, if it is beyond the last frame, by at most a frame: the motion is extrapolated.
    """
    frames, persons = root.shape[:2]
    relative = rotations.copy()
    relative[:, :, 1:] = np.swapaxes(rotations[:, :, PARENTS[1:]], -1, -2) @ rotations[:, :, 1:]
    quats = Rotation.from_matrix(relative.reshape(-1, 3, 3)).as_quat(scalar_first=True)
    quats = quats.reshape(frames, persons, len(SEGMENTS), 4)
    # q and -q are the same orientation: give each the sign that is closer to the one before, for interpolation.
    flips = np.sign((quats[1:] * quats[:-1]).sum(-1, keepdims=True))
    quats[1:] *= np.cumprod(np.where(flips < 0, -1.0, 1.0), axis=0)

    dt, beyond = 1 / (fps * substeps), max(0, last - (frames - 1) * substeps)
    times, steps = np.arange(frames) / fps, np.arange((frames - 1) * substeps + beyond + 1) * dt
    if frames == 1:
        root, quats, bearing = (np.repeat(values, 1 + beyond, axis=0) for values in (root, quats, bearing))
        return ReferenceMotion(root, 0 * root, quats, np.zeros((1 + beyond, persons, len(SEGMENTS), 3)), bearing)
    path = CubicSpline(times, root)
    quats = CubicSpline(times, quats)(steps)
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    spin = np.empty((*quats.shape[:-1], 3))
    spin[:-1] = 2 / dt * _turn(quats[:-1], quats[1:])
    spin[-1] = spin[-2]
    bearing = np.concatenate([interpolate_steps(bearing, substeps), np.repeat(bearing[-1:], beyond, axis=0)])
    return ReferenceMotion(path(steps), path(steps, 1), quats, spin, bearing)


def interpolate_steps(values: np.ndarray, between: int) -> np.ndarray:
    """Return (K, ...) values, `between` steps apart, interpolated linearly at all (between (K - 1) + 1) steps."""
    share = np.arange(between).reshape(-1, *[1] * (values.ndim - 1)) / between
    steps = values[:-1, None] * (1 - share) + values[1:, None] * share
    return np.concatenate([steps.reshape(-1, *values.shape[1:]), values[-1:]])


def _turn(start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Return the (..., 3) vector part of conj(start) stop: to second order half the rotation vector, in `start` axes.

    Args:
        start, stop: (..., 4) quaternions, w first.
    """
    (a, b, c, d), (w, x, y, z) = np.moveaxis(start, -1, 0), np.moveaxis(stop, -1, 0)
    rows = ((x * a - z * c) + (y * d - w * b), (y * a - w * c) + (z * b - x * d), (z * a + x * c) - (y * b + w * d))
    return np.stack(rows, -1)
