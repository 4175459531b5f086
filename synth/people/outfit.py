"""How people look: skin, clothes, shoes and hair as parts of one surface, each with a material."""

from collections.abc import Sequence
from functools import cache, lru_cache
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np
import trimesh
from scipy.interpolate import LinearNDInterpolator
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from synth.people.accessories import Crown, bag, hat
from synth.people.body import ANKLE_HEIGHT, SEGMENTS, SIDES, Body, side_and_name, trunk_sections
from synth.people.clothing import Bag, Coat, PersonLooks
from synth.people.draping import Drape, Tube, skirt, tube
from synth.people.skin import BEARD_LINE, HAIRLINE, around_head, around_limb, on_disc
from synth.people.skinning import FIRST_NODE, blend
from synth.people.surface import EYES, BareBody, assets, bare_body
from synth.textures import paint

_TILE = 0.3
"""Length of cloth that one repeat of a texture covers, m."""
_CLOTH, _EDGE, _UNDER, _TUCKED, _TUCK = 0.005, 0.004, 0.025, 0.05, 0.03
"""Thickness of cloth, width of the edge of a hem, how far skin and cloth continue under other cloth, and how far a
shirt reaches into trousers, m."""
_JOINT = 0.1
"""Length of cloth over which its pattern turns from one segment of a limb to the next, m."""
_TALL = {"top": 3, "bottom": 5, "coat": 5}
"""Repeats of their pattern that the textures of garments hold along the trunk or a leg."""
_ARMHOLE = (0.1, 0.8)
"""Weights of the arm between which the pattern of a shirt passes from the trunk's to the sleeve's."""
_SOFT, _LOOSE = 12, 24
"""How often weights are averaged over neighbours: around shoulders, and of clothes around hips."""


class Part(NamedTuple):
    """A part of the visible surface of a person, in the bind pose."""

    segment: str  # Segment that it belongs to
    material: str  # Name of its material, see `synth.people.mjcf`
    vertices: np.ndarray  # (N, 3) m; the mid point of the hip joints is the origin
    faces: np.ndarray  # (T, 3) vertex indices, counter-clockwise seen from outside
    normals: np.ndarray  # (N, 3) unit normals. Parts of one garment share them at their seams.
    uv: np.ndarray  # (T, 3, 2) texture coordinates of the corners, 1 per repeat
    # (N, 4) bones that the vertices follow, see `synth.people.skinning`; from `FIRST_NODE` on, nodes of `drapes`
    bones: np.ndarray
    weights: np.ndarray  # (N, 4) their weights


class _Sheet(NamedTuple):
    """A surface with values at its vertices, which cuts interpolate."""

    # points, normals: (N, 3) m, and unit normals
    points: np.ndarray
    normals: np.ndarray
    weights: np.ndarray  # (N, 16) weights of `SEGMENTS`
    along: np.ndarray  # (N, 16) position along each segment, 0 at its joint, 1 at the next
    faces: np.ndarray  # (T, 3)


@lru_cache(maxsize=64)
def parts(body: Body, looks: PersonLooks) -> list[Part]:
    """Return the parts of a person's visible surface, in the order of `SEGMENTS`. Colours and patterns play no part."""
    bare = bare_body(body, looks.hands)
    sheet = _bare_sheet(bare)
    (top, thick), (bottom, wide) = _top(sheet, bare, body, looks), _bottom(sheet, body, looks)
    shoes, shod = _shoes(sheet, bare, body)
    coat, cover, heavy = _coat(sheet, bare, body, looks) if looks.coat else (*[np.full(len(top), -_FAR)] * 2, thick)
    # Where two garments overlap, neither hem is an opening.
    fields = np.sort([top, bottom, shod, coat], axis=0)
    sheets = [("skin", _kept(sheet, _UNDER - fields[-1] - np.maximum(fields[-2], 0))[0])]
    # Around the hips cloth hangs between the thighs rather than on each.
    cloth = sheet._replace(weights=_softened(sheet.weights, sheet.along, ("pelvis", "spine"), "thigh", _LOOSE))
    sheets.append(("top", _worn(cloth, top, thick, cover if looks.untucked else np.maximum(bottom, cover))))
    if not looks.skirt:
        sheets.append(("bottom", _worn(cloth, bottom, wide, np.maximum(top, cover) if looks.untucked else cover)))
    if looks.coat:
        sheets.append(("coat", _worn(cloth, coat, heavy)))
    ground = bare.origins[SEGMENTS.index("l_foot"), 2] - ANKLE_HEIGHT * body.stature
    upper = shoes.points[:, 2] - ground - 0.011 * body.stature
    sheets += [("shoe", _kept(shoes, upper)[0]), ("sole", _kept(shoes, -upper)[0])]
    hanging = [(material, drape, *_hung(drape, body)) for material, drape in drapes(body, looks)]
    if looks.bag:
        worn, loose = dict(sheets), {material: each for material, _, each, _ in hanging}
        low = loose.get("coat") or loose.get("bottom") or worn["bottom"]
        sheets += _bag([worn["coat" if looks.coat else "top"], low], bare, body, looks.bag)
    sheets += _face(sheet, bare, body)
    head = _only(sheet, (sheet.weights[:, SEGMENTS.index("head")] > 0.8)[sheet.faces].all(1))[0]
    crown = None
    if looks.hat:
        crown = Crown.of(looks.hat.kind, head.points, bare.eyes.mean((0, 1)), body.stature * body.head)
    sheets += _hair(head, bare, body, looks.hair, crown)
    if looks.beard and looks.beard != "stubble":
        sheets.append(("hair", _beard(head, bare, body, looks.beard)))
    if crown:
        sheets += [(material, _rigid(points, faces, SEGMENTS.index("head"))) for material, points, faces in hat(crown)]
    found = [part for material, each in sheets for part in _split(each, material, bare, body)]
    first = FIRST_NODE
    for material, drape, each, surface in hanging:
        found += _split(each, material, bare, body, surface, first)
        first += drape.nodes
    return sorted(found, key=lambda part: SEGMENTS.index(part.segment))


