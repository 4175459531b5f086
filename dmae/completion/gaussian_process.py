"""A Gaussian process over a person's own poses: where it had a joint when the body was posed as it is now.

Limbs come first, by a kernel for noisy poses. Where poses are exact, as of motion capture with markers, a second
process corrects limbs and hidden hips and shoulders.

Motion-capture markers are completed in a similar way by the principal components of complete frames (Federolf 2013;
Gløersen & Federolf 2016); a kernel represents what a plane cannot. The equation is (2.25) of Rasmussen & Williams 2006.
"""

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from dmae.completion.features import noisiness
from dmae.completion.fillings import reject
from dmae.completion.methods import completion_method
from dmae.data.clip import Poses3D
from dmae.numerics.body import Bodies, interpolate_bodies
from dmae.numerics.filling import keep_rejected, take_estimate, without_infinite
from dmae.numerics.paths import gap_lengths, pchip, runs

SHORT_GAP = 0.2
"""s; in gaps shorter than this interpolation is better than the Gaussian process."""

_LENGTH_SCALE = 0.1
"""m; length scale of the kernel. Poses that differ by more (root mean square over joints) are hardly correlated."""
_NOISE = 0.05  # Variance of the noise divided by the variance of the process
_SPAN = 24.0  # s of training poses, those nearest in time; of these at most `_MOST`, evenly spaced
_MOST = 300
_FEWEST = 20  # Training poses; with fewer the process predicts nothing
_BLOCK = 5.0  # s of frames that share training poses


