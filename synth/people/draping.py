"""Cloth that hangs around both legs: skirts, and coats below the waist.

Such cloth is a tube of rings. A ring has nodes all around; they are bones of their own, which vertices between them
follow as skin follows segments (`synth.people.skinning`). Where the nodes are is a function of the pose:

- The middle of a ring is the mean of two points of the left and the right leg at the same share of their lengths, and
  its orientation the mean of theirs. Around the waist, pelvis and spine take part instead.
- Cloth spans both legs: a node is at least as far out as the convex hull of two discs, the sections of the legs.
- Where the hull pushes nodes out, the other nodes of the ring come in, so that its length stays.
- Between rings, legs that are bent or far apart push cloth outwards.
- Where legs are level, as on a seat, cloth lies on them instead of standing off.
- Elsewhere cloth swings: the middles of rings are displaced as `swings` says, more towards the hem.
"""

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator
from scipy.signal import lsim
from scipy.spatial import ConvexHull

from dmae.numerics.compiled import compiled
from synth.people.body import HALF_HIP_WIDTH, SEGMENTS, Body, segment_origins
from synth.people.surface import BareBody

_OWN = tuple(SEGMENTS.index(name) for name in ("pelvis", "spine", "l_thigh", "r_thigh", "l_shin", "r_shin"))
NODES, _WAYS = 16, 48
"""Number of nodes of a ring, and of directions in which its shape is known."""
_TIGHT, _LOOSE = 0.3, 0.8
"""Cosines of a ring's angle to the horizontal at which cloth lies on the legs, and hangs freely."""
_CLOSE, _MARGIN, _SMOOTH = 0.0015, 0.012, 0.012
"""Least distance of cloth from legs that it lies on, and from others, and width of the transition to it, m."""
_THICK = 0.0015
"""Half the thickness of the cloth, m."""
_ROUND = 1.3
"""Least radius of the corners of a ring that hangs freely, in halves of the distance between the hip joints."""
_GRAVITY, _FRICTION, _WIDEST = 9.81, 0.3, 0.35
"""Acceleration of free fall, m/s^2; damping of the swing relative to the critical one; and the greatest displacement of
a hem relative to the length of the cloth."""
_SIDES = 32
"""Number of sides of the polygon that stands for the hull of legs."""
_BELOW = 0.4
"""Length of legs below the hem that cloth keeps clear of, in thighs or shins."""
_LEAST = 0.4
"""Least cosine of the angle between a leg and the axis of a ring with which its section is found."""
_NARROWEST, _TILT = 0.5, 1.2
"""Least width of the free part of a ring relative to rest, and greatest share of the legs' distance along the axis of a
ring that its nodes follow."""

_ROUNDS, _REACH = 2, 3
"""Number of times that nodes are moved out of legs, and of rings above and below from whose pieces of legs."""


