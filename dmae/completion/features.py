"""What a network is given about joints in addition to their coordinates, and how noisy poses are.

F frames, P persons, J joints.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from dmae.data.clip import Poses3D
from dmae.numerics.body import Bones, parent_bone_lengths, rotate_z
from dmae.numerics.filling import smooth
from dmae.numerics.paths import frames_away, neighbours, take_frames
from dmae.numerics.statistics import median_over_frames

_BONE_FRAMES, _JOINT_FRAMES, _PERSON_FRAMES = 3, 9, 51
"""Frames of a network over which the stretch of a bone, the jitter of a joint, and either of a whole person are
averaged."""
_PERSON_SECONDS = 1.0  # s before and after a frame over which `noisiness` is averaged; 51 frames at 25 frames/s
_UNIT, _SMALLEST = 0.01, 1e-3  # m; of which noise levels are multiples, and what is added before the logarithm is taken


def held_offsets(base: np.ndarray, observed: np.ndarray, parents: np.ndarray, heading: np.ndarray) -> np.ndarray:
    """Return how far from `base` a hidden joint is if held as it was last observed, or as it is next observed.

    It is held once relative to its parent, in a frame that turns with the body, and once in the world.

    Args:
        base: (F, P, J, 3) m, world; interpolated where not observed.
        observed: (F, P, J)
        parents: (J,) indices of the parents; a root is its own.
        heading: (F, P) rad, of the body.

    Returns:
        (F, P, J, 4, 3) m, world: last and next in the body, last and next in the world. Zero where the joint is
        observed, and for a side on which it never is.
    """
    angle, edges = heading[..., None], neighbours(observed)

    def held(values: np.ndarray) -> list[np.ndarray]:
        offsets = (take_frames(values, edge) - values for edge in edges)
        return [np.where(observed[..., None], 0, np.nan_to_num(offset)) for offset in offsets]

    in_body = held(rotate_z(base - base[:, :, parents], -angle))
    return np.stack([*(rotate_z(offset, angle) for offset in in_body), *held(base)], -2)


def bone_length_offsets(base: np.ndarray, xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return how far from `base` unmeasured joints are if their bones have their median measured length.

    Args:
        base: (F, P, J, 3) m, interpolated where not measured.
        xyz: (F, P, J, 3) m; NaN where not measured.

    Returns:
        (F, P, J, 2, 3) m: for the bone from the joint's parent, and on average for those to its children. Zero where
        the joint is measured, and for bones that never are.
    """
    current = np.maximum(parent_bone_lengths(base, bones), _SMALLEST)
    missing = np.nan_to_num(median_over_frames(parent_bone_lengths(xyz, bones)) / current - 1)
    offsets, children = np.zeros((*base.shape[:-1], 2, 3)), np.zeros(base.shape[2])
    for parent, joint in bones:
        offsets[:, :, joint, 0] = missing[..., joint, None] * (base[:, :, joint] - base[:, :, parent])
        offsets[:, :, parent, 1] -= offsets[:, :, joint, 0]
        children[parent] += 1
    offsets[..., 1, :] /= np.maximum(children, 1)[:, None]
    return np.where(np.isnan(xyz[..., :1, None]), offsets, 0)


def jitter(xyz: np.ndarray) -> np.ndarray:
    """Return how much measured paths jump from frame to frame, (F, P, J, 3), logarithms, 0 at a centimetre.

    The jump is the third difference of neighbouring frames, close to zero for motion without errors. It is averaged
    over the person for about two seconds, and over the joint where it was last observed and where it is next. Where
    too little was measured, a joint takes the value of its person, and that is 0.

    Args:
        xyz: (F, P, J, 3) m; NaN where not measured.
    """
    jump = np.full(xyz.shape[:-1], np.nan)
    if len(xyz) > 3:
        jump[2:-1] = np.linalg.norm(np.diff(xyz, 3, axis=0), axis=-1)
    return _noise_levels(jump, _JOINT_FRAMES)


def bone_stretch(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return how much measured bones differ from their median length, (F, P, J, 3) as `jitter`.

    A joint's bone is that from its parent. Fast limbs jitter as noisy ones do, but their bones keep their lengths.

    Args:
        xyz: (F, P, J, 3) m; NaN where not measured.
    """
    return _noise_levels(_stretch(xyz, bones), _BONE_FRAMES)


def _stretch(xyz: np.ndarray, bones: Bones) -> np.ndarray:
    """Return how much measured bones (F, P, J) differ from their median length, m."""
    lengths = parent_bone_lengths(xyz, bones)
    return np.abs(lengths - median_over_frames(lengths))


def _noise_levels(sizes: np.ndarray, frames: int) -> np.ndarray:
    """Return logarithms (F, P, J, 3) of means of `sizes` (F, P, J), m: of the person, and around the last and next
    known frame."""
    own = _moving_mean(np.nan_to_num(sizes), ~np.isnan(sizes), frames)
    person = np.broadcast_to(_of_person(sizes, _PERSON_FRAMES), own.shape)
    sides = (take_frames(own[..., None], edge)[..., 0] for edge in neighbours(~np.isnan(own)))
    levels = np.stack([person, *(np.where(np.isnan(side), person, side) for side in sides)], -1)
    return _logarithm(levels)


def _of_person(sizes: np.ndarray, frames: int) -> np.ndarray:
    """Return the mean (F, P, 1) of sizes (F, P, J) m of all joints within a number of frames; 0.01 m where unknown."""
    person = _moving_mean(np.nan_to_num(sizes).sum(-1), (~np.isnan(sizes)).sum(-1), frames)[..., None]
    return np.where(np.isnan(person), _UNIT, person)


def _logarithm(levels: np.ndarray) -> np.ndarray:
    return np.log((levels + _SMALLEST) / _UNIT)


def _moving_mean(sums: np.ndarray, counts: np.ndarray, frames: int) -> np.ndarray:
    """Return the mean of sums (F, ...) of counts (F, ...) within a number of frames; NaN where the count is zero."""
    total = uniform_filter1d(sums, frames, axis=0, mode="constant")
    count = uniform_filter1d(counts.astype(float), frames, axis=0, mode="constant")
    some = count * frames > 0.5
    return np.where(some, total / np.where(some, count, 1), np.nan)


_EXACT, _NOISY = -1.5, -0.1  # By `bone_stretch` poses are exact up to the first (1 mm), noisy from the second (8 mm)
_NEAR = 0.2  # s; farther from any measurement of a person, regions of 90 % held less than 80 % of the truth


def noisiness(poses: Poses3D, fps: float) -> np.ndarray:
    """Return from 0 where poses are exact to 1 where they are as noisy as captured ones, (F, P, 1).

    It is judged by how much a person's bones stretch within two seconds.
    """
    sizes = _stretch(poses.xyz.astype(np.float64), poses.skeleton.bones)
    stretch = _logarithm(_of_person(sizes, 2 * round(_PERSON_SECONDS * fps) + 1))
    return ((stretch - _EXACT) / (_NOISY - _EXACT)).clip(0, 1)


def correction_weight(poses: Poses3D, fps: float) -> np.ndarray:
    """Return the weight of a network's correction of interpolated and of measured joints, (F, P, J, 1).

    It is 1 for interpolated joints. Measured joints are corrected the less the more exact the poses are.
    """
    return np.where(poses.measured[..., None], noisiness(poses, fps)[..., None], 1.0)


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
    return (np.minimum(*frames_away(np.any(poses.measured, -1))) <= _NEAR * fps)[..., None]
