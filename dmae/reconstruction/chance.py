"""Chance: how often unrelated figures agree, which tells people from ghosts, the figures where no person is.

V views, D detections in a view, P persons, J joints.
"""

import numpy as np
from scipy.special import gammaincc

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.files.mapped import by_frames
from dmae.numerics.compiled import compiled
from dmae.numerics.statistics import evenly_spaced, mean_known, median_known, median_over_frames
from dmae.reconstruction.association import NONE
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.noise import USUAL, DetectionNoise
from dmae.reconstruction.triangulation import project

_WITHIN_REACH = 0.1
"""Share of the floor in which figures that agree continue a track: 1 m around its place in a room of 6 m."""
_LEAST_EXPECTED = 0.001
"""Smallest number expected by chance that counts in a frame, so that no frame decides alone: the least numbers are
those in which ghosts resemble each other most, which `expected_by_chance` does not know."""


def surprise(expected: np.ndarray, measured: np.ndarray) -> np.ndarray:
    """Return -ln p of frames (F, P) in which tracks were measured, 0 in others; p is the probability that figures agree
    as well by chance.

    If the track was measured in the frame before, they have to be within its reach. Otherwise any figure, in this frame
    or in a missed one, may re-enter as this person.

    Args:
        expected: (F, P) numbers of people expected by chance.
        measured: (F, P) True where a track was measured.
    """
    frame, missed = np.arange(len(expected))[:, None], np.zeros(expected.shape)
    before = np.maximum.accumulate(np.where(measured, frame, -1))[:-1]
    missed[1:] = np.where(before < 0, 0, frame[1:] - before - 1)
    tries = np.where(missed > 0, 1 + missed, _WITHIN_REACH)
    return np.where(measured, -np.log(-np.expm1(-tries * np.maximum(expected, _LEAST_EXPECTED))), 0)


def passing_ghosts(measured: np.ndarray, surprises: np.ndarray, frames: int, most: float | None) -> np.ndarray:
    """Return (P,) True for tracks that ghosts which come and go form by chance in a recording.

    In a few frames of a track, views of ghosts agree well; in the others, a tracker takes what is near. By chance, p of
    each frame (see `surprise`) is uniform, so the sum of -ln p over n frames has a gamma distribution of shape n
    (R. A. Fisher's combined probability). A track may start in any frame and at any place, so the number of tracks
    expected by chance is the probability of such a sum times the number of frames and of places.

    Args:
        measured: (P,) numbers of frames in which tracks were measured.
        surprises: (P,) sums of `surprise` over these frames.
        frames: Number of frames of the recording.
        most: Largest number of tracks expected by chance; None accepts all.
    """
    if most is None:
        return np.zeros(len(measured), bool)
    return frames / _WITHIN_REACH * gammaincc(np.maximum(measured, 1), surprises) > most


_SAMPLED = 3, 24  # Numbers of frames, least and greatest, in which it is examined whether a figure moves
_AT_REST = 4.0  # Sigmas; half of the joints of a figure that rests stay within this
_LONE, _PASSING = 2, 0.1
"""A view shows a figure passing if so few of its frames, this one included, show it there: a tracker that hops between
ghosts at rest meets each again. Share of frames in which two views show that of somebody who stands, then walks."""
_GESTURE = 3.0  # Sigmas; a joint moves if half of its detections are farther than this from their mean
_SLOW, _EVEN = 0.4, 0.7
"""m; somebody who moves slowly is within this of the middle of the way. Largest scatter around an even motion, relative
to the scatter around the mean, of a figure that moves."""
_SURE = 0.25
"""Share of the largest number expected by chance that counts for figures of three views or more: people who rest are
far below, those whom two views see are not."""
_FITTING = 1.8  # Sigmas; a figure shows a person if half of its joints, averaged over time, are within this