class Drape(NamedTuple):
    """A tube of R rings with `NODES` nodes each, at even distances along the ring."""

    # (R + 1, 8) of each ring, and of legs where they go on below the hem: x and z of the legs' points in T-pose, and
    # half their distance, m; radius of a leg there, m, 0 if it does not push; weights of pelvis, spine, thighs, shins
    rings: np.ndarray
    # loose, tight: (R, M) distance from the middle of the ring in hanging freely, and next to the body, m
    loose: np.ndarray
    tight: np.ndarray
    ways: np.ndarray  # (M, 2) directions of these distances from the front to the left, unit vectors
    origins: np.ndarray  # (6, 3) origins of `_OWN` in T-pose, m
    under: np.ndarray  # (1,) thickness of what legs wear below, m; a seat presses it flat

    @property
    def nodes(self) -> int:
        """Number of nodes."""
        return len(self.loose) * NODES

    @property
    def closed(self) -> bool:
        """Whether the tube is closed in front."""
        return bool(self.ways[0, 1] == 0)

    @property
    def length(self) -> float:
        """Length below the hip joints, m."""
        return float(-self.rings[-2, 1])

    def bones(self, quats: np.ndarray, places: np.ndarray, swing: np.ndarray) -> np.ndarray:
        """Return (R * NODES, 3, 4) rotations and places of the nodes, ring by ring, m.

        Args:
            quats, places: (16, 4) and (16, 3) m of the segments.
            swing: (2,) displacement of the hem, m, see `swings`.
        """
        bones, own = np.empty((self.nodes, 3, 4)), list(_OWN)
        _drape(quats[own], places[own], *self, swing, self.closed, bones)
        return bones

    def at_rest(self) -> np.ndarray:
        """Return (R * NODES, 3, 4) rotation and place of the nodes in T-pose; the mid point of the hip joints is the
        origin."""
        quats, places = np.tile((1.0, 0, 0, 0), (len(SEGMENTS), 1)), np.zeros((len(SEGMENTS), 3))
        places[list(_OWN)] = self.origins
        return self.bones(quats, places, np.zeros(2))

    def pack(self) -> np.ndarray:
        """Return the numbers that a model holds."""
        return np.concatenate([self.loose.shape, *(each.ravel() for each in self)])

    @classmethod
    def unpack(cls, numbers: np.ndarray) -> "Drape":
        """Return the tube from the numbers of `pack`."""
        rows, ways = numbers[:2].astype(int).tolist()
        shapes = (rows + 1, 8), (rows, ways), (rows, ways), (ways, 2), (len(_OWN), 3), (1,)
        ends = np.cumsum([np.prod(shape) for shape in shapes])
        parts = np.split(numbers[2:], ends[:-1])
        return cls(*(part.reshape(shape).copy() for part, shape in zip(parts, shapes, strict=True)))


class Tube(NamedTuple):
    """The surface of a drape in T-pose: outer and inner side, joined at the hem."""

    points: np.ndarray  # (N, 3) m
    faces: np.ndarray  # (T, 3)
    nodes: np.ndarray  # (N, 4) nodes that the points follow
    weights: np.ndarray  # (N, 4) their weights, largest first
    share: np.ndarray  # (N,) place along the legs: below 0 above the hips, 1 at the knees, 2 at the ankles


def skirt(
    body: Body,
    bare: BareBody,
    waist: float,
    hem: float,
    ease: float,
    flare: float,
    gap: float = 0.0,
    under: float = 0.0,
) -> Drape:
    """Return a skirt, or a coat below the waist.

    Args:
        body: Proportions.
        bare: The skin.
        waist: Height of its upper edge above the hip joints, m.
        hem: Where it ends along the legs: 1 at the knees, 2 at the ankles.
        ease: Distance from the hips, m.
        flare: Further distance at the hem per length below the hips.
        gap: Half the angle that is open in front, rad.
        under: Thickness of what legs wear below it, m.
    """
    size, origins = body.stature, segment_origins(body, np.zeros((1, 3)), np.tile(np.eye(3), (1, 16, 1, 1)))[0]
    thigh, shin = -body.offsets[[SEGMENTS.index("l_shin"), SEGMENTS.index("l_foot")], 2]
    shares = np.array([0, 0.16, 0.32, 0.54, 0.77, 1.0, 1.3])
    shares = np.append(shares[shares < hem - 0.1], (hem, min(hem + _BELOW, 2)))
    heights = np.concatenate([(waist, waist / 2), -np.interp(shares, (0, 1, 2), (0, thigh, thigh + shin))])
    turns = np.linspace(gap, 2 * np.pi - gap, _WAYS, endpoint=gap > 0)
    ways = np.stack([np.cos(turns), np.sin(turns)], -1)
    half = HALF_HIP_WIDTH * size
    rings, tight = np.zeros((len(heights), 8)), np.empty((len(heights), _WAYS))
    for row, height in enumerate(heights.tolist()):
        share = np.interp(-height, (0, thigh, thigh + shin), (0, 1, 2)) if height <= 0 else -height / waist
        rings[row, 1:3] = height, half
        # Pelvis, spine, thigh, shin.
        spine, legs, lower = (np.interp(share, xs, ys) for xs, ys in (
            ((-1, 0), (0.5, 0)), ((-0.5, 0, 0.3), (0, 0.5, 1)), ((0.95, 1.3), (0, 1)),
        ))  # fmt: skip
        rings[row, 4:8] = (1 - legs) * (1 - spine), (1 - legs) * spine, legs * (1 - lower), legs * lower
        hull = np.zeros(_WAYS)
        if share < 0.3:
            middle, hull = _around_trunk(bare, height, size, ways)
            rings[row, 0] = middle * np.interp(share, (0, 0.3), (1, 0))
        if share > -0.1:
            ahead, radius = _leg(bare, max(share, 0.16))
            rings[row, 0] += ahead * np.interp(share, (0, 0.3), (0, 1))
            # At the hem, calves may be wider above.
            rings[row, 3] = radius = max(radius, rings[row - 1, 3] if share > 1.3 else 0)
            of_legs = np.empty(_WAYS)
            _hull(np.array(((0, half), (0, -half))), radius, ways, of_legs)
            hull = np.maximum(hull, of_legs)
        tight[row] = hull + (0.010 if height > 0 else 0.002)
    below = np.maximum(-heights, 0)[:, None]
    widest = np.maximum.accumulate(tight, axis=0)
    eased = under * (heights <= 0) + ease * np.interp(heights, (0, waist), (1, 0.2))
    loose = widest + eased[:, None] + flare * below
    return Drape(rings, loose[:-1], tight[:-1], ways, origins[list(_OWN)], np.array([under]))


