"""Pruning: drop joints that cannot be right, because they break bones, or jump away and return."""

from math import prod

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.files.mapped import column_blocks, empty, frame_blocks
from dmae.numerics.body import BONE_SLACK, BONE_STRETCH, bone_lengths, symmetric_bone_lengths
from dmae.numerics.compiled import compiled

LONGEST_JUMP = 0.2
"""s"""
_NOISE = 0.10  # m; a deviation that noise explains, of joints measured well
_DEVIATIONS, _BONE_DEVIATIONS = 4.0, 4.0
"""Usual standard deviations of a joint that noise explains, in its place and in the length of a bone to it."""
_ACCELERATION = 60.0  # m/s^2; hands in vigorous motion reach it


def prune(xyz: np.ndarray, skeleton: Skeleton, fps: float, deviation: float = 0.0) -> np.ndarray:
    """Return joints (F, P, J, 3) with NaN in place of those that break bones or jump.

    Args:
        deviation: Usual standard deviation of a joint along one axis, m. More than usual is not excused by it: where
            the others of a recording are well measured, a joint that breaks bones is best left to completion.
    """
    pruned, usual = empty(xyz.shape, np.float64), symmetric_bone_lengths(xyz, skeleton)
    for part in frame_blocks(xyz, pruned):
        pruned[part] = np.where(broken(xyz[part], skeleton, usual, deviation)[..., None], np.nan, xyz[part])
    paths = pruned.reshape(len(pruned), prod(pruned.shape[1:-1]), 3)
    for columns, unbroken in column_blocks(paths):
        dropped = jumps(unbroken, fps, _ACCELERATION / skeleton.scale, deviation)
        if dropped.any():
            for part in frame_blocks(paths):
                paths[part, columns][dropped[part]] = np.nan
    return pruned


def broken(xyz: np.ndarray, skeleton: Skeleton, usual: np.ndarray | None = None, deviation: float = 0.0) -> np.ndarray:
    """Find joints at the ends of bones that do not have their usual length.

    Of the two ends of such a bone, the one with more wrong bones is chosen; of equals, the one with the larger share of
    wrong bones; of equals, the one further from the root.

    Args:
        xyz: (F, P, J, 3) m, NaN where absent.
        usual: (P, B) m, usual lengths of the rigid bones; by default those in these frames.
        deviation: As for `prune`.

    Returns:
        (F, P, J) True for the joints to drop.
    """
    usual = symmetric_bone_lengths(xyz, skeleton) if usual is None else usual
    bones, slack = skeleton.rigid_bones, max(BONE_SLACK, _BONE_DEVIATIONS * deviation)
    lengths = bone_lengths(xyz, bones)
    wrong = np.abs(lengths - usual) > BONE_STRETCH * usual + slack
    ends = np.zeros((len(bones), len(skeleton)))
    for bone, joints in enumerate(bones):
        ends[bone, list(joints)] = 1
    count, known = wrong @ ends, ~np.isnan(lengths) @ ends
    blame = count + 0.5 * count / np.maximum(known, 1)
    dropped = np.zeros(xyz.shape[:3], bool)
    for bone, (parent, joint) in enumerate(bones):
        outer = blame[..., joint] >= blame[..., parent]
        dropped[..., joint] |= wrong[..., bone] & outer
        dropped[..., parent] |= wrong[..., bone] & ~outer
    return dropped


def jumps(xyz: np.ndarray, fps: float, acceleration: float = _ACCELERATION, deviation: float = 0.0) -> np.ndarray:
    """Find samples of joints that leave their path and return to it faster than a body can.

    A run of samples is a jump when each of them is off the sample before the run, the sample after it and the chord
    between these two by more than noise and a parabola of the greatest acceleration.

    Args:
        xyz: (F, ..., 3) m, NaN where absent.
        acceleration: m/s^2, the greatest that motion explains.
        deviation: As for `prune`.

    Returns:
        (F, ...) True for the samples to drop.
    """
    flat = np.ascontiguousarray(xyz, np.float64).reshape(len(xyz), prod(xyz.shape[1:-1]), 3)
    noise = max(_NOISE, _DEVIATIONS * deviation)
    known, widest = ~np.isnan(flat[..., 0]), max(round(LONGEST_JUMP * fps), 1)
    before, wanted = known.copy(), np.ones(flat.shape[1], bool)
    while wanted.any():
        # Of runs near each other only the worst is dropped: a jump makes the samples around it look impossible.
        runs = impossible_runs(flat, known, wanted, float(fps), widest, noise, acceleration)
        drop_runs(runs[np.lexsort((-runs[:, 0], runs[:, 1]))], known, widest)
        wanted[:] = False
        wanted[runs[:, 1].astype(int)] = True
    return (before & ~known).reshape(xyz.shape[:-1])