def resting_ghosts(
    clip: Clip, assigned: np.ndarray, xyz: np.ndarray, config: CaptureConfig, noise: DetectionNoise
) -> np.ndarray:
    """Return (P,) True for tracks of ghosts that rest in the images and agree by chance.

    Ghosts that come and go agree in some frames only. Those that stay agree in all frames if they do in one: the frames
    say the same thing again and again, and in the luckiest of them the agreement looks close. So the joints of figures
    that rest are averaged over time, which leaves what the views really disagree by, and count as one observation.
    Views that do not fit the others closer than detections scatter are not views of this figure. What is left has to be
    beyond chance, see `expected_by_chance`. Figures that move, or whose joints move, in two views at once are people.
    So are those that rest in fewer than two, and those that move slowly and evenly. With two cameras nobody is judged:
    of people who stand in a group, pairs of figures are hardly beyond chance.

    Args:
        assigned: (F, P, V, J) index of the detection that shows the joint in the view, or `NONE`.
        xyz: (F, P, J, 3) m, NaN where absent.
    """
    ghosts, most = np.zeros(assigned.shape[1], bool), config.tracking.max_by_chance
    if most is None or len(clip.rig) < 3:
        return ghosts
    rig, resting, means, moving = clip.rig.undistorted, [], [], np.zeros(len(clip.rig))
    for person in range(len(ghosts)):
        frames = np.flatnonzero(by_frames(lambda part: (part != NONE).any((1, 2)), assigned[:, person]))
        if len(frames) < _SAMPLED[0]:
            continue
        share = len(frames) / len(clip)
        frames = frames[evenly_spaced(len(frames), _SAMPLED[1])]
        mean = _at_rest(clip, frames, assigned[frames, person], xyz[frames, person], noise)
        if mean is None:
            moving += share * (assigned[frames, person] != NONE).any(-1).mean(0)
        else:
            resting.append(person)
            means.append(mean)
    if not resting:
        return ghosts
    # Each mean figure is a detection of its own.
    xy = np.stack(means, 1)
    known = ~np.isnan(xy[..., 0])
    evidence = Evidence(rig, xy[None], np.where(known, USUAL, np.nan)[None], config.widened(noise.widening), noise)
    own = np.ascontiguousarray(np.where(known.swapaxes(0, 1), np.arange(len(resting))[:, None, None], NONE))
    for figure in own:
        _drop_misfits(evidence, figure)
    points = evidence.triangulate(own[None])
    figures = np.maximum(_figures(clip, config.th_p) - moving, 1)
    all_count = np.full(len(rig), np.inf)
    expected = expected_by_chance(
        rig.projections, rig.focal, rig.size, xy, own, points.xyz[0], points.used[0], figures, all_count, float(most)
    )
    ghosts[resting] = expected > np.where((own != NONE).any(-1).sum(-1) >= 3, _SURE * most, most)
    return ghosts


def _figures(clip: Clip, th_p: float) -> np.ndarray:
    """Return the mean number (V,) of detections of three confident joints or more."""
    frames = evenly_spaced(len(clip), _SAMPLED[1])
    return ((clip.detections.score[frames] >= th_p).sum(-1) >= 3).sum(-1).mean(0)


def _at_rest(
    clip: Clip, frames: np.ndarray, assigned: np.ndarray, xyz: np.ndarray, noise: DetectionNoise
) -> np.ndarray | None:
    """Return the mean figures (V, J, 2), undistorted px, of a track that rests in S sampled frames.

    None if it moves, or rests in fewer than two views. `frames` is (S,), `assigned` (S, V, J) detections of its joints,
    `xyz` (S, J, 3) m.
    """
    rig, views = clip.rig, assigned.shape[1]
    figure = _most_frequent(assigned)
    own = (assigned == figure[..., None]) & (assigned != NONE)
    found = clip.detections.xy[frames[:, None], np.arange(views), figure]
    found = rig.undistort(np.where(own[..., None], found, np.nan))
    middle = median_known(xyz.reshape(-1, 3))
    depth = rig.cam_from_world[:, 2, :3] @ middle + rig.cam_from_world[:, 2, 3]
    # What calibration is off by is the same in all frames.
    scatter2 = (noise.usual_m * rig.focal / np.maximum(depth, 0.1)) ** 2 - noise.calibration_px**2
    sigma = np.hypot(np.sqrt(np.maximum(scatter2, 0)), noise.jitter_px)
    means, moved, gestures = np.full(found.shape[1:], np.nan), 0, np.zeros(found.shape[2], int)
    passing = np.zeros(len(frames), int)  # number of views
    for view in range(views):
        seen = np.flatnonzero(own[:, view].sum(-1) >= 3)
        shown = found[seen, view]
        if len(shown) < _SAMPLED[0] / 2:
            continue
        near = _near(shown, _AT_REST * sigma[view])
        same = near[near.sum(1).argmax()]
        moves = 2 * same.sum() < len(same)
        passing[seen[(near.sum(1) <= _LONE) | moves]] += 1
        if moves:
            moved += 1
            continue
        means[view] = mean_known(shown[same])
        away = median_over_frames(np.linalg.norm(shown[same] - means[view], axis=-1))
        gestures += away > _GESTURE * sigma[view]
    resting = (~np.isnan(means[..., 0])).any(-1).sum()
    walks = moved >= 2 or (passing >= 2).sum() >= max(2, _PASSING * len(frames))
    if walks or resting < 2 or (gestures >= 2).sum() >= 2 or _moves_slowly(rig, frames, found, xyz, middle):
        return None
    return means