def _around_trunk(bare: BareBody, height: float, size: float, ways: np.ndarray) -> tuple[float, np.ndarray]:
    """Return x of the middle of the trunk at a height, m, and its hull (M,) around that in directions (M, 2), m."""
    arms = [i for i, segment in enumerate(SEGMENTS) if segment.endswith(("arm", "hand"))]
    near = (np.abs(bare.vertices[:, 2] - height) < 0.012 * size) & (bare.weights[:, arms].sum(1) < 0.3)
    ring = bare.vertices[near][:, :2]
    middle = (ring[:, 0].min() + ring[:, 0].max()) / 2
    equations = ConvexHull(ring - (middle, 0)).equations
    ahead = equations[:, :2] @ ways.T
    out = np.where(ahead > 1e-9, -equations[:, 2:] / np.maximum(ahead, 1e-9), np.inf)
    return float(middle), out.min(0)


def _leg(bare: BareBody, share: float) -> tuple[float, float]:
    """Return x of the middle of a leg relative to its bone, and its half width, m, at a share of its length."""
    first = SEGMENTS.index("l_thigh") + int(share > 1)
    bone = bare.origins[first + 1] - bare.origins[first]
    own = bare.vertices[bare.weights[:, first - (share > 1) : first + 2].sum(1) > 0.6]
    local = (own - bare.origins[first]) @ bare.rotations[first]
    near = local[np.abs(-local[:, 2] / np.linalg.norm(bone) - (share - (share > 1))) < 0.05]
    low, high = near.min(0)[:2], near.max(0)[:2]
    return float(low[0] + high[0]) / 2, float((high - low).max()) / 2


