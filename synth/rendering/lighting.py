"""Soft shadows and ambient occlusion in images that OpenGL lights, from depth as seen by the camera and by the lamp."""

from typing import NamedTuple

import numpy as np

from dmae.numerics.compiled import compiled

SUN = 0.00465
"""Angular radius of the sun, rad."""
_TALL = 2.5
"""Distance from a surface within which something may throw a penumbra on it, m."""
_TAPS, _DIRECTIONS, _STEPS = 10, 2, 3
"""For each pixel, numbers of places in the shadow map, horizon directions, and steps in each direction."""
_STEEP = 2.5
"""Greatest tangent of the angle between the axis of a lamp and light that throws shadows."""


class ShadowMap(NamedTuple):
    """What a lamp sees."""

    axes: np.ndarray  # (3, 3) rows: right, down and forward axis of the lamp, in the frame of the camera
    origin: np.ndarray  # (3,) place of the lamp or, for the sun, of the map's plane, in the frame of the camera, m
    size: float  # Radius of the lamp, m; of the sun, rad
    parallel: bool  # Whether this is the sun, whose rays are parallel
    corner: np.ndarray  # (2,) right and down of the first pixel: m for the sun, tangents for a lamp
    step: np.ndarray  # (2,) the same, from pixel to pixel
    depth: np.ndarray  # (M, M) float32 distance along the forward axis of the nearest surface, m


def covered(points: np.ndarray, axes: np.ndarray, origin: np.ndarray, parallel: bool) -> np.ndarray | None:
    """Return least and greatest right and down, (2, 2), of points (N, 3) as a lamp sees them; None if it sees none."""
    seen = (points - origin) @ axes.T
    flat = seen[:, :2] if parallel else (seen[:, :2] / np.maximum(seen[:, 2:], 1e-6))[seen[:, 2] > 0.05]
    if not len(flat):
        return None
    limits = np.stack([flat.min(0), flat.max(0)])
    if not parallel:
        limits = np.clip(limits, -_STEEP, _STEEP)
    margin = 0.02 * (limits[1] - limits[0]) + 1e-3
    return limits + np.stack([-margin, margin])


