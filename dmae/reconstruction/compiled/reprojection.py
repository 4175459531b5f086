"""Distances between reprojections of people and detections, and decisions based on them, compiled."""

import numpy as np

from dmae.numerics.compiled import compiled


@compiled()
def project(projection, point):
    """Return x and y, px, and depth, m, of a point; NaN for points that are NaN or not in front of the camera."""
    x, y, depth = projection[0, 3], projection[1, 3], projection[2, 3]
    for k in range(3):
        x += projection[0, k] * point[k]
        y += projection[1, k] * point[k]
        depth += projection[2, k] * point[k]
    if not depth > 0:
        return np.nan, np.nan, depth
    return x / depth, y / depth, depth


@compiled()
def measure_distances(projections, focal, scale, xy, xyz, distances):
    """Write distances from reprojections of people to detections.

    Args:
        projections: (V, 3, 4) pinhole projection matrices.
        focal: (V,) px.
        scale: (V,) by which pixels are multiplied; NaN for metres at the depth of the person.
        xy: (F, V, D, J, 2) px; NaN where absent.
        xyz: (F, P, J, 3) m; NaN where unknown.
        distances: (F, V, P, D, J), written; NaN where either is absent.
    """
    frames, views, persons, detections, joints = distances.shape
    for f in range(frames):
        for v in range(views):
            for p in range(persons):
                for j in range(joints):
                    x, y, depth = project(projections[v], xyz[f, p, j])
                    size = depth / focal[v] if np.isnan(scale[v]) else scale[v]
                    for d in range(detections):
                        dx, dy = x - xy[f, v, d, j, 0], y - xy[f, v, d, j, 1]
                        distances[f, v, p, d, j] = np.sqrt(dx * dx + dy * dy) * size


@compiled()
def measure_pairs(projections, focal, xy, xyz, detection, pairs, distance, exchanged):
    """Write distances of detected pairs from where they are expected, and from where their partners are, in metres.

    Args:
        projections: (V, 3, 4) pinhole projection matrices.
        focal: (V,) px.
        xy: (F, V, D, J, 2) px; NaN where absent.
        xyz: (F, P, J, 3) m; NaN where unknown.
        detection: (F, P, V, n) index of the detection of each pair; negative for none.
        pairs: (n, 2) indices of the left and the right joint.
        distance, exchanged: (F, P, V, n, 2), written; NaN where either is absent.
    """
    frames, persons, views, count = detection.shape
    for f in range(frames):
        for p in range(persons):
            for v in range(views):
                for n in range(count):
                    d = detection[f, p, v, n]
                    for side in range(2):
                        x, y, depth = project(projections[v], xyz[f, p, pairs[n, side]])
                        # The positions of the left and of the right joint are each compared with both detected joints.
                        for shown in range(2):
                            found = np.nan
                            if d >= 0:
                                dx, dy = x - xy[f, v, d, pairs[n, shown], 0], y - xy[f, v, d, pairs[n, shown], 1]
                                found = np.sqrt(dx * dx + dy * dy) * depth / focal[v]
                            if side == shown:
                                distance[f, p, v, n, shown] = found
                            else:
                                exchanged[f, p, v, n, shown] = found


@compiled()
def nearest_detections(projections, focal, xy, paths, most, assigned):
    """Write, for joints with a path, the nearest detection that is not nearer to another person, or -1.

    Args:
        projections: (V, 3, 4) pinhole projection matrices.
        focal: (V,) px.
        xy: (F, V, D, J, 2) px; NaN where absent.
        paths: (F, P, J, 3) m; NaN where a joint has no path; its assignment then does not change.
        most: m, upper limit of the distance of a detection from the path.
        assigned: (F, P, V, J), written.
    """
    frames, persons, views, joints = assigned.shape
    detections = xy.shape[2]
    nearest, least = np.empty(persons, np.int64), np.empty(persons)
    owner, closest = np.empty(detections, np.int64), np.empty(detections)
    for f in range(frames):
        for v in range(views):
            for j in range(joints):
                nearest[:], least[:], owner[:], closest[:] = -1, most, -1, most
                for p in range(persons):
                    x, y, depth = project(projections[v], paths[f, p, j])
                    if np.isnan(x):
                        continue
                    for d in range(detections):
                        dx, dy = x - xy[f, v, d, j, 0], y - xy[f, v, d, j, 1]
                        distance = np.sqrt(dx * dx + dy * dy) * depth / focal[v]
                        if distance < least[p]:
                            least[p], nearest[p] = distance, d
                        if distance < closest[d]:
                            closest[d], owner[d] = distance, p
                for p in range(persons):
                    if not np.isnan(paths[f, p, j, 0]):
                        d = nearest[p]
                        assigned[f, p, v, j] = d if d >= 0 and owner[d] == p else -1


@compiled()
def judge_sides(distance, exchanged, pairs, groups, sigma, farthest, most, least, wrong):
    """Write True for pairs of joints that are clearly nearer to their expected places with sides exchanged.

    Args:
        distance: (m, J) m, distances of joints from their expected places.
        exchanged: (m, J) m, distances from the expected places of their partners.
        pairs: (n, 2) indices of the left and the right joint.
        groups: (G, n) True for the pairs that are exchanged together.
        sigma: m, standard deviation of the distances.
        farthest: m; larger distances count as this.
        most: m, largest mean distance of joints after the exchange.
        least: Smallest logarithm of the ratio of likelihoods for an exchange of sides.
        wrong: (m, n) bool, written.
    """
    rows, number = wrong.shape
    evidence, after, count = np.empty(number), np.empty(number), np.empty(number)
    for i in range(rows):
        for pair in range(number):
            evidence[pair], after[pair], count[pair] = 0.0, 0.0, 0.0
            for side in range(2):
                here, there = distance[i, pairs[pair, side]], exchanged[i, pairs[pair, side]]
                if not (np.isnan(here) or np.isnan(there)):
                    here, there = min(here, farthest), min(there, farthest)
                    evidence[pair] += (here * here - there * there) / (2 * sigma * sigma)
                    after[pair] += there
                    count[pair] += 1
            wrong[i, pair] = evidence[pair] > least and after[pair] <= most * count[pair]
        for group in range(len(groups)):
            total, near, joints = 0.0, 0.0, 0.0
            for pair in range(number):
                if groups[group, pair]:
                    total += evidence[pair]
                    near += after[pair]
                    joints += count[pair]
            if total > least and near <= most * joints:
                for pair in range(number):
                    wrong[i, pair] |= groups[group, pair]
        for pair in range(number):
            wrong[i, pair] &= evidence[pair] > -least and count[pair] > 0


@compiled()
def take_sides(exchanged, pairs, wrong, distance):
    """Replace distances (m, J) by exchanged ones (m, J) at the joints of pairs (n, 2) that are wrong, (m, n)."""
    for i in range(len(wrong)):
        for pair in range(len(pairs)):
            if wrong[i, pair]:
                for side in range(2):
                    distance[i, pairs[pair, side]] = exchanged[i, pairs[pair, side]]