def tube(drape: Drape, columns: int, step: float, folds: float) -> Tube:
    """Return the surface of a drape.

    Args:
        columns: Number of vertices around it.
        step: Length of a triangle downwards, m.
        folds: Height of folds at the hem, m.
    """
    rows, closed = len(drape.loose), drape.closed
    placed = drape.at_rest()[:, :, 3].reshape(rows, NODES, 3)
    heights = placed[:, 0, 2]
    count = max(rows, round((heights[0] - heights[-1]) / step))
    levels = np.linspace(heights[0], heights[-1], count + 1)
    column = np.arange(columns) / columns * NODES if closed else np.linspace(0, NODES - 1, columns)
    points, outward = _between_nodes(placed, column, levels, closed)
    turn = 2 * np.pi * column / NODES
    depth = np.clip(-levels / max(-heights[-1], 1e-9), 0, 1)[:, None]
    waves = (1.5 + np.sin(9 * turn + 0.8 * np.sin(2 * turn + 1)) + 0.5 * np.sin(14 * turn + 2)) / 2
    points += (folds * depth**1.5 * waves)[..., None] * outward
    nodes, weights = _followed(np.interp(-levels, -heights, np.arange(rows)), column, rows, closed)
    scale = -drape.origins[4, 2]
    share = np.where(levels > 0, levels / -max(levels[0], 1e-9), -levels / scale)
    # The inner side follows the outer one in the same order.
    sides = [(points + side * _THICK * outward).reshape(-1, 3) for side in (1, -1)]
    faces = _faces(len(levels), columns, closed)
    of_both = [np.concatenate([each, each]) for each in (nodes, weights, np.repeat(share, columns))]
    return Tube(np.concatenate(sides), faces, *of_both)


