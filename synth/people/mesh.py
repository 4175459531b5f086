"""Closed surfaces swept along an axis, for limbs, trunks, garments and hair."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import trimesh
from scipy.interpolate import PchipInterpolator

TILE = 0.3
"""Length of cloth that one repeat of a texture covers, m."""


@dataclass(frozen=True)
class Mesh:
    """A textured triangle mesh.

    Attributes:
        vertices: (N, 3) m.
        uv: (N, 2) texture coordinates, 1 per repeat.
        faces: (T, 3) vertex indices, counter-clockwise seen from outside.
        swept: (N, 4) number of each vertex's surface, and the vertex's position when swept. Shading is computed from
            them, so that it does not change as the mesh moves.
        share: Share of the rotation of its segment's joint that the mesh follows: 1 for all of it, less for a piece of
            cloth between the segment and its parent.
    """

    vertices: np.ndarray
    uv: np.ndarray
    faces: np.ndarray
    swept: np.ndarray
    share: float = 1.0

    @cached_property
    def normals(self) -> np.ndarray:
        """(N, 3) unit normals, outward. Vertices of a surface in the same place share one: no seam is visible."""
        places, place = np.unique(np.round(self.swept, 6), axis=0, return_inverse=True)
        return trimesh.Trimesh(places[:, 1:], place[self.faces], process=False).vertex_normals[place]

    def moved(self, offset) -> "Mesh":
        """Return the mesh moved by an offset (3,), m."""
        return replace(self, vertices=self.vertices + offset)

    def pushed(self, offsets: np.ndarray) -> "Mesh":
        """Return the mesh with each vertex moved by its own offset, (N, 3) m; the shading follows."""
        swept = self.swept + np.concatenate([np.zeros((len(offsets), 1)), offsets], axis=1)
        return replace(self, vertices=self.vertices + offsets, swept=swept)

    def scaled(self, factor: float) -> "Mesh":
        """Return the mesh scaled about the origin."""
        return replace(self, vertices=self.vertices * factor)


def merge(*meshes: Mesh) -> Mesh:
    """Merge meshes into one."""
    vertices, uv, swept = (
        np.concatenate([getattr(mesh, field) for mesh in meshes]) for field in ("vertices", "uv", "swept")
    )
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes])
    surfaces = np.cumsum([0] + [mesh.swept[-1, 0] + 1 for mesh in meshes])
    swept[:, 0] += np.repeat(surfaces[:-1], np.diff(starts))
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    return Mesh(vertices, uv, faces, swept)


def loft(
    stations: np.ndarray,
    axes: np.ndarray,
    *,
    ends: tuple[float | None, float | None] = (1.0, 1.0),
    rings: int = 9,
    sides: int = 16,
    squareness: float = 2.0,
    phase: float = 0.0,
    repeats: int | None = None,
) -> Mesh:
    """Return the surface that an ellipse sweeps along an axis.

    Args:
        stations: (S, 5) rows of t, p, q, a, b, m: position along the axis, centre and half widths of the ellipse across
            it; smooth and monotone in between (PCHIP).
        axes: (3, 3) columns are the directions of p, q and t.
        ends: Bulge of the first and the last ellipse into a cap, relative to its smaller half width; 0 closes it flat,
            as a hem; None leaves it open, where another surface continues.
        rings: Number of ellipses along the axis, without caps.
        sides: Number of vertices around the axis.
        squareness: Exponent of the superellipse, 2 for an ellipse.
        phase: Texture coordinate along the axis at t = 0.
        repeats: Number of texture repeats around the axis; by default as many as fit.
    """
    t = stations[:, 0]
    grid = np.linspace(t[0], t[-1], rings)
    p, q, a, b = PchipInterpolator(t, stations[:, 1:])(grid).T
    body = np.stack([grid, p, q, a, b], -1)
    profile = np.concatenate([_cap(body[0], ends[0], -1)[::-1], body, _cap(body[-1], ends[1], 1)])

    angle = np.linspace(0, 2 * np.pi, sides + 1)
    cos, sin = np.cos(angle), np.sin(angle)
    around = [np.sign(wave) * np.abs(wave) ** (2 / squareness) for wave in (cos, sin)]
    height, centre_p, centre_q, half_p, half_q = profile.T[..., None]
    local = np.stack(
        np.broadcast_arrays(centre_p + half_p * around[0], centre_q + half_q * around[1], height), -1
    )  # (R, sides + 1, 3)
    repeats = repeats or max(1, round(2 * np.pi * float(max(a.max(), b.max())) / TILE))
    uv = np.stack(np.broadcast_arrays(angle / (2 * np.pi) * repeats, (height + phase) / TILE), -1)
    return _surface(local @ np.asarray(axes).T, uv, inverted=bool(np.linalg.det(axes) < 0))


def _cap(end: np.ndarray, bulge: float | None, direction: int) -> np.ndarray:
    """Return rings (C, 5) that close an ellipse by half an ellipsoid or, without bulge, flat; nearest first."""
    if bulge is None:
        return np.empty((0, 5))
    angle = np.radians((32.0, 60.0, 80.0, 90.0))
    # A ring just inside a flat rim keeps the rim's shading sharp; a pole of zero size would make empty triangles.
    shrink = np.maximum(np.cos(angle), 1e-3) if bulge else np.array([0.97, 1e-3])
    cap = np.repeat(end[None], len(shrink), axis=0)
    if bulge:
        cap[:, 0] += direction * bulge * min(end[3], end[4]) * np.sin(angle)
    cap[:, 3:] *= shrink[:, None]
    return cap


def _surface(points: np.ndarray, uv: np.ndarray, *, inverted: bool) -> Mesh:
    """Return triangles between neighbours in a grid of points (R, C, 3), the last column repeating the first."""
    index = np.arange(points.shape[0] * points.shape[1]).reshape(points.shape[:2])
    low, high, low_next, high_next = index[:-1, :-1], index[1:, :-1], index[:-1, 1:], index[1:, 1:]
    triangles = [np.stack(three, -1).reshape(-1, 3) for three in ((low, low_next, high_next), (low, high_next, high))]
    faces, vertices = np.concatenate(triangles), points.reshape(-1, 3)
    faces = faces[:, ::-1] if inverted else faces
    one, two, three = vertices[faces.T]
    (ax, ay, az), (bx, by, bz) = (two - one).T, (three - one).T
    # Written out because numpy's cross and norm take longer than the rest of this function.
    double_area = np.sqrt((ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2)
    swept = np.concatenate([np.zeros((len(vertices), 1)), vertices], axis=1)
    return Mesh(vertices, uv.reshape(-1, 2), faces[double_area > 2e-10], swept)


def dome(semi_axes, towards, cut: float, *, rings: int = 10, sides: int = 24) -> Mesh:
    """Return the part of an ellipsoid beyond a plane, closed flat: a cap of hair with a clean rim.

    Args:
        semi_axes: (3,) of the ellipsoid, m, along x, y, z; its centre is the origin.
        towards: (3,) normal of the plane in coordinates in which the ellipsoid is a unit sphere.
        cut: Distance of the plane from the centre in those coordinates, -1..1.
        rings: Rings from rim to pole.
        sides: Vertices around.
    """
    direction = np.asarray(towards, float) / np.linalg.norm(towards)
    side = np.cross((0.0, 1.0, 0.0), direction)
    side /= np.linalg.norm(side)
    across = np.cross(direction, side)
    polar = np.linspace(np.arccos(cut), 2e-3, rings)
    height = np.concatenate([np.cos(polar[[0, 0]]), np.cos(polar)])
    radius = np.concatenate([(2e-3, 0.97 * np.sin(polar[0])), np.sin(polar)])
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    ring = np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * across
    unit = radius[:, None, None] * ring + height[:, None, None] * direction
    points = unit * np.asarray(semi_axes)
    return _surface(points, points[..., 1:] / TILE, inverted=False)