def _patterns() -> tuple[np.ndarray, np.ndarray]:
    """Return places in a unit disc, (16, taps, 2), and steps of horizons, (16, directions, steps, 2), turned for 4 x 4
    pixels."""
    turn = (np.arange(16) * 7 % 16 + 0.5)[:, None] / 16
    tap = np.arange(_TAPS)
    angle, away = 2.3999632 * tap + 2 * np.pi * turn, np.sqrt((tap + 0.5) / _TAPS)
    disc = away[..., None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    angle = 2 * np.pi * (np.arange(_DIRECTIONS) + turn) / _DIRECTIONS
    away = ((np.arange(_STEPS) + 0.3 + 0.7 * turn) / _STEPS) ** 2
    steps = away[:, None, :, None] * np.stack([np.cos(angle), np.sin(angle)], -1)[:, :, None]
    return disc.astype(np.float32), steps.astype(np.float32)


_DISC, _RAYS = _patterns()


@compiled()
def smoothed(share, depth):
    """Return the mean of shares (H, W) over 4 x 4 pixels of the same surface."""
    height, width = share.shape
    mean = share.copy()
    for row in range(height):
        for column in range(width):
            z = depth[row, column]
            if not z > 0:
                continue
            total, count = 0.0, 0
            for r in range(max(row - 2, 0), min(row + 2, height)):
                for c in range(max(column - 2, 0), min(column + 2, width)):
                    if abs(depth[r, c] - z) < 0.03 * z:
                        total += share[r, c]
                        count += 1
            mean[row, column] = total / count
    return mean


@compiled()
def light_reaching(depth, K, facing, key, other, lamp, radius):
    """Return the share of its light that reaches each pixel, (H, W) float32.

    Soft shadows follow Fernando, "Percentage-closer soft shadows" (SIGGRAPH 2005 sketches): the mean distance of
    what hides the middle of the lamp gives the width of the penumbra, in which the map is then averaged. Ambient
    occlusion is horizon based (Bavoil and Sainz, "Image-space horizon-based ambient occlusion", SIGGRAPH 2008 talks).
    The share of a cosine-weighted hemisphere below a horizon of elevation a is sin(a)^2. Directions are even in the
    image, not around the normal: slanting surfaces lose somewhat less light in corners than they should.

    First every other pixel of every other row. What is between them on one surface is interpolated, but for the edges
    of shadows.

    Args:
        depth: (H, W) float32 m along the optical axis; NaN where there is no surface.
        K: (3, 3) the pinhole camera.
        facing: (H, W) uint8, 255 times the cosine between a surface and the lamp; 0 where it faces away.
        key: Strength of the lamp.
        other: (H, W) uint8, 255 times the light of all others.
        lamp: What the lamp sees; a map of no pixels for no shadows.
        radius: Range of ambient occlusion, m; 0 for none.
    """
    coarse = depth[::2, ::2].copy()
    sun, sky = _coarse_shares(depth, K, facing, lamp, radius)
    sky, edge = smoothed(sky, coarse), _edges_of_shadows(sun, coarse)
    share = np.ones(depth.shape, np.float32)
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            z = depth[row, column]
            direct, ambient = key * facing[row, column], float(other[row, column])
            if not z > 0 or direct + ambient <= 0:
                continue
            sunlit, near_edge, open_sky, count = 1.0, False, 0.0, 0
            for r in range(row >> 1, min((row + 1 >> 1) + 1, coarse.shape[0])):
                for c in range(column >> 1, min((column + 1 >> 1) + 1, coarse.shape[1])):
                    if abs(coarse[r, c] - z) < 0.02 * z:
                        sunlit = min(sunlit, sun[r, c])
                        near_edge |= edge[r, c]
                        open_sky += sky[r, c]
                        count += 1
            if count == 0 or sunlit < 0 or near_edge:
                sunlit = 1.0
                if len(lamp.depth) and facing[row, column] > 0:
                    sunlit = _lit(depth, K, facing, row, column, _DISC[_pattern(row, column)], lamp)
            if count == 0:
                open_sky = _open(depth, K, row, column, _RAYS[_pattern(row, column)], radius) if radius > 0 else 1.0
            share[row, column] = (direct * sunlit + ambient * open_sky / max(count, 1)) / (direct + ambient)
    return share


@compiled()
def _pattern(row, column):
    """Return the number of a pixel's pattern in `_DISC` and `_RAYS`."""
    return 4 * (row & 3) + (column & 3)


@compiled()
def _coarse_shares(depth, K, facing, lamp, radius):
    """Return the shares of the lamp and of ambient light at every other pixel of every other row, float32.

    The lamp's is -1 where there are no shadows to compute, or no surface.
    """
    rows, columns = depth[::2, ::2].shape
    sun, sky = np.full((rows, columns), np.float32(-1)), np.ones((rows, columns), np.float32)
    for r in range(rows):
        for c in range(columns):
            if not depth[2 * r, 2 * c] > 0:
                continue
            if len(lamp.depth) and facing[2 * r, 2 * c] > 0:
                sun[r, c] = _lit(depth, K, facing, 2 * r, 2 * c, _DISC[_pattern(r, c)], lamp)
            if radius > 0:
                sky[r, c] = _open(depth, K, 2 * r, 2 * c, _RAYS[_pattern(r, c)], radius)
    return sun, sky


@compiled()
def _edges_of_shadows(sun, depth):
    """Return where each pixel has to be computed, from shares of the lamp and depths, all on the coarse grid.

    Patterns differ from pixel to pixel. Where one of them meets the edge of a shadow, all pixels around are computed:
    if only those were that meet it, the penumbra would be a screen of dots.
    """
    rows, columns = sun.shape
    edge = np.zeros((rows, columns), np.bool_)
    for r in range(rows):
        for c in range(columns):
            here, z = sun[r, c], depth[r, c]
            if here < 0 or (here in (0, 1) and _alike(sun, depth, r, c)):
                continue
            for y in range(max(r - 2, 0), min(r + 3, rows)):
                for x in range(max(c - 2, 0), min(c + 3, columns)):
                    if abs(depth[y, x] - z) < 0.03 * z:
                        edge[y, x] = True
    return edge


@compiled()
def _alike(sun, depth, row, column):
    """Return whether the pixels right of one and below it, if on the same surface, see the same share of the lamp."""
    height, width = sun.shape
    here, z = sun[row, column], depth[row, column]
    for r, c in ((row, min(column + 1, width - 1)), (min(row + 1, height - 1), column)):
        if sun[r, c] >= 0 and sun[r, c] != here and abs(depth[r, c] - z) < 0.03 * z:
            return False
    return True


@compiled()
def _point(depth, K, row, column):
    """Return the place of the surface in a pixel, m, in the frame of the camera."""
    z = depth[row, column]
    return (column - K[0, 2]) / K[0, 0] * z, (row - K[1, 2]) / K[1, 1] * z, z


@compiled()
def _lit(depth, K, facing, row, column, disc, lamp):
    """Return the share of a lamp that a pixel which faces it sees: 0 to 1.

    Args:
        depth, K, facing: As for `light_reaching`.
        disc: (taps, 2) places in a unit disc where the lamp's map is read.
        lamp: What the lamp sees.
    """
    axes, size, shadows = lamp.axes, lamp.size, lamp.depth
    x, y, z = _point(depth, K, row, column)
    x, y, z = x - lamp.origin[0], y - lamp.origin[1], z - lamp.origin[2]
    cosine = facing[row, column] / 255.0
    right = axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z
    down = axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z
    ahead = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
    scale = 1.0
    if lamp.parallel:
        widest = size * _TALL
    else:
        if ahead < 0.05:
            return 1.0
        scale = ahead
        right, down = right / ahead, down / ahead
        widest = size * (1 / max(ahead - _TALL, 0.3 * ahead) - 1 / ahead)
    texel = max(lamp.step[0], lamp.step[1])
    # A surface that is seen at a slant comes nearer to the lamp within the width of the filter.
    slant = min(np.sqrt(max(1 - cosine * cosine, 0.0)) / max(cosine, 0.05), 8.0)
    right, down = (right - lamp.corner[0]) / lamp.step[0] + 0.5, (down - lamp.corner[1]) / lamp.step[1] + 0.5
    nearer, blocked = 0.0, 0
    for search in range(2):
        wide = max(widest, 1.5 * texel)
        if search:
            between = nearer / blocked
            wide = size * (ahead - between) if lamp.parallel else size * (1 / between - 1 / ahead)
            wide = max(wide, 1.5 * texel)
        blocked, nearer = 0, 0.0
        across, along = wide / lamp.step[0], wide / lamp.step[1]
        nearest = ahead - 0.01 - slant * scale * (0.7 * wide + 0.5 * texel)
        for tap in range(_TAPS):
            c = int(right + across * disc[tap, 0])
            r = int(down + along * disc[tap, 1])
            if 0 <= r < len(shadows) and 0 <= c < len(shadows):
                found = shadows[r, c]
                if found < nearest:
                    blocked += 1
                    nearer += found
        if blocked == 0:
            return 1.0
    return 1 - blocked / _TAPS


@compiled()
def _open(depth, K, row, column, rays, radius):
    """Return the share of ambient light that nearby surfaces do not keep from a pixel: 0 to 1.

    Args:
        depth, K: As for `light_reaching`.
        rays: (directions, steps, 2) where horizons are looked for, in shares of the range.
        radius: Range, m.
    """
    height, width = depth.shape
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    x, y, z = _point(depth, K, row, column)
    if row == 0 or column == 0 or row == height - 1 or column == width - 1:
        return 1.0
    # The normal, from the nearer neighbour on each axis: the farther one may be on another surface.
    before, after = depth[row, column - 1], depth[row, column + 1]
    above, below = depth[row - 1, column], depth[row + 1, column]
    if not (before > 0 and after > 0 and above > 0 and below > 0):
        return 1.0
    across = after - z if abs(after - z) < abs(before - z) else z - before
    along = below - z if abs(below - z) < abs(above - z) else z - above
    # The tangent to the right is ((u + 1) (z + across) - u z) / fx = (z + (u + 1) across) / fx, with u = column - cx;
    # u + 1 is taken as u.
    ax, ay, az = (z + (column - cx) * across) / fx, (row - cy) / fy * across, across
    bx, by, bz = (column - cx) / fx * along, (z + (row - cy) * along) / fy, along
    nx, ny, nz = by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    if length <= 0:
        return 1.0
    nx, ny, nz = nx / length, ny / length, nz / length
    reach = min(radius * fx / z, 0.25 * width)
    if reach < 2:
        return 1.0
    hidden = 0.0
    for direction in range(_DIRECTIONS):
        highest = 0.0
        for number in range(_STEPS):
            c = int(column + reach * rays[direction, number, 0] + 0.5)
            r = int(row + reach * rays[direction, number, 1] + 0.5)
            if not (0 <= r < height and 0 <= c < width):
                break
            other = depth[r, c]
            if not other > 0:
                continue
            vx, vy, vz = (c - cx) / fx * other - x, (r - cy) / fy * other - y, other - z
            square = vx * vx + vy * vy + vz * vz
            if square < radius * radius:
                rise = vx * nx + vy * ny + vz * nz - 0.002 * z
                if rise > 0:
                    highest = max(highest, rise * rise / square * (1 - square / (radius * radius)))
        hidden += highest
    return 1 - hidden / _DIRECTIONS