def _between_nodes(
    placed: np.ndarray, column: np.ndarray, levels: np.ndarray, closed: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return points (L, C, 3), m, of smooth cloth through nodes (R, NODES, 3) at places (C,) along rings, 1 a node, and
    heights (L,), m, and its level outward unit normals (L, C, 3)."""
    heights, at = placed[:, 0, 2], np.arange(NODES)
    if closed:
        around = np.concatenate([placed, placed[:, :1]], axis=1)
        rings = CubicSpline(np.append(at, NODES), around, axis=1, bc_type="periodic")(column)
    else:
        rings = CubicSpline(at, placed, axis=1)(column)
    points = PchipInterpolator(-heights, rings)(-levels)
    along = np.gradient(np.concatenate([points[:, -1:], points, points[:, :1]], axis=1) if closed else points, axis=1)
    along = along[:, 1:-1] if closed else along
    outward = np.stack([along[..., 1], -along[..., 0], np.zeros(along.shape[:2])], -1)
    return points, outward / np.linalg.norm(outward, axis=-1, keepdims=True)


def _followed(row: np.ndarray, column: np.ndarray, rows: int, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the nodes (L * C, 4) around points at places (L,) and (C,) between rings and along them, and their weights
    (L * C, 4), largest first."""
    low_row = np.minimum(row.astype(int), rows - 2)
    low_column = np.minimum(column.astype(int), NODES - 1 if closed else NODES - 2)
    down, aside = (row - low_row)[:, None], column - low_column
    first = low_row[:, None] * NODES + low_column
    beside = low_row[:, None] * NODES + (low_column + 1) % NODES
    which = np.stack([first, beside, first + NODES, beside + NODES], -1).reshape(-1, 4)
    weights = np.stack([(1 - down) * (1 - aside), (1 - down) * aside, down * (1 - aside), down * aside], -1)
    weights = weights.reshape(-1, 4)
    order = np.argsort(-weights, axis=1, kind="stable")
    return np.take_along_axis(which, order, 1), np.take_along_axis(weights, order, 1)


def _faces(rows: int, columns: int, closed: bool) -> np.ndarray:
    """Return the triangles (T, 3) of the outer side of a grid of points, of the inner one, and of the edges between."""
    index = np.arange(rows * columns).reshape(rows, columns)
    # Nobody sees the inner side above.
    inner = (index + index.size)[len(index) // 6 :]
    outer, faces = index[-len(inner) :], []
    grids = [(index, 1), (inner, -1), (np.stack([index[-1], inner[-1]]), 1)]
    if closed:
        grids = [(np.column_stack([grid, grid[:, 0]]), way) for grid, way in grids]
    else:
        grids += [(np.stack([inner[:, 0], outer[:, 0]], 1), 1), (np.stack([outer[:, -1], inner[:, -1]], 1), 1)]
    for grid, way in grids:
        a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
        both = np.concatenate([np.stack([a, d, c], -1).reshape(-1, 3), np.stack([a, c, b], -1).reshape(-1, 3)])
        faces.append(both[:, ::way])
    return np.concatenate(faces)


# How cloth swings


def swings(length: float, hips: np.ndarray, fps: float) -> np.ndarray:
    """Return the displacements (F, 2) of a hem from where it hangs at rest, m, world, x and y.

    Cloth is a rod that hangs from the hips, a pendulum whose equivalent length is l = 2/3 of its own (Landau and
    Lifshitz, Mechanics, 3rd edition, section 32), with friction and a moving support. For small angles, its horizontal
    place w follows that of the hips p: w'' = -2 z n (w' - p') - n^2 (w - p), with n^2 = g / l. At first it moves with
    the hips. Places between frames are linear, for which the solution is exact.

    Args:
        length: Of the cloth below the hips, m.
        hips: (F, 2) places, m.
        fps: Frames per second.
    """
    if len(hips) < 2:
        return np.zeros_like(hips)
    seconds = np.arange(len(hips)) / fps
    way = hips - hips[0]
    way = way - np.outer(seconds, way[1] * fps)
    rate = np.sqrt(_GRAVITY / (2 / 3 * length))
    system = [2 * _FRICTION * rate, rate**2], [1, 2 * _FRICTION * rate, rate**2]
    away = np.stack([lsim(system, column, seconds)[1] - column for column in way.T], -1)
    far = np.linalg.norm(away, axis=1, keepdims=True) / (_WIDEST * length)
    return away * np.tanh(far) / np.maximum(far, 1e-12)


# Where the nodes are in a pose


@compiled()
def _drape(quats, places, rings, loose, tight, ways, origins, under, swing, closed, bones):
    """Fill `bones` (R * NODES, 3, 4) with the rotations and places of nodes, see the module.

    Args:
        quats, places: (6, 4) and (6, 3) m of the segments `_OWN` in the world.
        rings, loose, tight, ways, origins, under: As in `Drape`.
        swing: (2,) displacement of the hem, m.
        closed: Whether the last node of a ring is beside its first.
    """
    rows = len(loose)
    frames, legs = _follow(quats, places, rings, origins)
    own, along, marks = np.empty((2, 3)), np.empty((2, 3)), np.empty((NODES, 2))
    nodes, outs, spans = np.empty((rows, NODES, 3)), np.empty(len(ways)), np.empty(len(ways))
    freedom, radii = np.empty(rows), np.zeros(rows + 1)
    for row in range(rows):
        freedom[row] = free = _freedom(frames[:rows], row)
        frame, middle = frames[row], (legs[row, 0] + legs[row, 1]) / 2
        for k in range(2):
            middle[k] += free * max(0.0, rings[row, 1] / rings[rows - 1, 1]) * swing[k]
        above, below = legs[max(row - 1, 0)], legs[min(row + 1, rows - 1)]
        for side in range(2):
            for k in range(3):
                own[side, k], along[side, k] = 0, 0
                for j in range(3):
                    own[side, k] += frame[j, k] * (legs[row, side, j] - middle[j])
                    along[side, k] += frame[j, k] * (below[side, j] - above[side, j])
        spans[:] = 0
        if rings[row, 3] > 0:
            _span(own, along, rings[row, 3] + free * under[0], free, rings[0, 2], ways, spans)
        _outline(loose[row], tight[row], spans, free, outs)
        _spread(outs, ways, closed, marks)
        _put(marks, own, frame, middle, nodes[row])
    for row in range(rows + 1):
        if rings[row, 3] > 0:
            # Around the hips cloth touches legs at rest.
            close = 0.0 if rings[row, 6] + rings[row, 7] < 1 else _CLOSE
            radii[row] = rings[row, 3] + close + freedom[min(row, rows - 1)] * under[0]
    _clear(nodes, legs, radii, freedom, closed)
    _orient(nodes, closed, bones)


@compiled()
def _follow(quats, places, rings, origins):
    """Return the orientations (R + 1, 3, 3) of rings, and their points (R + 1, 2, 3) of the left and the right leg, m,
    both mixed from the segments by the weights of the rings."""
    matrices, weights, mean = np.empty((6, 3, 3)), np.empty(6), np.empty(4)
    frames, legs = np.empty((len(rings), 3, 3)), np.zeros((len(rings), 2, 3))
    for i in range(6):
        _matrix(quats[i], matrices[i])
    for row, ring in enumerate(rings):
        weights[0], weights[1] = ring[4], ring[5]
        weights[2] = weights[3] = ring[6]
        weights[4] = weights[5] = ring[7]
        mean[:] = 0
        for i in range(6):
            if weights[i] <= 0:
                continue
            dot = 0.0
            for k in range(4):
                dot += quats[i, k] * quats[0, k]
            sign = -1.0 if dot < 0 else 1.0
            part = weights[i] if i < 2 else weights[i] / 2
            for k in range(4):
                mean[k] += sign * part * quats[i, k]
            for side in range(2):
                if i >= 2 and (i % 2) != side:
                    continue
                away = (ring[0], ring[2] if side == 0 else -ring[2], ring[1])
                for k in range(3):
                    moved = places[i, k]
                    for j in range(3):
                        moved += matrices[i, k, j] * (away[j] - origins[i, j])
                    legs[row, side, k] += weights[i] * moved
        mean /= np.sqrt((mean**2).sum()) + 1e-12
        _matrix(mean, frames[row])
    return frames, legs


@compiled()
def _matrix(q, out):
    w, x, y, z = q[0], q[1], q[2], q[3]
    out[0, 0], out[0, 1], out[0, 2] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)
    out[1, 0], out[1, 1], out[1, 2] = 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    out[2, 0], out[2, 1], out[2, 2] = 2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)