@compiled()
def impossible_runs(xyz, known, wanted, fps, widest, noise, acceleration):
    """Return impossible runs of samples of n paths, (m, 4): the deviation, the path, the first sample, and the end.

    Samples are counted among the known ones of their path; see `jumps`.

    Args:
        xyz: (F, n, 3) m.
        known: (F, n) True for the samples of the paths.
        wanted: (n,) True for the paths to judge.
        fps: Frames per second.
        widest: Largest number of samples in a run.
        noise: m; a deviation that noise explains.
        acceleration: m/s^2, the greatest.
    """
    frames, paths = known.shape
    kept, runs, number = np.empty(frames, np.int64), np.empty((16, 4)), 0
    for path in range(paths):
        if not wanted[path]:
            continue
        count, least = 0, np.inf
        for frame in range(frames):
            if known[frame, path]:
                kept[count] = frame
                count += 1
        for i in range(count - 1):
            least = min(least, (kept[i + 1] - kept[i]) / fps)
        for before in range(count - 2):
            # A jump starts with a step that is too long, so most of the path need not be examined.
            dt = (kept[before + 1] - kept[before]) / fps
            step = _distance(xyz[kept[before + 1], path], xyz[kept[before], path])
            if step <= noise + acceleration / 2 * dt * least:
                continue
            for width in range(1, min(widest, count - before - 2) + 1):
                ratio = _ratio(xyz, path, kept, before, width, fps, noise, acceleration)
                if ratio > 1:
                    if number == len(runs):
                        fewer, runs = runs, np.empty((2 * number, 4))
                        for run in range(number):
                            for k in range(4):
                                runs[run, k] = fewer[run, k]
                    runs[number, 0], runs[number, 1] = ratio, path
                    runs[number, 2], runs[number, 3] = before + 1, before + 1 + width
                    number += 1
    return runs[:number]


@compiled()
def drop_runs(runs, known, widest):
    """Drop runs of samples from the known ones of their paths, in the order given, unless one near them was dropped.

    Args:
        runs: (m, 4) as `impossible_runs` returns them, sorted by path.
        known: (F, n), written.
        widest: Runs fewer samples apart than this are near each other.
    """
    frames = len(known)
    kept, touched = np.empty(frames, np.int64), np.empty(frames, np.bool_)
    path, count = -1, 0
    for run in range(len(runs)):
        if int(runs[run, 1]) != path:
            path, count = int(runs[run, 1]), 0
            for frame in range(frames):
                if known[frame, path]:
                    kept[count] = frame
                    count += 1
            touched[:count] = False
        start, end = int(runs[run, 2]), int(runs[run, 3])
        near = False
        for i in range(start, end):
            near |= touched[i]
        if not near:
            for i in range(start, end):
                known[kept[i], path] = False
            touched[max(start - widest, 0) : min(end + widest, count)] = True


@compiled()
def _ratio(xyz, path, kept, before, width, fps, noise, acceleration):
    """Return the smallest deviation among the samples of a run after `before`; less than 1 if the run is allowed."""
    first, last = kept[before], kept[before + width + 1]
    a, b, ratio = xyz[first, path], xyz[last, path], np.inf
    chord = np.empty(3)
    for i in range(before + 1, before + width + 1):
        c, since, until = xyz[kept[i], path], (kept[i] - first) / fps, (last - kept[i]) / fps
        for k in range(3):
            chord[k] = a[k] + (b[k] - a[k]) * (since / (since + until))
        deviation = min(_distance(c, chord), min(_distance(c, a), _distance(c, b)))
        ratio = min(ratio, deviation / (noise + acceleration / 2 * since * until))
    return ratio


@compiled()
def _distance(a, b):
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