@lru_cache(maxsize=64)
def drapes(body: Body, looks: PersonLooks) -> list[tuple[str, Drape]]:
    """Return what hangs around a person's legs, by material."""
    size, found = body.stature, []
    if looks.skirt:
        hem, ease, flare = _SKIRTS[looks.bottom.long]
        found.append(("bottom", skirt(body, bare_body(body), _WAIST * size, hem, ease * size, flare)))
    if looks.coat and looks.coat.cloth.long:
        waist, hem, ease, flare = _COAT
        gap, room = _GAP * looks.coat.open, _UNDERNEATH * size
        found.append(("coat", skirt(body, bare_body(body), waist * size, hem, ease * size, flare, gap, room)))
    return found


def _bare_sheet(bare: BareBody) -> _Sheet:
    faces = assets().faces
    along = np.zeros_like(bare.weights)
    for i, segment in enumerate(SEGMENTS):
        if side_and_name(segment)[1] in ("upper_arm", "forearm", "thigh", "shin"):
            bone = bare.origins[i + 1] - bare.origins[i]
            along[:, i] = (bare.vertices - bare.origins[i]) @ bone / (bone @ bone)
    # MakeHuman's weights suit a skeleton with collar bones. Without them, shoulders get corners as arms are raised.
    weights = _softened(bare.weights, along, ("chest",), "upper_arm", _SOFT)
    return _Sheet(bare.vertices, _normals(bare.vertices, faces), weights, along, faces)


@cache
def _around() -> csr_matrix:
    """Return the matrix (N, N) whose product with values at the vertices of the skin are the means over neighbours."""
    return _mean_of_neighbours(assets().faces, len(assets().bones))


def _mean_of_neighbours(faces: np.ndarray, count: int) -> csr_matrix:
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    around = csr_matrix((np.ones(2 * len(edges)), np.concatenate([edges, edges[:, ::-1]]).T), (count,) * 2)
    around.data[:] = 1
    return csr_matrix(around.multiply(1 / np.maximum(around.sum(1), 1)))


def _softened(weights: np.ndarray, along: np.ndarray, trunk: tuple[str, ...], limb: str, times: int) -> np.ndarray:
    """Return weights (N, 16) averaged over neighbours on some segments of the trunk and on the first third of limbs."""
    free = weights[:, [SEGMENTS.index(segment) for segment in trunk]].sum(1)
    for i in (SEGMENTS.index(f"{side}_{limb}") for side in SIDES):
        free += weights[:, i] * np.interp(along[:, i], (0.3, 0.6), (1, 0))
    rows = np.flatnonzero(free)
    around, share, weights = _around()[rows], 0.5 * free[rows, None], weights.copy()
    for _ in range(times):
        weights[rows] += share * (around @ weights - weights[rows])
    return weights