@compiled()
def _freedom(frames, row):
    """Return how freely a ring hangs: 0 where cloth lies on level legs, as the hips of who sits, 1 on upright ones."""
    steep = min(abs(frames[row, 2, 2]), abs(frames[min(row + 1, len(frames) - 1), 2, 2]))
    free = min(1.0, max(0.0, (steep - _TIGHT) / (_LOOSE - _TIGHT)))
    return free * free * (3 - 2 * free)


@compiled()
def _span(own, along, radius, free, half, ways, spans):
    """Set `spans` (M,) to the distances that legs need in directions (M, 2), m.

    Args:
        own, along: (2, 3) places of the legs, m, and their directions, in the frame of the ring.
        radius: Of a leg, m.
        free: See `_freedom`.
        half: Half the distance between the hip joints, m.
    """
    discs = np.empty((6, 2))
    for side in range(2):
        # The plane of the ring cuts an oblique leg in an ellipse.
        flat = np.sqrt(along[side, 0] ** 2 + along[side, 1] ** 2)
        steep = max(_LEAST, abs(along[side, 2]) / (np.sqrt(flat**2 + along[side, 2] ** 2) + 1e-12))
        for number in range(3):
            for k in range(2):
                way = along[side, k] / (flat + 1e-12) * (number - 1)
                discs[3 * side + number, k] = own[side, k] + way * radius * (1 / steep - 1)
    # Rings have no corners sharper than their nodes can follow.
    wide = max(radius + _CLOSE + free * (_MARGIN - _CLOSE), free * _ROUND * half)
    _hull(discs, wide, ways, spans)


@compiled()
def _hull(discs, radius, ways, out):
    """Set `out` (M,) to how far rays from the origin go within the convex hull of discs in a plane, m.

    The hull is the intersection of half planes in `_SIDES` directions; the distance of each from the origin is the
    support function of the discs. The origin is in the hull.

    Args:
        discs: (D, 2) their middles, m.
        radius: Of all, m.
        ways: (M, 2) unit vectors.
    """
    for way in range(len(ways)):
        out[way] = np.inf
    for side in range(_SIDES):
        x, y = np.cos(2 * np.pi * side / _SIDES), np.sin(2 * np.pi * side / _SIDES)
        support = -np.inf
        for disc in discs:
            support = max(support, disc[0] * x + disc[1] * y + radius)
        # The middle of cloth that swings may leave the hull.
        support = max(support, 0.01)
        for way in range(len(ways)):
            facing = x * ways[way, 0] + y * ways[way, 1]
            if facing > 1e-3:
                out[way] = min(out[way], support / facing)


