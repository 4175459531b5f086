"""Joints that break bones, and samples that jump away from their path and return, compiled."""

import numpy as np

from dmae.numerics.compiled import compiled


@compiled()
def drop_broken(lengths, usual, bones, stretch, slack, dropped):
    """Find the joints at the ends of bones that do not have their usual length; see `dmae.reconstruction.pruning`.

    Args:
        lengths: (F, P, B) m; NaN where unknown.
        usual: (P, B) m; NaN where unknown.
        bones: (B, 2) parent and joint.
        stretch: Largest error of a bone, as a share of its length.
        slack: Additional error of a bone, m.
        dropped: (F, P, J) filled with False by the caller; True for joints to drop.
    """
    frames, persons, joints = dropped.shape
    wrong, count, known = np.empty(len(bones), np.bool_), np.empty(joints), np.empty(joints)
    for f in range(frames):
        for p in range(persons):
            count[:], known[:] = 0.0, 0.0
            some = False
            for b in range(len(bones)):
                length = lengths[f, p, b]
                wrong[b] = abs(length - usual[p, b]) > stretch * usual[p, b] + slack
                some |= wrong[b]
                for end in range(2):
                    count[bones[b, end]] += wrong[b]
                    known[bones[b, end]] += not np.isnan(length)
            if not some:
                continue
            for b in range(len(bones)):
                if wrong[b]:
                    parent, joint = bones[b]
                    above = count[parent] + 0.5 * count[parent] / max(known[parent], 1.0)
                    below = count[joint] + 0.5 * count[joint] / max(known[joint], 1.0)
                    dropped[f, p, joint if below >= above else parent] = True


@compiled()
def impossible_runs(xyz, known, wanted, fps, widest, noise, acceleration):
    """Return impossible runs of samples of n paths, (m, 4): the deviation, the path, the first sample, and the end.

    Samples are counted among the known ones of their path; see `dmae.reconstruction.pruning.jumps`.

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
                ratio = _ratio(xyz[:, path], kept, before, width, fps, noise, acceleration)
                if ratio > 1:
                    if number == len(runs):
                        more = np.empty((2 * number, 4))
                        more[:number] = runs
                        runs = more
                    runs[number, 0], runs[number, 1] = ratio, path
                    runs[number, 2], runs[number, 3] = before + 1, before + 1 + width
                    number += 1
    return runs[:number]


@compiled()
def drop_runs(runs, known, widest):
    """Drop runs of samples from the known ones of their paths, in the order given, unless one near them was dropped.

    Args:
        runs: (m, 4) as `impossible_runs` returns them, those of a path together.
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
def _ratio(xyz, kept, before, width, fps, noise, acceleration):
    """Return the smallest deviation among the samples of a run after `before`; less than 1 if the run is allowed."""
    first, last = kept[before], kept[before + width + 1]
    a, b, ratio = xyz[first], xyz[last], np.inf
    chord = np.empty(3)
    for i in range(before + 1, before + width + 1):
        c, since, until = xyz[kept[i]], (kept[i] - first) / fps, (last - kept[i]) / fps
        for k in range(3):
            chord[k] = a[k] + (b[k] - a[k]) * (since / (since + until))
        deviation = min(_distance(c, chord), min(_distance(c, a), _distance(c, b)))
        ratio = min(ratio, deviation / (noise + acceleration / 2 * since * until))
    return ratio


@compiled()
def _distance(a, b):
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