@completion_method("gaussian_process")
def fill_gaussian_process(poses: Poses3D, fps: float) -> Poses3D:
    """As rays, and limbs from the person's own poses in other frames; of exact poses the torso too.

    Gaussian processes over those poses place them. The longer a limb is hidden, the more weight its process has.
    """
    poses = without_infinite(poses, fps)
    bodies = interpolate_bodies(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    # Rays of single cameras say more than other frames do.
    exact = np.where(np.isnan(poses.rays[..., 0, 0]), (1 - noisiness(poses, fps)) ** 2, 0)
    place_torso(bodies, exact, fps)
    place_limbs(bodies, fps)
    correct_limbs(bodies, exact, fps)
    return take_estimate(poses, fps, bodies.filled)


def limbs_of(bodies: Bodies) -> list[int]:
    """Return the joints that hang from the torso, parents first."""
    return [joint for joint in bodies.attached if joint not in bodies.torso]


def place_limbs(bodies: Bodies, fps: float) -> None:
    """Replace the interpolated estimates of limbs by what the process predicts, joint by joint."""
    for joint in limbs_of(bodies):
        others = [other for other in bodies.attached if not _below(other, joint, bodies.parents, bodies.torso)]
        _place(bodies, joint, others, fps)


def _place(bodies: Bodies, joint: int, others: list[int], fps: float) -> None:
    """Replace the estimate of a limb's joint where it is hidden, given other joints, which are placed."""
    parent, first = bodies.parents[joint], bodies.filled[:, :, joint].copy()
    known = ~np.isnan(bodies.xyz[:, :, [joint, parent], 0]).any(-1)
    hidden = np.isnan(bodies.xyz[:, :, joint, 0])
    if not (hidden & ~np.isnan(first[..., 0])).any():
        return
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
        m, offsets like the given ones, in the frames wanted and the frames next to them; NaN elsewhere, and where there
        are too few training frames.
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
    squared = (one**2).sum(1)[:, None] + (other**2).sum(1)
    squared -= 2 * one @ other.T
    np.maximum(squared, 0, out=squared)
    squared /= -2
    return np.exp(squared, out=squared)


# Exact poses: what a hidden joint was relative to the nearest joint that is measured throughout its gap.

_DENSE, _REACH = 0.8, 12.0
"""s; all training poses within the first of a gap, and within the second evenly spaced ones, at most `_MOST_OF_GAP`."""
_MOST_OF_GAP = 160
_CLOSENESS, _SPREAD = 1.67, 0.05
"""How fast correlation falls with the distance between poses, and m, the spread below which joints count alike."""
_POSE, _POSE_NOW, _NOW = 10.0, 3.0, 1.0
"""Variances, relative to each other: of poses at any time, of poses within seconds, and of instants."""
_SECONDS, _INSTANT = 2.0, 0.3  # s; their length scales in time
_EXACT_NOISE = 1.3e-3  # Variance of the noise of exact poses, in the same unit
_SHARE = 0.5  # Weight in limbs, against the process of all joints: their errors differ


def place_torso(bodies: Bodies, exact: np.ndarray, fps: float) -> None:
    """Correct unmeasured joints of the torso; hidden limbs that hang from them move along.

    Args:
        exact: (F, P, J) weight of the correction, from 0 where poses are noisy to 1 where they are exact.
    """
    before = bodies.filled.copy()
    for joint in bodies.torso:
        _correct(bodies, joint, exact[:, :, joint], fps)
    for joint in limbs_of(bodies):
        parent = bodies.parents[joint]
        moved = np.nan_to_num(bodies.filled[:, :, parent] - before[:, :, parent])
        free = np.isnan(bodies.xyz[:, :, joint, :1]) & (exact[:, :, joint, None] > 0)
        bodies.filled[:, :, joint] += np.where(free, moved, 0)


def correct_limbs(bodies: Bodies, exact: np.ndarray, fps: float) -> None:
    """Correct unmeasured joints of limbs, which are placed, where poses are exact (F, P, J)."""
    for joint in limbs_of(bodies):
        squared = gap_lengths(~np.isnan(bodies.xyz[:, :, joint, 0])) ** 2
        weight = _SHARE * squared / (squared + (SHORT_GAP * fps) ** 2)
        _correct(bodies, joint, weight * exact[:, :, joint], fps)


def _correct(bodies: Bodies, joint: int, weight: np.ndarray, fps: float) -> None:
    """Move a hidden joint, by weights (F, P), towards where the process expects it."""
    measured, placed = ~np.isnan(bodies.xyz[..., 0]), ~np.isnan(bodies.filled[..., 0])
    turned = ~np.isnan(bodies.world_from_body[..., 0, 0])
    hidden = ~measured[:, :, joint] & placed[:, :, joint]
    placed = np.ascontiguousarray(np.moveaxis(placed, 0, -1))
    for person in np.flatnonzero((hidden & (weight > 0)).any(0)):
        filled, xyz, turn = bodies.filled[:, person], bodies.xyz[:, person], bodies.world_from_body[:, person]
        for first, end in runs(hidden[:, person]):
            anchor, inputs, origins = _inputs(bodies, joint, seen=measured[first:end, person].all(0))
            if anchor is None or not weight[first:end, person].any():
                continue
            start = max(first - int(_REACH * fps) - 1, 0)
            near, gap = slice(start, end + int(_REACH * fps) + 1), np.arange(first, end)
            usable = placed[person, inputs + origins, near].all(0) & turned[near, person]
            known = start + np.flatnonzero(usable & measured[near, person][:, [joint, anchor]].all(1))
            frames = _training_frames(known, first, end, fps)
            if len(frames) < _FEWEST or not usable[gap - start].all():
                continue
            at = np.concatenate([frames, gap])
            offsets = (filled[at[:, None], inputs] - filled[at[:, None], origins]) @ turn[at]
            wanted = np.einsum("fji,fj->fi", turn[frames], xyz[frames, joint] - xyz[frames, anchor])
            found = predict_gap(offsets, wanted, at, fps)
            change = filled[gap, anchor] + np.einsum("fij,fj->fi", turn[gap], found) - filled[gap, joint]
            filled[gap, joint] += weight[gap, person, None] * change


def _inputs(bodies: Bodies, joint: int, seen: np.ndarray) -> tuple[int | None, list[int], list[int]]:
    """Return what a joint is placed from, in a gap throughout which the joints `seen` (J,) are measured.

    Returns:
        The anchor: the nearest joint above it, or beside it in the torso, that is seen; None if no joint of the torso
        is. The joints to predict from. And for each of these the joint that its offset is measured from: its parent,
        or the anchor where the parent is hidden too.
    """
    parents, torso = bodies.parents, bodies.torso
    if joint in torso:
        part = torso
        there = [other for other in torso if seen[other]]
        beside = [other for other in there if other == parents[joint] or parents[other] == joint]
        anchor = next(iter(beside + there), None)
    else:
        part, anchor = [joint], parents[joint]
        while anchor not in torso and not seen[anchor] and parents[anchor] >= 0:
            part.append(anchor)
            anchor = parents[anchor]
    if anchor is None:
        return None, [], []
    lost = {other for other in part if not seen[other]}
    inputs, origins = [], []
    for other in bodies.attached:
        hangs = parents[other] in lost
        if other not in lost and (seen[other] or not hangs):
            inputs.append(other)
            origins.append(anchor if hangs else parents[other])
    return anchor, inputs, origins


def _training_frames(known: np.ndarray, first: int, end: int, fps: float) -> np.ndarray:
    """Return which of the frames `known` teach about a gap: the nearest ones, and others that are evenly spaced."""
    away = np.maximum(first - known, known - end + 1) / fps
    close = known[away <= _DENSE][:: max(round(fps / 25), 1)]
    far = known[(away > _DENSE) & (away <= _REACH)]
    count = min(len(far), max(_MOST_OF_GAP - len(close), 0))
    return np.sort(np.concatenate([close, far[np.linspace(0, len(far) - 1, count).round().astype(int)]]))


def predict_gap(offsets: np.ndarray, wanted: np.ndarray, frames: np.ndarray, fps: float) -> np.ndarray:
    """Predict the offset of a joint in the G frames of a gap, (G, 3) m, from n training frames.

    The kernel is k = exp(-d^2 / 2) (10 + 3 m(t / 2 s)) + m(t / 0.3 s), with the Matern kernel m (nu = 5/2). In the
    distance d between poses each joint counts by its correlation with the wanted one, and the less the more it moves.

    Args:
        offsets: (n + G, C, 3) m, of other joints, in a frame that turns with the body.
        wanted: (n, 3) m, of the joint in the training frames.
        frames: (n + G,) frame numbers; the training frames come first, then the gap.
    """
    n = len(wanted)
    mean = wanted.mean(0)
    targets, others = wanted - mean, offsets[:n] - offsets[:n].mean(0)
    spread, size = (np.sqrt((each**2).sum(-1).mean(0)) + 1e-9 for each in (others, targets))
    correlation = np.linalg.norm(np.einsum("nci,nj->cij", others, targets), axis=(1, 2)) / (n * spread * size)
    weights = _CLOSENESS * correlation / ((spread + _SPREAD) * np.sqrt(len(spread)))
    poses = (offsets * weights[:, None]).reshape(len(offsets), -1)
    apart = np.abs(frames[:, None] - frames[:n])
    seconds = np.arange(apart.max() + 1) / fps
    pose, now = _POSE + _POSE_NOW * _matern(seconds / _SECONDS), _NOW * _matern(seconds / _INSTANT)

    def covariance(of: slice) -> np.ndarray:
        return _kernel(poses[of], poses[:n]) * pose[apart[of]] + now[apart[of]]

    factor = cho_factor(covariance(slice(n)) + _EXACT_NOISE * np.eye(n))
    return mean + covariance(slice(n, None)) @ cho_solve(factor, targets)


def _matern(distance: np.ndarray) -> np.ndarray:
    """Return the Matern kernel with nu = 5/2; Rasmussen & Williams 2006, (4.17)."""
    scaled = 5**0.5 * distance
    return (1 + scaled + scaled**2 / 3) * np.exp(-scaled)


@completion_method("reject_gaussian_process")
def fill_reject_gaussian_process(poses: Poses3D, fps: float) -> Poses3D:
    """Drop joints that the frames around contradict, then fill as gaussian_process.

    What was rejected and filled again is `COMPLETED`.
    """
    return keep_rejected(fill_gaussian_process(reject(poses, fps), fps), poses)
