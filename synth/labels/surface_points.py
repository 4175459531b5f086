"""256 named points on the visible surface of each person, including clothes and hair."""

import copy
from typing import NamedTuple

import mujoco
import numpy as np

from synth.people.bending import Bending
from synth.people.body import HEAD_HEIGHT, SIDES, Body, side_and_name
from synth.people.segments import PARENTS, SEGMENTS
from synth.rooms.rays import cast_rays
from synth.scene.build import Scene

_TRUNK = ("pelvis", "spine", "chest")
_HAND = 0.092
"""Length of the hand, fraction of stature."""
_FOOT = ((-0.037, 0.0, -0.020), (0.106, 0.0, -0.026))
"""Ends of an axis inside the shoe, relative to the ankle, fractions of stature."""
_RAY_START = 1.0
"""Distance from an axis at which the rays to the surface begin, m."""


class _Rings(NamedTuple):
    """Rings of points around the axis of a segment.

    Attributes:
        directions: Names of the directions around the axis, evenly spaced.
        first: The first direction, in T-pose.
        second: The direction towards which the following ones turn, on the left side of the body.
        shares: Positions of the rings along the axis: 0 at its beginning, 1 at its end.
    """

    directions: tuple[str, ...]
    first: tuple[int, int, int]
    second: tuple[int, int, int]
    shares: tuple[float, ...]


_X, _Y, _Z = np.eye(3, dtype=int).tolist()
_ROUND = ("front", "front_left", "left", "back_left", "back", "back_right", "right", "front_right")
_ARM, _LEG, _SHOE = (
    ("front", "top", "back", "under"),
    ("front", "outer", "back", "inner"),
    ("top", "outer", "sole", "inner"),
)
_RINGS = {
    "pelvis": _Rings(_ROUND, _X, _Y, (-0.2, 0.3, 0.75)),
    "spine": _Rings(_ROUND, _X, _Y, (0.25, 0.7)),
    "chest": _Rings(_ROUND, _X, _Y, (0.1, 0.26, 0.42, 0.58)),
    "head": _Rings(_ROUND, _X, _Y, (0.27, 0.45, 0.63, 0.83)),
    "upper_arm": _Rings(_ARM, _X, _Z, (0.3, 0.48, 0.66, 0.84)),
    "forearm": _Rings(_ARM, _X, _Z, (0.2, 0.5, 0.8)),
    "hand": _Rings(_ARM, _X, _Z, (0.25, 0.5)),
    "thigh": _Rings(_LEG, _X, _Y, (0.3, 0.48, 0.66, 0.84)),
    "shin": _Rings(_LEG, _X, _Y, (0.15, 0.38, 0.61, 0.84)),
    "foot": _Rings(_SHOE, _Z, _Y, (0.5, 0.85)),
}

NAMES = tuple(
    f"{segment}.{ring}.{direction}"
    for segment in SEGMENTS
    for ring in range(1, 1 + len(_RINGS[side_and_name(segment)[1]].shares))
    for direction in _RINGS[side_and_name(segment)[1]].directions
)
"""The 256 names: `<segment>.<ring>.<direction>`. Rings are counted from the joint of the segment, on a foot from its
heel. Directions refer to a person that faces forward, with arms stretched to the sides and palms down: `outer` is away
from the middle, and `under` of a hand is its palm."""


class SurfacePoints(NamedTuple):
    """Points on P people, each fixed to a geom.

    Attributes:
        geoms: (P, 256) index of the geom that each point moves with.
        places: (P, 256, 3) points in the frame of the geom, m.
        normals: (P, 256, 3) outward unit normals in the frame of the geom.
    """

    geoms: np.ndarray
    places: np.ndarray
    normals: np.ndarray

    def at(self, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
        """Return points, m, and normals, (P, 256, 3) each, world. `data` is a state after `Bending` was applied to it.

        See `synth.people.bending.Bending`.
        """
        turns = data.geom_xmat[self.geoms].reshape(*self.geoms.shape, 3, 3)
        points = data.geom_xpos[self.geoms] + (turns @ self.places[..., None])[..., 0]
        return points, (turns @ self.normals[..., None])[..., 0]


def surface_points(scene: Scene, bodies: list[Body]) -> SurfacePoints:
    """Return the points on the people of a scene, where rays towards the axes of their segments meet them in T-pose.

    Args:
        scene: The scene, with people in T-pose.
        bodies: Proportions of P people.

    Raises:
        ValueError: a ray for a point does not meet the surface of the person.
    """
    model = copy.copy(scene.model)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    Bending(model).apply(data)
    found = [_points_of(scene, model, data, person, body) for person, body in enumerate(bodies)]
    return SurfacePoints(*(np.stack(part) for part in zip(*found, strict=True)))


def _points_of(scene: Scene, model: mujoco.MjModel, data: mujoco.MjData, person: int, body: Body) -> tuple:
    """Return the fields of `SurfacePoints` for one person in T-pose."""
    ids = model.body(f"person{person}/{SEGMENTS[0]}").id + np.arange(len(SEGMENTS))
    found = []
    for number, segment in enumerate(SEGMENTS):
        side, name = side_and_name(segment)
        # Cloth between two segments of the trunk may move with either of them.
        own = [SEGMENTS.index(each) for each in _TRUNK] if name in _TRUNK else [number]
        visible = (scene.geom_ids == 1 + person) & np.isin(model.geom_bodyid, ids[own])
        model.geom_group = np.where(visible, 0, 5)
        rings = _RINGS[name]
        start, end = (data.xpos[ids[number]] + point for point in _axis(body, number))
        angles = 2 * np.pi * np.arange(len(rings.directions)) / len(rings.directions)
        second = np.array(rings.second) * (1, SIDES.get(side, 1.0), 1)
        for share in rings.shares:
            for angle in angles:
                outward = np.cos(angle) * np.array(rings.first) + np.sin(angle) * second
                found.append(_meet(model, data, start + share * (end - start), outward))
    geoms, points, normals = (np.array(part) for part in zip(*found, strict=True))
    if (geoms < 0).any():
        raise ValueError(f"person {person} has no surface at {NAMES[int(np.argmin(geoms))]}")
    turns = data.geom_xmat[geoms].reshape(-1, 3, 3).swapaxes(1, 2)
    places = (turns @ (points - data.geom_xpos[geoms])[..., None])[..., 0]
    return geoms, places, (turns @ normals[..., None])[..., 0]


def _axis(body: Body, number: int) -> tuple[np.ndarray, np.ndarray]:
    """Return both ends of the axis of a segment, relative to its joint, in T-pose, m."""
    side, name = side_and_name(SEGMENTS[number])
    if name == "foot":
        return tuple(np.array(end) * body.stature for end in _FOOT)
    if name == "head":
        end = np.array((0, 0, HEAD_HEIGHT * body.head)) * body.stature
    elif name == "hand":
        end = np.array((0, SIDES[side] * _HAND * body.arms, 0)) * body.stature
    else:
        end = body.offsets[PARENTS.index(number)]
    return np.zeros(3), end


def _meet(model: mujoco.MjModel, data: mujoco.MjData, middle: np.ndarray, outward: np.ndarray) -> tuple:
    """Return the geom, point and normal where a ray from outside towards `middle` first meets a surface."""
    geom, distance, normal = cast_rays(model, data, middle + _RAY_START * outward, -outward[None])
    return geom[0], middle + (_RAY_START - distance[0]) * outward, normal[0]
