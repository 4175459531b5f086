"""Affinities of detections of different views, and the groups that they form, compiled."""

import numpy as np

from dmae.numerics.compiled import compiled

_PARALLEL = np.float32(1e-8)
"""Squared sine of an angle; lines at smaller ones are parallel."""


@compiled(fastmath=True)
def affinity(base, rays_a, weights_a, rays_b, weights_b, half_distance):
    """Return the affinity of two detections in [0, 1]:

        sum_j w_j / (1 + (d_j / half_distance)^2) / (1 + sum_j w_j),

    where d_j is the distance between the rays of joint j in front of their cameras, and w_j the product of their
    weights. The 1 in the denominator keeps the affinity low for pairs that share little evidence.

    Args:
        base: (3,) from the camera of a to that of b, m.
        rays_a: (3, J) unit directions; any where the joint is absent.
        weights_a: (J,) root of the confidence; 0 where the joint is absent.
        rays_b: (3, J) as `rays_a`.
        weights_b: (J,) as `weights_a`.
        half_distance: m, at which a joint counts half.

    Returns:
        The affinity; -1 where no joint is shared.
    """
    one = np.float32(1)
    square = base[0] * base[0] + base[1] * base[1] + base[2] * base[2]
    scale = one / (half_distance * half_distance)
    total, near = np.float32(0), np.float32(0)
    for j in range(weights_a.shape[0]):
        ax, ay, az = rays_a[0, j], rays_a[1, j], rays_a[2, j]
        bx, by, bz = rays_b[0, j], rays_b[1, j], rays_b[2, j]
        weight = weights_a[j] * weights_b[j]
        cosine = ax * bx + ay * by + az * bz
        base_a = ax * base[0] + ay * base[1] + az * base[2]
        base_b = bx * base[0] + by * base[1] + bz * base[2]
        cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
        sine2 = cx * cx + cy * cy + cz * cz
        volume = cx * base[0] + cy * base[1] + cz * base[2]
        # Either the lines are closest in front of both cameras, or one of the rays is closest at its start.
        ahead = (sine2 > _PARALLEL) & (base_a >= cosine * base_b) & (cosine * base_a >= base_b)
        back_a, back_b = max(base_a, np.float32(0)), min(base_b, np.float32(0))
        at_start = max(square - max(back_a * back_a, back_b * back_b), np.float32(0))
        distance2 = volume * volume / max(sine2, _PARALLEL) if ahead else at_start
        total += weight
        near += weight / (one + distance2 * scale)
    return near / (one + total) if total > 0 else np.float32(-1)


@compiled()
def blended_affinity(i, j, view, centers, rays, weights, colours, half_distance, colour_difference, colour_weight):
    """Return the affinity of detections i and j by rays and clothes; -1 where they share no joint.

    Args:
        view: (n,) view of each detection.
        centers: (V, 3) m, float32, as all that follow.
        rays: (n, 3, J) unit directions.
        weights: (n, J) roots of confidences, 0 where a joint is absent.
        colours: (n, 3) CIELAB; NaN where unknown.
        half_distance: m.
        colour_difference: Difference of colours that counts half.
        colour_weight: Weight of colours, 0 to 1.
    """
    base = np.empty(3, np.float32)
    for k in range(3):
        base[k] = centers[view[j], k] - centers[view[i], k]
    found = affinity(base, rays[i], weights[i], rays[j], weights[j], half_distance)
    square = np.float32(0)
    for k in range(3):
        square += (colours[i, k] - colours[j, k]) ** 2
    if found < 0 or np.isnan(square):
        return found
    similarity = np.float32(1) / (np.float32(1) + square / colour_difference**2)
    return found + colour_weight * (similarity - found)


@compiled()
def find_partners(
    view, centers, rays, weights, colours, half_distance, colour_difference, colour_weight, least, partners, affinities
):
    """Write the best partners of each detection in each other view.

    Args:
        view: As for `blended_affinity`, ascending; so are the arguments that follow.
        least: Smallest affinity of partners.
        partners: (n, V, C) filled with -1; indices of partners, the best first.
        affinities: (n, V, C) filled with 0; their affinities.
    """
    for i in range(len(view)):
        for j in range(i + 1, len(view)):
            if view[j] == view[i]:
                continue
            found = blended_affinity(
                i, j, view, centers, rays, weights, colours, half_distance, colour_difference, colour_weight
            )
            if found >= least:
                _insert(partners[i, view[j]], affinities[i, view[j]], j, found)
                _insert(partners[j, view[i]], affinities[j, view[i]], i, found)


@compiled()
def _insert(partners, affinities, partner, found):
    """Insert a partner into lists that are sorted by affinity; the last one is dropped."""
    place = len(partners)
    while place > 0 and (partners[place - 1] < 0 or affinities[place - 1] < found):
        place -= 1
    if place == len(partners):
        return
    for k in range(len(partners) - 1, place, -1):
        partners[k], affinities[k] = partners[k - 1], affinities[k - 1]
    partners[place], affinities[place] = partner, found


@compiled()
def supports(first, second, found, view, partners, affinities):
    """Return the support of pairs of partners (m,).

    It is the affinity of the pair plus, in each other view, that of the detection which fits both.

    Args:
        first: (m,) detections.
        second: (m,) their partners.
        found: (m,) affinities.
        view: (n,) view of each detection.
        partners: (n, V, C) as `find_partners` writes them.
        affinities: (n, V, C)
    """
    support = found.copy()
    for pair in range(len(first)):
        i, j = first[pair], second[pair]
        for third in range(partners.shape[1]):
            if third == view[i] or third == view[j]:
                continue
            best = np.float32(0)
            for k in range(partners.shape[2]):
                if partners[i, third, k] < 0 or affinities[i, third, k] <= best:
                    break
                for m in range(partners.shape[2]):
                    if partners[j, third, m] < 0 or affinities[j, third, m] <= best:
                        break
                    if partners[j, third, m] == partners[i, third, k]:
                        best = min(affinities[i, third, k], affinities[j, third, m])
            support[pair] += best
    return support


@compiled()
def join(
    first,
    second,
    view,
    centers,
    rays,
    weights,
    colours,
    half_distance,
    colour_difference,
    colour_weight,
    least,
    members,
):
    """Join groups along pairs, in the order given, where their members agree on average.

    Args:
        first: (m,) detections.
        second: (m,) their partners.
        view: As for `blended_affinity`; so are the arguments that follow.
        least: Smallest mean affinity between the members of two groups that are joined.
        members: (n, V) filled with -1; each row the detections of a group by view, or of none.
    """
    group = np.arange(len(view))
    for i in range(len(view)):
        members[i, view[i]] = i
    for pair in range(len(first)):
        a, b = group[first[pair]], group[second[pair]]
        if a == b:
            continue
        overlap = False
        for v in range(members.shape[1]):
            overlap |= members[a, v] >= 0 and members[b, v] >= 0
        if overlap:
            continue
        total, count = 0.0, 0
        for u in range(members.shape[1]):
            for v in range(members.shape[1]):
                i, j = members[a, u], members[b, v]
                if i >= 0 and j >= 0:
                    found = blended_affinity(
                        i, j, view, centers, rays, weights, colours, half_distance, colour_difference, colour_weight
                    )
                    if found >= 0:
                        total += found
                        count += 1
        if count and total / count >= least:
            for v in range(members.shape[1]):
                if members[b, v] >= 0:
                    group[members[b, v]] = a
                    members[a, v] = members[b, v]
                    members[b, v] = -1