def _moves_slowly(rig: CameraRig, frames: np.ndarray, found: np.ndarray, xyz: np.ndarray, middle: np.ndarray) -> bool:
    """Whether a figure moves slowly and evenly: detections (S, V, J, 2) px scatter less around its even motion than
    around its mean.

    Somebody who walks towards a camera rests in its images, and in those of the others for a second. The triangulated
    place of a ghost, (S, J, 3) m around the `middle` (3,), also moves where views join and leave, its images do not.
    """
    path = median_known(xyz - median_over_frames(xyz))
    near = np.linalg.norm(path, axis=-1) < _SLOW
    if not near.any():
        return False
    when = frames - frames[near].mean()
    velocity = when[near] @ path[near] / max((when[near] ** 2).sum(), 1)
    places = middle + np.stack([when, np.zeros_like(when)], 1)[..., None] * velocity  # (S, 2, 3)
    moving, resting = np.moveaxis(rig.undistorted.project(places)[0], 2, 0)
    scatter = [
        median_over_frames(np.linalg.norm(each - mean_known(each), axis=-1).ravel())
        for each in (found, found - (moving - resting)[:, :, None])
    ]
    return bool(scatter[1] < _EVEN * scatter[0])


def _most_frequent(detections: np.ndarray) -> np.ndarray:
    """Return the most frequent detection (...) among those of joints (..., J), the first of equals; `NONE` for none."""
    known = detections != NONE
    count = ((detections[..., None] == detections[..., None, :]) & known[..., None]).sum(-2)
    most = known & (count == count.max(-1, keepdims=True))
    first = np.where(most, detections, np.iinfo(detections.dtype).max).min(-1)
    return np.where(known.any(-1), first, NONE)