def _normals(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Return the (N, 3) unit normals at the vertices, means over the triangles around them weighted by area."""
    one, two, three = points[faces.T]
    across = np.cross(two - one, three - one)
    total = np.stack([np.bincount(faces.ravel(), across[:, k].repeat(3), len(points)) for k in range(3)], -1)
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)


def _kept(sheet: _Sheet, field: np.ndarray, *others: np.ndarray) -> tuple:
    """Return the part of a sheet where a field (N,) is above 0, cut along 0, and other fields (N,) at its vertices."""
    split, fields = _cut(sheet, field, field, *others)
    return _only(split, fields[0][split.faces].sum(1) > 0, *fields[1:])


def _only(sheet: _Sheet, which: np.ndarray, *fields: np.ndarray) -> tuple:
    """Return some triangles (T,) of a sheet, and fields at their vertices."""
    used, faces = _renumbered(sheet.faces[which], len(sheet.points))
    points, normals, weights, along = (each[used] for each in sheet[:4])
    return _Sheet(points, normals, weights, along, faces), *(field[used] for field in fields)


def _renumbered(faces: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return which of `count` vertices triangles (T, 3) have, and the triangles by their numbers among these."""
    used = np.zeros(count, bool)
    used[faces] = True
    return np.flatnonzero(used), (used.cumsum() - 1)[faces]


def _cut(sheet: _Sheet, field: np.ndarray, *others: np.ndarray) -> tuple[_Sheet, list[np.ndarray]]:
    """Cut the triangles of a sheet along 0 of a field (N,). Return it, and other fields at its vertices."""
    faces, inside = sheet.faces, field > 0
    number = inside[faces].sum(1)
    crossed = (number > 0) & (number < 3)
    odd = np.where(number == 1, inside[faces].argmax(1), (~inside[faces]).argmax(1))
    rolled = np.take_along_axis(faces, (odd[:, None] + np.arange(3)) % 3, 1)[crossed]
    edges = np.sort(np.stack([rolled[:, [0, 1]], rolled[:, [2, 0]]]).reshape(-1, 2), 1).astype(np.int64)
    unique, index = np.unique(edges @ (len(field), 1), return_inverse=True)
    ab, ca = len(field) + index.reshape(2, -1)
    one, two, three = rolled.T
    triangles = np.concatenate([
        faces[~crossed], np.stack([one, ab, ca], -1), np.stack([ab, two, three], -1), np.stack([ab, three, ca], -1)
    ])  # fmt: skip
    low, high = np.divmod(unique, len(field))
    share = (field[low] / (field[low] - field[high]))[:, None] if len(unique) else np.empty((0, 1))

    def both(values: np.ndarray) -> np.ndarray:
        flat = values.reshape(len(values), -1)
        return np.concatenate([flat, flat[low] + share * (flat[high] - flat[low])]).reshape(-1, *values.shape[1:])

    points, normals, weights, along = (both(each) for each in sheet[:4])
    fields = [both(each) for each in others]
    for each, other in zip(fields, others, strict=True):
        if other is field:
            each[len(field) :] = 0
    return _Sheet(points, normals, weights, along, triangles), fields


# Clothes. A garment is the part of the skin where a field, m, is above 0; it grows with the distance from the hem.


def _chain(sheet: _Sheet, names: tuple[str, str, str]) -> np.ndarray:
    """Return the (N,) position along arms or legs: 0 to 1 in the first segment, and so on; -1 elsewhere."""
    place = np.full(len(sheet.points), -1.0)
    for side in SIDES:
        numbers = [SEGMENTS.index(f"{side}_{name}") for name in names]
        own = sheet.weights[:, numbers]
        most = own.argmax(1)
        first, second = sheet.along[:, numbers[0]], sheet.along[:, numbers[1]]
        here = np.where(most == 0, np.minimum(first, 1), 1 + second.clip(0))
        place = np.where(own.sum(1) > 0.5, here, place)
    return place


_ARM, _LEG = ("upper_arm", "forearm", "hand"), ("thigh", "shin", "foot")
_LEAST = 12
"""Least number of triangles of a part."""
_FAR = 1.0
"""Value of a field where no hem is near, m."""


def _top(sheet: _Sheet, bare: BareBody, body: Body, looks: PersonLooks) -> tuple[np.ndarray, np.ndarray]:
    """Return the field and the thickness (N,) of the shirt, m."""
    size, arm, up = body.stature, _chain(sheet, _ARM), sheet.points[:, 2] / body.stature
    neck = bare.origins[SEGMENTS.index("head")]
    hem = np.where(arm > 0, _FAR, sheet.points[:, 2] - (-0.03 * size if looks.untucked else 0.074 * size - _TUCK))
    sleeve = np.where(arm > 0, (1.95 if looks.top.long else 0.62) - arm, _FAR / size) * 0.17 * size
    # The collar lies in a plane around the neck, lower in front; shoulders may rise above it.
    ahead, aside, above = (sheet.points - neck).T
    collar = 0.9 * np.maximum(np.hypot(ahead, aside) - 0.038 * size, 0) - above - 0.38 * ahead + 0.002 * size
    loose = np.interp(arm, (0, 1, 2), (0, 0.004, 0.005)) if looks.top.long else np.interp(arm, (0, 0.62), (0, 0.007))
    # A shirt in trousers narrows towards them.
    levels = ((-0.05, 0.02, 0.12, 0.25), (0.014, 0.010, 0.007, 0.002))
    levels = levels if looks.untucked else ((0.08, 0.10, 0.14, 0.25), (-0.003, 0.003, 0.006, 0.002))
    loose += np.where(arm < 0, np.interp(up, *levels), 0)
    return np.minimum(np.minimum(hem, sleeve), collar), _CLOTH + 0.002 + loose


def _bottom(sheet: _Sheet, body: Body, looks: PersonLooks) -> tuple[np.ndarray, np.ndarray]:
    """Return the field and the thickness (N,) of the trousers, m."""
    size, leg = body.stature, _chain(sheet, _LEG)
    waist = (0.045 if looks.untucked else 0.074) * size - sheet.points[:, 2]
    # A skirt hides only as much skin as would come through it on a person who sits.
    end = 0.5 * _SKIRTS[looks.bottom.long][0] if looks.skirt else 1.98 if looks.bottom.long else 0.86
    cuff = np.where(leg > 0, end - leg, _FAR / size) * 0.245 * size
    field = np.where(_chain(sheet, _ARM) > 0, -_FAR, np.minimum(waist, cuff))
    wide = (0.002, 0.006, 0.014, 0.016) if looks.bottom.long else (0.006, 0.014, 0.014, 0.014)
    loose = np.interp(leg, (0.3, 1, 1.6, 2), wide) * size / 1.75
    return field, _CLOTH + loose + (0 if looks.untucked else 0.006 * (leg < 0))


def _coat(sheet: _Sheet, bare: BareBody, body: Body, looks: PersonLooks) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the field of a coat, the field of what it covers, and its thickness, m, (N,) each.

    Below the waist, a long coat hangs around the legs.
    """
    assert looks.coat
    size, arm, up = body.stature, _chain(sheet, _ARM), sheet.points[:, 2] / body.stature
    ahead, aside, above = (sheet.points - bare.origins[SEGMENTS.index("head")]).T
    low = _COAT[0] - 0.025 if looks.coat.cloth.long else 0.045 if looks.skirt else -0.04
    hem = np.where(arm > 0, _FAR, sheet.points[:, 2] - low * size)
    sleeve = np.where(arm > 0, 1.97 - arm, _FAR / size) * 0.17 * size
    collar = 0.9 * np.maximum(np.hypot(ahead, aside) - 0.040 * size, 0) - above - 0.38 * ahead + 0.010 * size
    # Open coats leave a strip free in front, which widens to the neck; of closed ones, only the collar is open.
    strip = np.interp(up, (0.0, 0.15, 0.24, 0.30), (0.034, 0.028, 0.024, 0.035) if looks.coat.open else (0, 0, 0, 0.02))
    front = np.where((arm < 0) & (ahead > -0.01 * size), np.abs(aside) - strip * size, _FAR)
    front = np.where(strip > 0, front, _FAR)
    loose = np.where(arm > 0, 0.011, np.interp(up, (-0.06, 0.02, 0.12, 0.25), (0.011, 0.013, 0.012, 0.009)))
    field = np.min([hem, sleeve, collar, front], axis=0)
    leg = _chain(sheet, _LEG)
    hung = np.where(arm > 0, -_FAR, np.minimum(np.where(leg > 0, 0.55 - leg, _FAR / size) * 0.245 * size, front))
    cover = np.maximum(field, np.minimum(hung, collar)) if looks.coat.cloth.long else field
    return field, cover, _CLOTH + 0.004 + loose


def _worn(sheet: _Sheet, field: np.ndarray, thickness: np.ndarray, over: np.ndarray | None = None) -> _Sheet:
    """Return a garment over the skin where a field is above 0, smoother than the skin, and never inside it.

    What another garment covers, where the field `over` is above `_TUCKED`, is left out.
    """
    hidden = np.full(len(field), -_FAR) if over is None else over
    thickness = thickness * np.interp(hidden, (0, _UNDER), (1, 0.5))
    shell, inside, thick, hidden = _kept(sheet, field, field, thickness, hidden)
    shell, (inside, thick, hidden) = _cut(shell, inside - _EDGE, inside, thick, hidden)
    thick = thick * np.clip(inside / _EDGE, 0, 1) + 0.0005
    mean = _mean_of_neighbours(shell.faces, len(thick))
    outward = shell.normals
    for _ in range(20):
        outward = outward + mean @ outward
        outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    skin, points = shell.points, shell.points + thick[:, None] * outward
    free = (inside > _EDGE + 1e-6)[:, None]
    for _ in range(12):
        points = np.where(free, 0.5 * points + 0.5 * (mean @ points), points)
        depth = thick - ((points - skin) * outward).sum(1)
        points = points + np.maximum(depth, 0)[:, None] * outward
    return _kept(shell._replace(points=points, normals=_normals(points, shell.faces)), _TUCKED - hidden)[0]


def _shoes(sheet: _Sheet, bare: BareBody, body: Body) -> tuple[_Sheet, np.ndarray]:
    size, leg = body.stature, _chain(sheet, _LEG)
    ankle = bare.origins[SEGMENTS.index("l_foot")]
    field = np.where(leg > 1.5, ankle[2] + 0.006 * size - sheet.points[:, 2], -_FAR)
    shell, inside = _kept(sheet, field, field)
    shell, (inside,) = _cut(shell, inside - _EDGE, inside)
    ground = ankle[2] - ANKLE_HEIGHT * size
    low = np.clip((ground + 0.022 * size - shell.points[:, 2]) / (0.012 * size), 0, 1)
    out = (0.003 + 0.003 * low) * np.clip(inside / _EDGE, 0, 1) + 0.0005
    points = shell.points + out[:, None] * shell.normals
    # The sole is flat, with upright sides.
    flat = (shell.normals[:, 2] < -0.5) & (points[:, 2] < ground + 0.02 * size)
    points[flat, 2] = ground
    points[:, 2] = np.maximum(points[:, 2], ground)
    return shell._replace(points=points, normals=_normals(points, shell.faces)), field


# Bags

_STRAP, _THICK = {"backpack": 0.0125, "lower": 0.006, "shoulder_bag": 0.010}, 0.006
"""Half the widths of straps, fractions of stature, and their thickness in the middle, m."""


def _bag(worn: list[_Sheet], bare: BareBody, body: Body, looks: Bag) -> list[tuple[str, _Sheet]]:
    """Return a bag on a shirt and trousers, with straps on the shirt."""
    size, sign = body.stature, SIDES[looks.side]
    arms = [SEGMENTS.index(f"{side}_{name}") for side in SIDES for name in _ARM]
    trunk, low = (_kept(each, 0.4 - each.weights[:, arms].sum(1))[0] for each in worn)
    top = bare.origins[arms[0], 2]
    ahead, aside, up = trunk.points.T
    straps = []
    if looks.kind == "backpack":
        front, back = top - 0.105 * size, top - 0.20 * size
        start = ahead[np.abs(up - front) < 0.03 * size].max()
        end = ahead[np.abs(up - back) < 0.03 * size].min()
        before = ahead > (start + end) / 2
        for one in SIDES.values():
            over = one * aside - 0.060 * size
            straps.append(
                _strap(trunk, over, _STRAP["backpack"] * size, up - np.where(before, front, top - 0.03 * size))
            )
            # From the front to the bag, along a plane across which the side is level.
            across = up - front - (ahead - start) * (back - front) / (end - start)
            outer = np.where(before, over + 0.012 * size, one * aside)
            straps.append(_strap(trunk, across, _STRAP["lower"] * size, outer))
        weights = {"chest": 1.0}
    else:
        end = top - 0.235 * size
        side = (sign * aside)[np.abs(up - end) < 0.03 * size].max()
        start, end = np.array((-0.052 * size * sign, top + 0.02 * size)), np.array((sign * side, end))
        way = (end - start) / np.linalg.norm(end - start)
        across = (aside - start[0]) * way[1] - (up - start[1]) * way[0]
        straps.append(_strap(trunk, across, _STRAP["shoulder_bag"] * size, up - end[1]))
        weights = {"pelvis": 0.6, "spine": 0.4}
    row = np.array([weights.get(segment, 0.0) for segment in SEGMENTS])
    found = [("strap", each) for each in straps]
    for material, points, faces in bag(looks.kind, sign, np.concatenate([trunk.points, low.points]), top, size):
        sheet = _rigid(points, faces, 0)
        found.append((material, sheet._replace(weights=np.tile(row, (len(points), 1)))))
    return found


def _strap(cloth: _Sheet, across: np.ndarray, half: float, within: np.ndarray) -> _Sheet:
    """Return a strap on a cloth, along 0 of a field (N,), m, where another is above 0."""
    band, across = _kept(cloth, within, across)
    for way in (1, -1):
        band, across = _kept(band, half - way * across, across)
    band, (across,) = _cut(band, across, across)
    thick = 0.0005 + _THICK * (1 - np.abs(across) / half)
    points = band.points + thick[:, None] * band.normals
    return band._replace(points=points, normals=_normals(points, band.faces))


# Skirts, and long coats below the waist

_WAIST = 0.074
"""Height of the waistband above the hip joints, fraction of stature, where a shirt is tucked in."""
_SKIRTS = {False: (1.02, 0.010, 0.10), True: (1.7, 0.012, 0.10)}
"""Where skirts end along the legs, their ease, fraction of stature, and their flare, by whether they are long."""
_COAT, _GAP = (0.05, 0.94, 0.014, 0.11), 0.42
"""Height of a long coat's waist above the hip joints, its end along the legs, its ease, fractions of stature, and its
flare; and half the angle that an open one leaves free in front, rad."""
_UNDERNEATH = 0.010
"""Thickness of trousers below a long coat, fraction of stature."""
_COLUMNS, _ROW = 36, 0.04
"""Number of vertices around hanging cloth, and distance between them downwards, m."""


def _hung(drape: Drape, body: Body) -> tuple[_Sheet, Tube]:
    """Return the surface of cloth that hangs from the waist; its weights say which segment it is beside."""
    surface = tube(drape, _COLUMNS, _ROW, 0.008 * body.stature)
    weights, left = np.zeros((len(surface.points), len(SEGMENTS))), surface.points[:, 1] > 0
    for side in SIDES:
        own = left == (side == "l")
        for name, low, high in (("thigh", 0.05, 1.0), ("shin", 1.0, 3.0)):
            weights[own, SEGMENTS.index(f"{side}_{name}")] = ((surface.share >= low) & (surface.share < high))[own]
    weights[weights.sum(1) == 0, 0] = 1
    normals = _normals(surface.points, surface.faces)
    return _Sheet(surface.points, normals, weights, 0 * weights, surface.faces), surface


# Face and hair

_MOUTH = 0.0415
"""Height of the eyes above the mouth, fraction of stature and of the head's size."""


def _face(sheet: _Sheet, bare: BareBody, body: Body) -> list[tuple[str, _Sheet]]:
    size, head = body.stature * body.head, SEGMENTS.index("head")
    found, middles, front = [], bare.eyes.mean(1), _front(sheet, head)
    for ball, middle, turn in zip(bare.eyes, middles, (1, -1), strict=True):
        weights = np.tile(np.eye(len(SEGMENTS))[head], (len(ball), 1))
        out = ball - middle
        out /= np.linalg.norm(out, axis=1, keepdims=True)
        eye = _Sheet(ball, out, weights, np.zeros_like(weights), assets().eye_faces[:, ::turn])
        found.append(("eye", eye))
        iris = _kept(eye, out[:, 0] - np.cos(np.radians(27)))[0]
        found.append(("iris", iris._replace(points=iris.points + 0.0006 * iris.normals + (0.0006, 0, 0))))
        found.append(
            ("brow", _patch(front, head, middle[1:] + (0, 0.0132 * size), (0.0125 * size, 0.0021 * size), 0.002 * size))
        )
    mouth = bare.eyes.mean((0, 1))[1:] - (0, _MOUTH * size)
    found.append(("lip", _patch(front, head, mouth, (0.0135 * size, 0.0048 * size), 0.0)))
    return found


def _front(sheet: _Sheet, head: int) -> LinearNDInterpolator:
    """Return x of the face as a function of y and z."""
    front = np.flatnonzero((sheet.weights[:, head] > 0.9) & (sheet.normals[:, 0] > 0.1))
    # Without the inside of the mouth.
    near = cKDTree(sheet.points[front, 1:]).query(sheet.points[front, 1:], 8, distance_upper_bound=0.012)[1]
    ahead_of = np.append(sheet.points[front, 0], -np.inf)[near].max(1)
    front = front[sheet.points[front, 0] > ahead_of - 0.008]
    return LinearNDInterpolator(sheet.points[front][:, 1:], sheet.points[front][:, 0])


def _patch(front: LinearNDInterpolator, head: int, middle: np.ndarray, half: tuple[float, float], bow: float) -> _Sheet:
    """Return an ellipse on the face: its middle (2,) and half sizes along y and z, m, its ends lower by `bow`."""
    angle, rings = np.linspace(0, 2 * np.pi, 20, endpoint=False), np.array((0.35, 0.7, 1.0))
    round_ = (rings[:, None, None] * np.stack([np.cos(angle), np.sin(angle)], -1)).reshape(-1, 2)
    disc = np.concatenate([np.zeros((1, 2)), round_])
    places = middle + disc * half - np.outer(disc[:, 0] ** 2, (0, bow))
    lift = 0.0024 * np.clip(2 - 2 * np.hypot(*disc.T), 0.1, 1)
    ahead = front(places) + lift
    index = 1 + np.arange(len(disc) - 1).reshape(len(rings), -1)
    ahead = np.where(np.isnan(ahead), np.nanmean(ahead), ahead)
    after = np.roll(index, -1, 1)
    faces = [np.stack([0 * index[0], index[0], after[0]], -1)]
    for inner, outer in pairwise(range(len(rings))):
        faces += [
            np.stack([index[inner], index[outer], after[outer]], -1),
            np.stack([index[inner], after[outer], after[inner]], -1),
        ]
    return _rigid(np.column_stack([ahead, places]), np.concatenate(faces), head)


def _finer(sheet: _Sheet) -> _Sheet:
    """Return a sheet with four triangles for each."""
    values = {name: getattr(sheet, name) for name in ("normals", "weights", "along")}
    points, faces, values = trimesh.remesh.subdivide(sheet.points, sheet.faces, vertex_attributes=values)
    return _Sheet(points, faces=faces, **values)


def _hair(skin: _Sheet, bare: BareBody, body: Body, style: str, crown: Crown | None) -> list[tuple[str, _Sheet]]:
    """Return the hair; below a hat it is pressed, and left out where nothing shows."""
    if style == "bald":
        return []
    size, head = body.stature * body.head, SEGMENTS.index("head")
    eye = bare.eyes.mean((0, 1))
    scalp = _finer(skin)
    back = scalp.points[:, 0].min()
    field = size * _inside(HAIRLINE, *(scalp.points - eye)[:, [0, 2]].T / size)
    field += 0.0015 * size * _locks(scalp, size)
    thick = {"short": 0.0070, "bun": 0.005}.get(style, 0.0085) * size
    cap = _worn(scalp, field, thick * np.clip(0.2 + field / (0.035 * size), 0, 1))
    points = cap.points + (0.0012 * size * _locks(cap, size))[:, None] * cap.normals
    found = [("hair", cap._replace(points=points, normals=_normals(points, cap.faces)))]
    if style == "bun":
        ball, place = (
            trimesh.creation.icosphere(2, 0.027 * size),
            np.array([(back - 0.008 * size, 0, eye[2] + 0.030 * size)]),
        )
        if crown:
            place[:, 2] -= max(0, crown.above(place)[0] + 0.024 * size)
        found.append(("hair", _rigid(ball.vertices + place, ball.faces, head)))
    if style in ("bob", "long"):
        fall = {"bob": -0.060, "long": -0.150}[style]
        rows = np.array([(fall, 0.006, 0.008, 0.033), (fall + 0.03, 0.008, 0.016, 0.042), (-0.02, 0.020, 0.028, 0.0475),
                         (0.010, 0.030, 0.037, 0.0490), (0.03, 0.035, 0.035, 0.045)]) * size  # fmt: skip
        found.append(("hair", _fall(rows + (eye[2], back, 0, 0), head)))
    return [(material, _below(crown, each)) for material, each in found] if crown else found


def _beard(skin: _Sheet, bare: BareBody, body: Body, kind: str) -> _Sheet:
    """Return a beard around the mouth."""
    size, eyes = body.stature * body.head, bare.eyes.mean((0, 1))
    # Without the inside of the mouth
    behind = _front(skin, SEGMENTS.index("head"))(skin.points[:, 1:]) - skin.points[:, 0] > 0.004 * size
    inside = behind & (skin.points[:, 2] > eyes[2] - 0.060 * size) & (np.abs(skin.points[:, 1]) < 0.024 * size)
    skin = _finer(_only(skin, ~inside[skin.faces].any(1))[0])
    ahead, aside, up = ((skin.points - eyes) / size).T
    field = _inside(BEARD_LINE, ahead, up) + 0.0012 * _locks(skin, size)
    mouth = np.hypot(aside / 0.0135, (up + _MOUTH) / 0.0052) - 1
    field = np.where(ahead > -0.012, np.minimum(field, 0.004 * mouth), field)
    if kind == "goatee":
        field = np.minimum(field, 0.017 + 0.1 * (-_MOUTH - up).clip(0) - np.abs(aside))
    chin = np.exp(-((aside / 0.016) ** 2) - ((up + 0.066) / 0.014) ** 2)
    thick = {"short": 0.0020, "goatee": 0.0025 + 0.002 * chin, "full": 0.0045 + 0.008 * chin}[kind]
    return _worn(skin, size * field, thick * size * np.clip(0.15 + field / 0.012, 0, 1))


def _below(crown: Crown, hair: _Sheet) -> _Sheet:
    points = crown.pressed(hair.points)
    pressed = hair._replace(points=points, normals=_normals(points, hair.faces))
    return _kept(pressed, 0.006 * crown.size - crown.above(points))[0]


def _inside(line: Sequence[tuple[float, float]], ahead: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return how far points (N,) are inside a line, seen from the side."""
    contour = np.array(line, np.float32)
    return np.array(
        [cv2.pointPolygonTest(contour, place, True) for place in zip(ahead.tolist(), up.tolist(), strict=True)]
    )


def _locks(sheet: _Sheet, size: float) -> np.ndarray:
    """Return waves (N,) from -1 to 1 across locks that fall from the crown."""
    x, y, z = sheet.points.T
    around = np.arctan2(y, x - x.mean())
    return np.sin(19 * around + 4 * np.sin(5 * around) + 60 * z / size)


def _fall(rows: np.ndarray, segment: int) -> _Sheet:
    """Return hair that hangs from the back of the head: ellipses, (R, 4) height, middle, half depth, half width."""
    grid = np.linspace(0, len(rows) - 1, 14)
    height, middle, depth, width = (np.interp(grid, np.arange(len(rows)), column) for column in rows.T)
    close = np.minimum(1, np.sqrt(np.maximum(1 - (np.abs(grid / grid[-1] - 0.5) * 2) ** 6, 1e-4)))
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    points = np.stack([
        middle[:, None] + (close * depth)[:, None] * np.cos(angle), (close * width)[:, None] * np.sin(angle),
        np.broadcast_to(height[:, None], (len(grid), len(angle))),
    ], -1)  # fmt: skip
    index = np.arange(points[..., 0].size).reshape(points.shape[:2])
    low, high = index[:-1], index[1:]
    turned = [np.roll(each, -1, 1) for each in (low, high)]
    faces = np.concatenate([np.stack([low, turned[0], turned[1]], -1), np.stack([low, turned[1], high], -1)]).reshape(
        -1, 3
    )
    return _rigid(points.reshape(-1, 3), faces, segment)


def _rigid(points: np.ndarray, faces: np.ndarray, segment: int) -> _Sheet:
    weights = np.tile(np.eye(len(SEGMENTS))[segment], (len(points), 1))
    return _Sheet(points, _normals(points, faces), weights, np.zeros_like(weights), np.asarray(faces))


# From sheets to parts


def _split(
    sheet: _Sheet, material: str, bare: BareBody, body: Body, hangs: Tube | None = None, first: int = 0
) -> list[Part]:
    if not len(sheet.faces):
        return []
    share = sheet.weights[:, : len(SEGMENTS)][sheet.faces].sum(1)
    # A few triangles beyond a hem belong to the next segment.
    many = np.bincount(share.argmax(1), minlength=len(SEGMENTS)) >= _LEAST
    owner = np.where(many, share, -1).argmax(1)
    bones, weights = (hangs.nodes + first, hangs.weights) if hangs else blend(sheet.weights, sheet.along)
    uv = _texture(sheet, owner, material, bare, body, hangs=hangs is not None)
    found = []
    for number in np.unique(owner):
        used, faces = _renumbered(sheet.faces[owner == number], len(sheet.points))
        points, normals = sheet.points[used], sheet.normals[used]
        own = uv[owner == number]
        found.append(Part(SEGMENTS[number], material, points, faces, normals, own, bones[used], weights[used]))
    return found


def _texture(sheet: _Sheet, owner: np.ndarray, material: str, bare: BareBody, body: Body, *, hangs: bool) -> np.ndarray:
    """Return the (T, 3, 2) texture coordinates of the corners of triangles that belong to segments `owner` (T,).

    Cloth and hair go around the trunk and along it; trousers go around each leg, and shirts around each arm.
    """
    corners = sheet.points[sheet.faces]
    if material in ("iris", "lip"):
        return on_disc(corners[..., 1:])
    if material == "skin":
        uv = np.empty((*corners.shape[:2], 2))
        for number in np.unique(owner):
            uv[owner == number] = _on_skin(corners[owner == number], number, bare)
        return uv
    if material == "shoe":
        uv = np.empty((*corners.shape[:2], 2))
        for side, sign in SIDES.items():
            own, turn = corners[..., 1].mean(1) * sign > 0, bare.rotations[SEGMENTS.index(f"{side}_foot")]
            uv[own] = on_disc((corners[own] @ turn)[..., :2])
        return uv
    if material not in _TALL:
        if material == "hat":
            corners = corners - sheet.points.mean(0)
        trunk = np.hypot(*corners[..., :2].reshape(-1, 2).T)
        around = max(1, round(2 * np.pi * float(np.median(trunk)) / _TILE))
        return np.stack([around * _turns(corners[..., 1], corners[..., 0]), corners[..., 2] / _TILE], -1)
    # A texture goes once around the trunk.
    uv = np.stack([_turns(corners[..., 1], corners[..., 0]), corners[..., 2]], -1)
    for side, sign in SIDES.items():
        if hangs:
            break
        own = corners[..., 1].mean(1) * sign > 0
        if material != "bottom":
            # Between trunk and sleeve the pattern passes from one to the other.
            first = SEGMENTS.index(f"{side}_upper_arm")
            arms = sheet.weights[:, first : first + len(_ARM)].sum(1)[sheet.faces]
            own &= arms.max(1) > _ARMHOLE[0]
            share = np.interp(arms[own], _ARMHOLE, (0, 1))[..., None]
            ahead, along, up = np.moveaxis(_on_limb(corners[own], first, 1, bare), -1, 0)
            of_arm = [sign * (0.25 - _turns(ahead, up) / _around_trunk(body)), bare.origins[first, 2] - sign * along]
            uv[own] += share * (np.stack(of_arm, -1) - uv[own])
            if material == "coat":
                # A repeat higher, where neither belt nor pockets are sewn on.
                uv[own & (arms.mean(1) > 0.5), :, 1] += _TILE
        else:
            first = SEGMENTS.index(f"{side}_thigh")
            own &= np.isin(owner, range(first, first + len(_LEG)))
            ahead, aside, along = np.moveaxis(_on_limb(corners[own], first, 2, bare), -1, 0)
            uv[own] = np.stack([_turns(aside, ahead), along], -1)
    return uv / (1, _TALL[material] * _TILE)


def _around_trunk(body: Body) -> int:
    """Return the number of repeats of a shirt's pattern around the trunk. Around a sleeve there is one."""
    depth, breadth = trunk_sections(body, np.array([0.13]))[0, 2:]
    return max(1, round(np.pi * (depth + breadth + 0.03) / _TILE))


def paint_clothes(body: Body, looks: PersonLooks, texels: int, *, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return the textures of shirt and trousers, (H, W, 3) uint8 RGB, by material: patterns with what is sewn on them.

    They go once around the trunk from the front to the left, and along it from the height of the hip joints upwards.
    `texels` is the side of a repeat of the pattern, px.
    """
    painted = {}
    garments = [
        ("top", looks.top, -0.12, _around_trunk(body)),
        ("bottom", looks.bottom, -1.3, 4 if looks.skirt else 2),
    ]
    if looks.coat:
        garments.append(("coat", looks.coat.cloth, -0.6, _around_trunk(body)))
    for material, garment, low, wide in garments:
        repeat = paint(garment.pattern, garment.colours, texels, rng=rng)
        image = np.tile(repeat.astype(np.float32) / 255, (_TALL[material], wide, 1))
        # The first row is at the least height; the middle column is in front.
        rows, columns = image.shape[:2]
        height = low + (np.arange(rows, dtype=np.float32)[:, None] + 0.5) / texels * _TILE
        turn = (np.arange(columns, dtype=np.float32) + 0.5) / columns - 0.5
        if material == "top":
            _sew_shirt(image, height, turn * wide * _TILE, body, looks, rng=rng)
        elif looks.coat and material == "coat":
            _sew_coat(image, height, turn * wide * _TILE, body, looks.coat)
        else:
            sew = _sew_skirt if looks.skirt else _sew_trousers
            sew(image, height, turn * 0.55 * body.stature, body, looks, rng=rng)
        image = np.roll(image, (round(low / _TILE * texels), -columns // 2), (0, 1))
        painted[material] = (np.clip(image, 0, 1) * 255 + 0.5).astype(np.uint8)
    return painted


def _line(place: np.ndarray, at: float | np.ndarray) -> np.ndarray:
    """Return a thin line at a place, m: 1 in its middle."""
    return np.exp(-(((place - at) / 0.0014) ** 2))


def _sew_shirt(image: np.ndarray, height, aside, body: Body, looks: PersonLooks, *, rng: np.random.Generator) -> None:
    """Add hems, and ribs, buttons or a print on some, to a shirt (H, W, 3), 0..1.

    Heights (H, 1) are above the hip joints, places `aside` (W,) from the middle of the front to the left, m.
    """
    size, kind, chance = body.stature, looks.top.pattern, rng.random()
    upper, fore = (np.abs(body.offsets[SEGMENTS.index(name), 1]) for name in ("l_forearm", "l_hand"))
    shoulder = bare_body(body, looks.hands).origins[SEGMENTS.index("l_upper_arm"), 2]
    hems = [-0.03 * size] * looks.untucked + [shoulder - upper - 0.95 * fore] * looks.top.long
    buttoned = chance < {"checks": 0.7, "plain": 0.25, "melange": 0.25}.get(kind, 0) and (
        looks.top.long or kind == "checks"
    )
    if looks.top.long and not buttoned and chance > 0.5:
        ribs = 0.08 + 0.14 * (np.sin(2 * np.pi * aside / 0.007) > 0)
        image *= (1 - (height < max(hems) + 0.035) * ribs)[..., None]
    for hem in hems:
        image *= 1 - 0.25 * _line(height, hem + 0.02)[..., None]
    bright = np.array((0.88, 0.88, 0.88) if image.mean() < 0.5 else (0.14, 0.14, 0.17), np.float32)
    if buttoned:
        image *= (1 - 0.3 * _line(aside, -0.016) - 0.15 * _line(aside, 0.016))[:, None]
        image[np.hypot((height + 0.03 * size) % 0.085 - 0.045, aside) < 0.0055] = bright
    elif kind in ("plain", "melange") and chance < 0.45:
        wide, up = rng.uniform(0.04, 0.06, 3) * size, height - 0.19 * size
        shape = rng.integers(3)
        if shape == 0:
            outside = np.maximum(np.abs(aside) - wide[0], np.abs(up) - 0.6 * wide[1])
        elif shape == 1:
            outside = np.hypot(aside, up) - 0.85 * wide[0]
        else:
            bars = [np.maximum(np.abs(aside) - wide[k], np.abs(up + (k - 1) * 0.03) - 0.009) for k in range(3)]
            outside = np.min(bars, 0)
        image += 0.85 * np.clip(0.5 - outside / 0.002, 0, 1)[..., None] * (bright - image)


def _sew_trousers(
    image: np.ndarray, height, aside, body: Body, looks: PersonLooks, *, rng: np.random.Generator
) -> None:
    """Add seams, hems, a fly, pockets and, below a shirt within them, a belt to trousers (H, W, 3), 0..1.

    Heights (H, 1) are above the hip joints, m, along legs as well; places `aside` (W,) around the seat or a leg from
    the middle of the front to the left, m as far as around the seat.
    """
    size, (thigh, shin) = body.stature, -body.offsets[[SEGMENTS.index("l_shin"), SEGMENTS.index("l_foot")], 2]
    quarter, band = 0.55 * size / 4, (0.045 if looks.untucked else 0.074) * size - 0.034
    end = -(thigh + 0.98 * shin) if looks.bottom.long else -0.86 * thigh
    # Seams run up both sides. In front and behind, cloth wears lighter.
    image *= (1 - 0.4 * _line(np.abs(aside), quarter) + 0.06 * np.cos(np.pi * aside / quarter))[:, None]
    image *= 1 - 0.25 * _line(height, end + 0.022)[..., None]
    front = np.flatnonzero((height > 0.012 * size) & (height < band))
    slit = 0.35 * _line(np.abs(aside), (0.36 + 4.9 * (band - height[front])) * quarter)
    image[front] *= (1 - slit - 0.3 * _line(aside, 0.012 * size))[..., None]
    if not looks.untucked:
        belt = np.flatnonzero((height > band) & (height < band + 0.031))
        image[belt] = (0.10, 0.09, 0.08) if rng.random() < 0.6 else (0.27, 0.17, 0.10)
        image[belt[0] : belt[-1] + 1, np.abs(aside) < 0.022] = (0.62, 0.60, 0.55)


def _sew_coat(image: np.ndarray, height, aside, body: Body, coat: Coat) -> None:
    """Add a front with buttons, pockets and a belt, where a long one begins to hang, to a coat (H, W, 3), 0..1; see
    `_sew_shirt`."""
    size = body.stature
    if not coat.open:
        image *= (1 - 0.5 * _line(aside, -0.03))[:, None]
        buttons = np.hypot((height + 0.03 * size) % 0.11 - 0.055, aside) < 0.010
        image[buttons & (height < 0.27 * size)] *= 0.4
    for side in SIDES.values():
        slit = (np.abs(height - 0.015 * size) < 0.0035) & (np.abs(aside - side * 0.075 * size) < 0.03 * size)
        image[slit] *= 0.6
    if coat.cloth.long:
        image[np.flatnonzero(np.abs(height - (_COAT[0] - 0.018) * size) < 0.022)] *= 0.7


def _sew_skirt(image: np.ndarray, height, aside, body: Body, looks: PersonLooks, *, rng: np.random.Generator) -> None:
    """Add a waistband, a hem and seams at both sides to a skirt (H, W, 3), 0..1; see `_sew_trousers`."""
    thigh, shin = -body.offsets[[SEGMENTS.index("l_shin"), SEGMENTS.index("l_foot")], 2]
    end = -np.interp(_SKIRTS[looks.bottom.long][0], (1, 2), (thigh, thigh + shin))
    image *= (1 - 0.3 * _line(np.abs(aside), 0.55 * body.stature / 4))[:, None]
    image *= 1 - 0.25 * _line(height, end + 0.022)[..., None]
    band = np.flatnonzero(height > _WAIST * body.stature - 0.035)
    image[band] *= 0.55 if rng.random() < 0.5 else 0.85


def _on_skin(corners: np.ndarray, segment: int, bare: BareBody) -> np.ndarray:
    """Return the (T, 3, 2) texture coordinates of corners (T, 3, 3) of skin."""
    own = (corners - bare.origins[segment]) @ bare.rotations[segment]
    if side_and_name(SEGMENTS[segment])[1] in _ARM:
        return around_limb(2 * np.pi * _turns(own[..., 0], own[..., 2]), own[..., 1])
    angle, along = 2 * np.pi * _turns(own[..., 1], own[..., 0]), own[..., 2]
    if SEGMENTS[segment] != "head":
        return around_limb(angle, along)
    eyes = bare.eyes.mean((0, 1))[2] - bare.origins[segment, 2]
    return around_head(angle, (along - eyes) * (EYES[1] / eyes))


def _turns(across: np.ndarray, ahead: np.ndarray) -> np.ndarray:
    """Return directions (T, 3) in turns, from `ahead` to `across`; within a triangle, less than half a turn apart."""
    turns = np.arctan2(across, ahead) / (2 * np.pi)
    return turns[:, :1] + (turns - turns[:, :1] + 0.5) % 1 - 0.5


def _on_limb(corners: np.ndarray, first: int, axis: int, bare: BareBody) -> np.ndarray:
    """Return corners (T, 3, 3) in a frame that bends with a limb in the bind pose, so that patterns pass its joint.

    `first` is the limb's first segment, `axis` the column of its rotation that is lengthwise.
    """
    upper, lower = bare.rotations[first : first + 2]
    one, other = upper[:, axis], lower[:, axis]
    # The least rotation that turns the first axis into the second.
    cross = np.cross(np.eye(3), np.cross(one, other))
    lower = (np.eye(3) + cross + cross @ cross / (1 + one @ other)) @ upper
    joint = (bare.origins[first + 1] - bare.origins[first]) @ upper
    before = (corners - bare.origins[first]) @ upper
    after = (corners - bare.origins[first + 1]) @ lower
    after[..., axis] += joint[axis]
    share = np.clip(0.5 + (before[..., axis] / joint[axis] - 1) * abs(joint[axis]) / _JOINT, 0, 1)[..., None]
    return before + share * (after - before)
