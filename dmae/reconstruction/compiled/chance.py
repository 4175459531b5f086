"""Test whether people are a coincidence: the agreement of views, compared with the number of figures that they show."""

import numpy as np

from dmae.numerics.compiled import compiled

_LEAST_RADIUS = 0.02
"""m; smallest assumed residual of views that agree, even if the residual is smaller."""
_DISAGREEMENT = 0.25
"""m; residual of a joint on which views do not agree."""


@compiled()
def beyond_chance(projections, focal, width, xy, assigned, xyz, used, figures, most, supported):
    """Find the people with views that agree better than unrelated figures would.

    Assume that the n_v figures of each view are spread over the floor at random, and that a view overlooks the area
    z_v^2 width_v / focal_v at the person's depth z_v. A figure is then within 2 r of a given place with probability
    p_v = pi (2 r)^2 / area_v, and any figure of the view with probability a_v = 1 - exp(-n_v p_v). There are 1 / p
    of these places. The number of places at which k of the views agree within 2 r by chance is thus

        E = e_k(a_1, ..., a_V) / p,

    with e_k the elementary symmetric polynomial, the sum over all choices of k views. A person of k views with median
    residual r is supported if E is at most `most`. This is the a contrario rule of Desolneux, Moisan & Morel (IJCV
    2000). The figures of supported people are explained, so they do not count for later people. People with more views
    are tested first; among people with equally many views, those with smaller residuals.

    Args:
        projections: (V, 3, 4) pinhole projection matrices.
        focal: (V,) px.
        width: (V,) px of the image.
        xy: (V, D, J, 2) px.
        assigned: (P, V, J) detections of the joints, negative where none.
        xyz: (P, J, 3) m, NaN where absent.
        used: (P, J, V) True for the views that a joint was triangulated from.
        figures: (V,) numbers of figures, float; those of supported people are subtracted.
        most: Largest E.
        supported: (P,) bool, written.
    """
    persons, views, _ = assigned.shape
    depth, agrees = np.zeros((persons, views)), np.zeros((persons, views), np.bool_)
    radius2, key = np.zeros(persons), np.zeros(persons)
    chance, polynomial = np.zeros(views), np.zeros(views + 1)
    for p in range(persons):
        radius2[p] = _measure(projections, focal, xy, assigned[p], xyz[p], used[p], depth[p], agrees[p])
        key[p] = radius2[p] - agrees[p].sum()
    for p in np.argsort(key):
        supported[p] = False
        count = agrees[p].sum()
        if count < 2:
            continue
        polynomial[0], cell = 1.0, 0.0
        for v in range(views):
            near = 0.0
            if depth[p, v] > 0:
                near = min(1.0, 4 * np.pi * radius2[p] * focal[v] / (width[v] * depth[p, v] ** 2))
            if agrees[p, v]:
                cell += near / count
            chance[v] = 1 - np.exp(-max(figures[v], 0.0) * near)
        for k in range(1, views + 1):
            polynomial[k] = 0.0
        for v in range(views):
            for k in range(v + 1, 0, -1):
                polynomial[k] += polynomial[k - 1] * chance[v]
        if polynomial[count] <= most * cell:
            supported[p] = True
            for v in range(views):
                figures[v] -= agrees[p, v]


@compiled()
def _measure(projections, focal, xy, assigned, xyz, used, depth, agrees):
    """Return the median squared residual of a person, m^2; write its depth in each view, m, and the views that agree.

    A view agrees if three joints or more, and half of those that it and another view detect, were triangulated from it.
    """
    views, joints = assigned.shape
    middle, known = np.zeros(3), 0
    squares = np.full(joints, _DISAGREEMENT**2)
    counts, detected = np.zeros(joints, np.int64), 0
    for j in range(joints):
        total = 0.0
        for v in range(views):
            counts[j] += assigned[v, j] >= 0
        if counts[j] < 2:
            continue
        detected += 1
        if np.isnan(xyz[j, 0]):
            squares[detected - 1] = _DISAGREEMENT**2
            continue
        known += 1
        for k in range(3):
            middle[k] += xyz[j, k]
        for v in range(views):
            d = assigned[v, j]
            if d < 0:
                continue
            P = projections[v]
            z = P[2, 0] * xyz[j, 0] + P[2, 1] * xyz[j, 1] + P[2, 2] * xyz[j, 2] + P[2, 3]
            if z <= 0:
                total += _DISAGREEMENT**2
                continue
            x = (P[0, 0] * xyz[j, 0] + P[0, 1] * xyz[j, 1] + P[0, 2] * xyz[j, 2] + P[0, 3]) / z - xy[v, d, j, 0]
            y = (P[1, 0] * xyz[j, 0] + P[1, 1] * xyz[j, 1] + P[1, 2] * xyz[j, 2] + P[1, 3]) / z - xy[v, d, j, 1]
            total += min((x * x + y * y) * (z / focal[v]) ** 2, _DISAGREEMENT**2)
        # There are 2 n coordinates, and the point has three degrees of freedom.
        squares[detected - 1] = min(total / (2 * counts[j] - 3), _DISAGREEMENT**2)
    for v in range(views):
        shown, fitted = 0, 0
        for j in range(joints):
            if assigned[v, j] >= 0 and counts[j] > 1:
                shown += 1
                fitted += used[j, v] and not np.isnan(xyz[j, 0])
        agrees[v] = fitted >= 3 and 2 * fitted >= shown
        if known:
            P = projections[v, 2]
            depth[v] = (P[0] * middle[0] + P[1] * middle[1] + P[2] * middle[2]) / known + P[3]
    if not detected:
        return _DISAGREEMENT**2
    ordered = np.sort(squares[:detected])
    return max(ordered[detected // 2], _LEAST_RADIUS**2)