@compiled()
def _outline(loose, tight, spans, free, outs):
    """Set `outs` (M,) to the distances of cloth from the middle of its ring, m: outside of what legs need, and as long
    as at rest where that leaves room.

    Args:
        loose, tight: (M,) distances in hanging freely, and next to the body, m.
        spans: (M,) distances that legs need, m, 0 where they do not push.
        free: See `_freedom`.
    """
    base = np.empty(len(outs))
    for way in range(len(outs)):
        base[way] = tight[way] + free * (loose[way] - tight[way])
    smaller, length = 1.0, base.sum()
    for _ in range(3):
        for way in range(len(outs)):
            outs[way] = smaller * base[way]
            if spans[way] > 0:
                apart = outs[way] - spans[way]
                outs[way] = 0.5 * (outs[way] + spans[way] + np.sqrt(apart**2 + (free * _SMOOTH) ** 2))
        smaller = max(_NARROWEST, smaller * min(1.0, length / outs.sum()))


@compiled()
def _spread(outs, ways, closed, marks):
    """Set `marks` (K, 2) to points at even distances along a line around the origin, given by distances (M,) in
    directions (M, 2)."""
    count = len(ways) if closed else len(ways) - 1
    total = 0.0
    for turn in range(2):
        # First its length, then the points.
        passed, mark = 0.0, 0
        step = total / (len(marks) if closed else len(marks) - 1)
        for way in range(count):
            after = (way + 1) % len(ways)
            x, y = outs[way] * ways[way, 0], outs[way] * ways[way, 1]
            dx, dy = outs[after] * ways[after, 0] - x, outs[after] * ways[after, 1] - y
            piece = np.sqrt(dx**2 + dy**2)
            if turn:
                while mark < len(marks) and mark * step <= passed + piece + 1e-9:
                    share = (mark * step - passed) / (piece + 1e-12)
                    marks[mark, 0], marks[mark, 1] = x + share * dx, y + share * dy
                    mark += 1
            passed += piece
        total = passed


@compiled()
def _put(marks, own, frame, middle, nodes):
    """Set the nodes (NODES, 3) of a ring, m, from their places (NODES, 2) in its plane, tilted as the legs are apart
    along its axis."""
    aside, ahead, along_axis = (own[0] - own[1]) / 2
    for node in range(NODES):
        x, y = marks[node]
        share = (x * aside + y * ahead) / (aside**2 + ahead**2 + 1e-4)
        tilt = along_axis * min(_TILT, max(-_TILT, share))
        for k in range(3):
            nodes[node, k] = middle[k] + x * frame[k, 0] + y * frame[k, 1] + tilt * frame[k, 2]


