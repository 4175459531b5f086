"""Gaussian process: where a person had a joint in other frames, when the rest of the body was posed as it is now.

Motion-capture markers are completed in a similar way by the principal components of complete frames (Federolf 2013;
Gløersen & Federolf 2016); a kernel represents what a plane cannot. The equation is (2.25) of Rasmussen & Williams 2006.
"""

from collections.abc import Generator
from typing import TypeVar

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from dmae.completion.fillings import reject
from dmae.completion.methods import completion_method
from dmae.data.clip import Poses3D
from dmae.numerics.body import Bodies, interpolate_bodies
from dmae.numerics.filling import take_estimate, without_infinite
from dmae.numerics.paths import gap_lengths, pchip

T = TypeVar("T")
Steps = Generator[float, None, T]
"""Work in steps, and its result. A step ends with what it cost, about: 1 is a millisecond of one core."""


def finished(steps: Steps[T]) -> T:
    """Return the result of all steps."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


SHORT_GAP = 0.2
"""s; in gaps shorter than this interpolation is better than the Gaussian process."""

_LENGTH_SCALE = 0.1
"""m; length scale of the kernel. Poses that differ by more (root mean square over joints) are hardly correlated."""
_NOISE = 0.05
"""Variance of the noise, as a share of that of the process."""
_SPAN = 24.0
"""s of training poses, those nearest in time; of these at most `_MOST`, evenly spaced."""
_MOST = 300
_FEWEST = 20
"""Training poses; with fewer the process predicts nothing."""
_BLOCK = 5.0
"""s of frames that share training poses."""
_COST = 0.75
"""Of a joint of a person, see `Steps`."""


@completion_method("gaussian_process")
def fill_gaussian_process(poses: Poses3D, fps: float) -> Poses3D:
    """As rays, and limbs from the person's own poses in other frames.

    Limbs are placed by a Gaussian process over those poses. The longer a joint is hidden, the more weight it has.
    """
    poses = without_infinite(poses, fps)
    bodies = interpolate_bodies(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    finished(place_limbs(bodies, fps))
    return take_estimate(poses, fps, bodies.filled)


def place_limbs(bodies: Bodies, fps: float) -> Steps[None]:
    """Replace the interpolated estimates of limbs by those of the process, joint by joint."""
    for joint in (joint for joint in bodies.attached if joint not in bodies.torso):
        others = [other for other in bodies.attached if not _below(other, joint, bodies.parents, bodies.torso)]
        if _place(bodies, joint, others, fps):
            yield _COST * bodies.xyz.shape[1]


def _place(bodies: Bodies, joint: int, others: list[int], fps: float) -> bool:
    """Replace the estimate of a limb's joint, given other joints, which are placed; return whether it was hidden."""
    parent, first = bodies.parents[joint], bodies.filled[:, :, joint].copy()
    known = ~np.isnan(bodies.xyz[:, :, [joint, parent], 0]).any(-1)
    hidden = np.isnan(bodies.xyz[:, :, joint, 0])
    if not (hidden & ~np.isnan(first[..., 0])).any():
        return False
    offsets = bodies.in_body(bodies.filled - bodies.filled[:, :, bodies.parents])
    predicted = [
        predict_offset(offsets[:, i], joint, others, known[:, i], hidden[:, i], fps) for i in range(first.shape[1])
    ]
    offset = bodies.in_world(np.stack(predicted, 1)[:, :, None])[:, :, 0]
    bodies.filled[:, :, joint] = bodies.xyz[:, :, joint]
    bodies.place(joint, bodies.filled[:, :, parent] + offset, parent)
    squared = gap_lengths(~hidden)[..., None] ** 2
    change = squared / (squared + (SHORT_GAP * fps) ** 2) * (bodies.filled[:, :, joint] - first)
    bodies.filled[:, :, joint] = np.where(hidden[..., None], first + np.nan_to_num(change), first)
    return True


def _below(joint: int, ancestor: int, parents: list[int], torso: list[int]) -> bool:
    """Return whether a joint is another, or lies below it in the same limb; the torso is below nothing."""
    while joint != ancestor and joint not in torso and parents[joint] >= 0:
        joint = parents[joint]
    return ancestor in (joint, parents[joint])


def predict_offset(
    offsets: np.ndarray, joint: int, others: list[int], known: np.ndarray, hidden: np.ndarray, fps: float
) -> np.ndarray:
    """Predict the offset of one joint of a person from the offsets of others, (F, 3) m.

    Args:
        offsets: (F, J, 3) m, from the joints' parents, in a frame that turns with the body; interpolated where hidden.
        others: Joints to predict from.
        known: (F,) True where the joint and its parent were measured: the training frames.
        hidden: (F,) True where the prediction is wanted.

    Returns:
        m, an offset as those given, in the frames wanted and in those next to them; NaN elsewhere, and where there are
        too few training frames.
    """
    found = np.full((len(offsets), 3), np.nan)
    usable = ~np.isnan(offsets[:, others]).any((1, 2))
    training = np.flatnonzero(known & usable)
    if len(training) < _FEWEST:
        return found
    poses = offsets[:, others].reshape(len(offsets), -1) / (_LENGTH_SCALE * np.sqrt(len(others)))
    wanted = hidden.copy()
    wanted[1:] |= hidden[:-1]
    wanted[:-1] |= hidden[1:]
    block = max(round(_BLOCK * fps), 1)
    for start in range(0, len(offsets), block):
        asked = start + np.flatnonzero((wanted & usable)[start : start + block])
        if len(asked):
            near = _nearest(training, start + block / 2, round(_SPAN * fps))
            mean = offsets[near, joint].mean(0)
            factor = cho_factor(_kernel(poses[near], poses[near]) + _NOISE * np.eye(len(near)))
            weights = cho_solve(factor, offsets[near, joint] - mean)
            found[asked] = mean + _kernel(poses[asked], poses[near]) @ weights
    return found


def _nearest(frames: np.ndarray, to: float, count: int) -> np.ndarray:
    """Return of the `count` frames nearest to a time at most `_MOST`, evenly spaced."""
    close = np.sort(frames[np.argsort(np.abs(frames - to), kind="stable")[:count]])
    return close[np.linspace(0, len(close) - 1, min(len(close), _MOST)).round().astype(int)]


def _kernel(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the squared-exponential kernel (n, m) of poses (n, C) and (m, C); 1 where they are equal."""
    squared = (one**2).sum(1)[:, None] + (other**2).sum(1) - 2 * one @ other.T
    return np.exp(-np.maximum(squared, 0) / 2)


@completion_method("reject_gaussian_process")
def fill_reject_gaussian_process(poses: Poses3D, fps: float) -> Poses3D:
    """Drop joints that the frames around contradict, then fill as gaussian_process.

    What was rejected and filled again is `COMPLETED`.
    """
    return fill_gaussian_process(reject(poses, fps), fps)