@compiled()
def _near(shown, reach):
    """Return (S, S) True for frames in which half of the joints (S, J, 2) px are within reach of each other."""
    frames, joints = shown.shape[:2]
    near, apart, order = np.zeros((frames, frames), np.bool_), np.empty(joints), np.empty(joints, np.int64)
    for a in range(frames):
        for b in range(a + 1):
            known = 0
            for j in range(joints):
                dx, dy = shown[a, j, 0] - shown[b, j, 0], shown[a, j, 1] - shown[b, j, 1]
                distance = np.sqrt(dx * dx + dy * dy)
                if not np.isnan(distance):
                    apart[known] = distance
                    known += 1
            if known:
                _ascending(apart[:known], order)
                middle = apart[order[(known - 1) // 2]] + apart[order[known // 2]]
                near[a, b] = near[b, a] = middle / 2 < reach
    return near


def _drop_misfits(evidence: Evidence, own: np.ndarray) -> None:
    """Replace by `NONE`, one by one, the views (V, J) of a figure that fit worst: most joints farther off than noise
    explains."""
    rig, noise = evidence.rig, evidence.noise
    while (seen := (own != NONE).any(-1)).sum() > 2:
        xyz = evidence.triangulate(own[None, None]).xyz[0, 0]
        pixel, depth = (each[0] for each in rig.project(xyz[None]))
        xy = evidence.xy[0, np.arange(len(own))[:, None], own, np.arange(own.shape[1])]
        number = (own != NONE).sum(0)
        # There are 2 n coordinates, and the point has three degrees of freedom.
        freedom = np.sqrt(2 * number / np.maximum(2 * number - 3, 1))
        off = np.where(own == NONE, np.nan, np.linalg.norm(pixel - xy, axis=-1) * depth / rig.focal[:, None] * freedom)
        off = np.where(np.isnan(off) & (own != NONE) & (number > 1), np.inf, off)
        sigma = np.hypot(noise.usual_m, noise.calibration_px[:, None] * depth / rig.focal[:, None])
        off = median_over_frames((off / sigma).T)
        worst = np.where(seen, np.nan_to_num(off, nan=np.inf), -1).argmax()
        if off[worst] <= _FITTING:
            break
        own[worst] = NONE


_LEAST_RADIUS = 0.02  # m; smallest assumed residual of views that agree, even if the residual is smaller
_DISAGREEMENT = 0.25  # m; residual of a joint on which views do not agree
_SHARES = np.array([0.5, 0.8])  # Shares of the joints whose residuals are judged
_PAIRS = np.array([0.38, 0.76])
"""m; R for each share: figures of two views agree within a residual r by chance with probability (r / R)^2."""
_SHAPES = np.array([[3.0, 0.0], [4800.0, 4.0]])
"""c and d, r in m, for each share: a third figure that is within 2 r of the place of two others agrees with them in its
shape with probability c r^d; more than 1 as figures agree from farther away."""


@compiled()
def expected_by_chance(projections, focal, size, xy, assigned, xyz, used, figures, strangers, most):
    """Return (P,) the number of people expected by chance whose views agree as well; inf where no two views agree.

    Figures of two views that have nothing to do with each other agree within r with probability q = (r / R)^2: rays of
    most joints meet if the figures have the same size and height above the floor there. A figure of a third view also
    has to be at this place, and to have this shape. Assume that figures are spread over the floor at random, and that a
    view overlooks the area z_v^2 width_v / focal_v at the person's depth z_v. A third figure then agrees with
    probability p_v = s pi (2 r)^2 / area_v, with s the probability of its shape. View v has n_v figures. The expected
    number of times that k views agree by chance is thus

        E = q e_k(n_1 p_1, ..., n_V p_V) / p^2,

    with e_k the elementary symmetric polynomial, the sum over all choices of k views, and p the mean of p_v over the
    views that agree. It is computed with r the residual that half of the joints have at most, and with r that of four
    fifths of them, where s is small; and of the k views with the smallest residuals, for each k: a view in which half
    of the joints are elsewhere, for example with left and right exchanged, says nothing against the others. The
    smallest E counts. This is the a contrario rule of Desolneux, Moisan & Morel (IJCV 2000). Probabilities were
    measured on figures of random poses, directions, sizes and places, in the images and on the floor.

    People with more views are tested first; among people with equally many views, those with smaller residuals. The
    first is supported if E is at most `most`. The figures of supported people are explained, so they do not count for
    later ones; and if a share of all figures is explained by m people, so may be the others, for each of whom E may be
    `most`: it is divided by 1 + share * m. Of the figures that are left, no more than `strangers` count, if other
    frames tell how many figures belong to nobody.

    Args:
        projections: (V, 3, 4) pinhole projection matrices.
        focal: (V,) px.
        size: (V, 2) width and height of the image, px.
        xy: (V, D, J, 2) px.
        assigned: (P, V, J) detections of the joints, negative where none.
        xyz: (P, J, 3) m, NaN where absent.
        used: (P, J, V) True for the views that a joint was triangulated from.
        figures: (V,) numbers of figures, float. The figures of supported people are subtracted from them.
        strangers: (V,) usual numbers of figures that are of nobody whom another view shows; inf if not known.
        most: Largest E of supported people.
    """
    persons, views, _ = assigned.shape
    expected = np.full(persons, np.inf)
    depth, agrees = np.zeros((persons, views)), np.zeros((persons, views), np.bool_)
    squares, key = np.zeros((persons, len(_SHARES), views)), np.zeros(persons)
    polynomial, order, best = np.zeros(views + 1), np.zeros(persons, np.int64), np.zeros(views, np.int64)
    for p in range(persons):
        _measure(projections, focal, xy, assigned[p], xyz[p], used[p], depth[p], agrees[p], squares[p])
        for v in range(views):
            if agrees[p, v]:
                key[p] += min(squares[p, 0, v], 1.0) / views - 1
    _ascending(key, order)
    found, explained = 0, 0.0
    for rank in range(persons):
        p, count, total, least = order[rank], 0, 0.0, np.inf
        for v in range(views):
            count += agrees[p, v]
            total += max(figures[v], 0.0)
        if count < 2:
            continue
        for share in range(len(_SHARES)):
            _ascending(squares[p, share], best)
            square = squares[p, share, best[0]]
            for n in range(2, count + 1):
                square += squares[p, share, best[n - 1]]
                radius2 = max(square / n, _LEAST_RADIUS**2)
                shape, place = _SHAPES[share, 0] * np.sqrt(radius2) ** _SHAPES[share, 1], 0.0
                for k in range(views + 1):
                    polynomial[k] = 1.0 if k == 0 else 0.0
                for i in range(views):
                    v, near = best[i], 0.0
                    if depth[p, v] > 0:
                        near = min(1.0, shape * 4 * np.pi * radius2 * focal[v] / (size[v, 0] * depth[p, v] ** 2))
                    if i < n:
                        place += near / n
                    for k in range(i + 1, 0, -1):
                        polynomial[k] += polynomial[k - 1] * min(max(figures[v], 0.0), strangers[v]) * near
                pairs = min(1.0, radius2 / _PAIRS[share] ** 2)
                if place > 0:
                    least = min(least, polynomial[n] * pairs / place**2)
        known = explained / max(explained + total, 1.0)
        expected[p] = least / (1 + known * found)
        if expected[p] <= most:
            found, explained = found + 1, explained + count
            for v in range(views):
                figures[v] -= agrees[p, v]
    return expected


@compiled()
def _measure(projections, focal, xy, assigned, xyz, used, depth, agrees, of_views):
    """Write the depth of a person in each view, m, the views that agree, and to `of_views` (shares, V) the squared
    residual, m^2, that each of `_SHARES` of the joints in a view has at most; inf in views that do not agree.

    A view shows the detection with most joints there. It agrees if three joints or more, and half of those that it and
    another view detect, were triangulated from that detection.
    """
    views, joints = assigned.shape
    middle, known = np.zeros(3), 0
    for j in range(joints):
        if not np.isnan(xyz[j, 0]):
            known += 1
            for k in range(3):
                middle[k] += xyz[j, k]
    figure, counts, detected = np.zeros(views, np.int64), np.zeros(joints, np.int64), np.zeros(joints, np.int64)
    for v in range(views):
        for j in range(joints):
            detected[j] += assigned[v, j] >= 0
    for v in range(views):
        figure[v], most = -1, 0
        for j in range(joints):
            same = 0
            for other in range(joints):
                same += assigned[v, other] == assigned[v, j]
            if assigned[v, j] >= 0 and same > most:
                figure[v], most = assigned[v, j], same
        shown, fitted = 0, 0
        for j in range(joints):
            if figure[v] >= 0 and assigned[v, j] == figure[v] and detected[j] > 1:
                shown += 1
                fitted += used[j, v] and not np.isnan(xyz[j, 0])
        agrees[v] = fitted >= 3 and 2 * fitted >= shown
        if known:
            P = projections[v, 2]
            depth[v] = (P[0] * middle[0] + P[1] * middle[1] + P[2] * middle[2]) / known + P[3]
        if agrees[v]:
            for j in range(joints):
                counts[j] += assigned[v, j] == figure[v]
    squares, order = np.empty(joints), np.empty(joints, np.int64)
    for v in range(views):
        number = 0
        for j in range(joints):
            squares[j] = np.inf
        for j in range(joints):
            d = figure[v]
            if not agrees[v] or assigned[v, j] != d or counts[j] < 2:
                continue
            square = np.inf
            x, y, z = project(projections[v], xyz[j])
            if z > 0:
                dx, dy = x - xy[v, d, j, 0], y - xy[v, d, j, 1]
                # There are 2 n coordinates, and the point has three degrees of freedom.
                square = counts[j] / (2 * counts[j] - 3) * (dx * dx + dy * dy) * (z / focal[v]) ** 2
            squares[number] = min(square, _DISAGREEMENT**2)
            number += 1
        _ascending(squares, order)
        for share in range(len(_SHARES)):
            of_views[share, v] = squares[order[min(int(_SHARES[share] * number), number - 1)]] if number else np.inf


@compiled()
def _ascending(values, order):
    """Write the order of a few values to `order`; the sorting of numpy takes seconds to compile."""
    for i in range(len(values)):
        place = i
        while place > 0 and values[order[place - 1]] > values[i]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = i