@compiled()
def _clear(nodes, legs, radii, freedom, closed):
    """Move nodes (R, NODES, 3) outwards where they, or cloth half way between them, are in a leg, m.

    Rings go around the sections of legs by their planes; between rings, bent legs are elsewhere.

    Args:
        nodes: m.
        legs: (R + 1, 2, 3) points of the legs, m.
        radii: (R + 1,) of the legs there, m; 0 where they do not push.
        freedom: (R,) of each ring, see `_freedom`.
        closed: As in `_drape`.
    """
    rows = len(nodes)
    outward, lifts, point, normal = np.empty((rows, NODES, 3)), np.empty((rows, NODES)), np.empty(3), np.empty(3)
    for _ in range(_ROUNDS):
        for row in range(rows):
            for node in range(NODES):
                _axes(nodes, row, node, closed, outward[row, node], point)
        lifts[:] = 0
        for row in range(rows):
            for node in range(NODES):
                for place in range(4):
                    low, after = min(row + place // 2, rows - 1), node + place % 2
                    after = after % NODES if closed else min(after, NODES - 1)
                    corners = ((row, node), (low, node), (row, after), (low, after))
                    point[:], normal[:] = 0, 0
                    for one, other in corners:
                        for k in range(3):
                            point[k] += nodes[one, other, k] / 4
                            normal[k] += outward[one, other, k] / 4
                    lift = 0.0
                    for piece in range(max(row - _REACH, 0), min(low + _REACH, rows)):
                        if radii[piece] > 0:
                            for side in range(2):
                                way = _way_out(point, normal, legs[piece : piece + 2, side], radii[piece : piece + 2])
                                lift = max(lift, way)
                    for one, other in corners:
                        lifts[one, other] = max(lifts[one, other], lift)
        for row in range(rows):
            for node in range(NODES if radii[row] > 0 else 0):
                # A seat presses cloth to the legs from below.
                lift = lifts[row, node] * (1 + (1 - freedom[row]) * min(0.0, outward[row, node, 2]))
                for k in range(3):
                    nodes[row, node, k] += lift * outward[row, node, k]


@compiled()
def _way_out(point, outward, leg, radii):
    """Return how far a point (3,) in the outer half of a piece of a leg moves until it is outside, m; 0 elsewhere.

    Args:
        point: m.
        outward: (3,) direction in which it moves.
        leg, radii: (2, 3) and (2,) ends of the piece and its radii there, m.
    """
    along, square = 0.0, 1e-12
    for k in range(3):
        along += (point[k] - leg[0, k]) * (leg[1, k] - leg[0, k])
        square += (leg[1, k] - leg[0, k]) ** 2
    share = min(1.0, max(0.0, along / square))
    radius, facing, away, length = radii[0] + share * (radii[1] - radii[0]), 0.0, 0.0, 1e-12
    for k in range(3):
        apart = point[k] - leg[0, k] - share * (leg[1, k] - leg[0, k])
        facing += apart * outward[k]
        away += apart**2
        length += outward[k] ** 2
    if away >= radius**2 or facing <= 0:
        return 0.0
    facing /= np.sqrt(length)
    return np.sqrt(facing**2 + radius**2 - away) - facing


@compiled()
def _axes(nodes, row, node, closed, outward, across):
    """Set two unit vectors (3,) at a node: outwards, and along its ring."""
    above, below = max(row - 1, 0), min(row + 1, len(nodes) - 1)
    before, after = node - 1, node + 1
    if closed:
        before, after = before % NODES, after % NODES
    else:
        before, after = max(before, 0), min(after, NODES - 1)
    length, square = 0.0, 0.0
    for k in range(3):
        across[k] = nodes[row, after, k] - nodes[row, before, k]
        length += across[k] ** 2
    for k in range(3):
        across[k] /= np.sqrt(length) + 1e-12
    for k in range(3):
        m, n = (k + 1) % 3, (k + 2) % 3
        down_m, down_n = nodes[below, node, m] - nodes[above, node, m], nodes[below, node, n] - nodes[above, node, n]
        outward[k] = down_m * across[n] - down_n * across[m]
        square += outward[k] ** 2
    for k in range(3):
        outward[k] /= np.sqrt(square) + 1e-12


@compiled()
def _orient(nodes, closed, bones):
    """Fill `bones` (R * NODES, 3, 4) with the places of nodes (R, NODES, 3), m, and rotations: outwards, along the ring
    and upwards."""
    out, across = np.empty(3), np.empty(3)
    for row in range(len(nodes)):
        for node in range(NODES):
            bone = bones[row * NODES + node]
            _axes(nodes, row, node, closed, out, across)
            for k in range(3):
                m, n = (k + 1) % 3, (k + 2) % 3
                up = out[m] * across[n] - out[n] * across[m]
                bone[k, 0], bone[k, 1], bone[k, 2], bone[k, 3] = out[k], across[k], up, nodes[row, node, k]
