"""Compute how cameras cover the people's area, and find cameras at impossible places."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.images import FIRST_OBJECT_ID
from dmae.files.contents import cached_until_changed
from synth.errors import FailedSimulation
from synth.rooms.rays import EVERY_GROUP, at_rest, cast_rays, geom_around
from synth.rooms.room import compile_mjcf

_TALLEST = 2.0
"""Height of the people's area, m."""
_PERSON, _LEAST_PX = 1.7, 10.0
"""Height of a person, m, and the least height of the nearest one in an image, px."""
_LEAST_SHARE = 0.12
"""A person in the middle who is usually taller than this share of an image, and lower than ten times as much, is of
plausible size. Of units that differ by factors of ten one fits at most."""
_SECTORS, _RINGS, _LEVELS = 16, 3, 5
_GREATEST_CONDITION = 1e3
"""Greatest condition number of the system for the point where the cameras' axes meet. Above it the axes count as
parallel, and there is no such point."""


@dataclass(frozen=True)
class Stage:
    """The people's area, and the room around it."""

    radius: float = 1.9  # Greatest distance of people from the vertical through the origin, m. Their area is 2 m high.
    arena: Path | None = None  # MJCF file of the room; None for open ground

    def __str__(self) -> str:
        return f"the people's area (up to {self.radius:g} m from the middle, up to {_TALLEST:g} m high)"


def stage_of(arena: Path, middle: Sequence[float] | np.ndarray, radius: float) -> Stage:
    """Return the stage of people within a radius of `middle`, x and y, in a room, m.

    Cameras look at the origin, so the area is the circle around the origin that contains the people.
    """
    return Stage(radius + float(np.hypot(*middle)), arena)


def area(stage: Stage) -> np.ndarray:
    """Return the (R, S, L, 3) corners of cells, m: R rings, S sectors, L levels. They cover the area."""
    # The polygon is circumscribed about the circle, so it contains the circle.
    rings = np.linspace(0, stage.radius / np.cos(np.pi / _SECTORS), _RINGS)
    angle = 2 * np.pi * np.arange(_SECTORS) / _SECTORS
    ring, angle, level = np.meshgrid(rings, angle, np.linspace(0, _TALLEST, _LEVELS), indexing="ij")
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), level], -1)


def views_of_cells(rig: CameraRig, stage: Stage) -> np.ndarray:
    """Return the (R - 1, S, L - 1) number of cameras with each whole cell of `area` in their image. Ignores walls.

    A cell counts as in the image if all its corners are. This is exact for a pinhole, because its view is convex.
    """
    corners = area(stage)
    inside = rig.inside(rig.project(corners[None])[0])[0]
    inside &= np.roll(inside, -1, 2)
    inside = inside[:, :-1] & inside[:, 1:]
    return (inside[..., :-1] & inside[..., 1:]).sum(0)


def find_faults(rig: CameraRig, stage: Stage) -> dict[int, str]:
    """Return faults by view: a camera under the floor, inside an object of the room, or without a view of people."""
    points = area(stage).reshape(-1, 3)
    seen = rig.inside(rig.project(points[None])[0])[0]
    faults = {}
    for view, (name, center) in enumerate(zip(rig.names, rig.centers, strict=True)):
        inside, between = _surroundings(stage.arena, center, points[seen[view]])
        at = ", ".join(f"{x:.2f}" for x in center)
        if center[2] <= 0:
            faults[view] = (
                f"camera {name!r} at ({at}) m is under the floor; move it, or set rig.up and rig.origin to the up "
                "direction and the floor of a calibration file's world"
            )
        elif inside:
            faults[view] = f"camera {name!r} at ({at}) m is inside {inside!r} of the arena; move it"
        elif not seen[view].any():
            faults[view] = (
                f"camera {name!r} at ({at}) m sees no people: its image holds no point of {stage}; turn or move it"
            )
        elif between:
            faults[view] = f"camera {name!r} at ({at}) m sees no people: {between!r} is between it and {stage}"
    return faults


class TinyPeople(ValueError):
    """People are a few pixels tall in a camera, as where lengths are not in metres."""


def check_rig(rig: CameraRig, source: str, stage: Stage, origin: Sequence[float] | None = None) -> None:
    """Check that every camera is at a possible place, sees some of the people's area, and is near enough.

    `origin` is `rig.origin`, m, for cameras that are given in another world.

    Raises FailedSimulation if a camera is under the floor, inside an object of the room, or sees no people; the message
    names the camera and the object, and the point where the cameras' axes meet. Raises TinyPeople if people are a few
    pixels tall.
    """
    reach = np.linalg.norm(area(stage).reshape(-1, 3) - rig.centers[:, None], axis=-1).min(1)
    for name, size, away in zip(rig.names, _PERSON * rig.K[:, 1, 1], reach, strict=True):
        if size < _LEAST_PX * away:
            raise TinyPeople(
                f"{source}: in camera {name!r} people are at most {size / away:.1f} px tall; move it nearer, or raise "
                "its focal length; lengths of rigs are in metres"
            )
    faults = find_faults(rig, stage)
    if not faults:
        return
    hint, meeting = "", None if origin is None else meeting_point(rig)
    if origin is not None and meeting is not None and np.hypot(*meeting[:2]) > stage.radius:
        x, y, z = meeting + origin
        hint = (
            f". The cameras' axes meet at about ({x:.2f}, {y:.2f}, {z:.2f}) m of the rig's world, and people are "
            f"around rig.origin={list(map(float, origin))}: set rig.origin=[{x:.2f},{y:.2f},{float(origin[2]):g}]"
        )
    raise FailedSimulation(f"{source}: " + "; ".join(faults.values()) + hint)


def shows_people(rig: CameraRig) -> bool:
    """Return whether people in the middle have a usual size in the images."""
    shares = _PERSON * rig.K[:, 1, 1] / (np.linalg.norm(rig.centers, axis=1) * rig.size[:, 1])
    return bool(_LEAST_SHARE <= np.median(shares) < 10 * _LEAST_SHARE)


def meeting_point(rig: CameraRig) -> np.ndarray | None:
    """Return the (3,) point nearest to the optical axes of all cameras (least squares), m; None for parallel axes."""
    axes = rig.cam_from_world[:, 2, :3]
    across = np.eye(3) - axes[:, :, None] * axes[:, None]
    normal = across.sum(0)
    if np.linalg.cond(normal) > _GREATEST_CONDITION:
        return None
    return np.linalg.solve(normal, np.einsum("vij,vj->i", across, rig.centers))


def check_outside(rig: CameraRig, model: mujoco.MjModel, geom_ids: np.ndarray) -> None:
    """Raise FailedSimulation if a camera is inside an object, given the scene and the ids (ngeom,) of its geoms."""
    data = at_rest(model)
    for name, center in zip(rig.names, rig.centers, strict=True):
        inside = geom_around(model, data, center, geom_ids >= FIRST_OBJECT_ID)
        if inside >= 0:
            raise FailedSimulation(f"camera {name!r} is inside {_name(model, inside)!r}; move it, or have fewer props")


def _surroundings(arena: Path | None, center: np.ndarray, points: np.ndarray) -> tuple[str | None, str | None]:
    """Return the object of the room around a camera centre, and one that hides all (n, 3) points from it; or None."""
    if arena is None:
        return None, None
    model, data = _arena(arena)
    if (inside := geom_around(model, data, center)) >= 0:
        return _name(model, inside), None
    if not len(points):
        return None, None
    rays = points - center
    reach = np.linalg.norm(rays, axis=1)
    geom, distance, _ = cast_rays(model, data, center, rays / reach[:, None], EVERY_GROUP)
    # A ray to a point on the floor ends at the floor: that point is not hidden.
    hidden = (geom >= 0) & (distance < reach - 1e-3)
    return None, _name(model, int(np.bincount(geom[hidden]).argmax())) if hidden.all() else None


def _name(model: mujoco.MjModel, number: int) -> str:
    geom = model.geom(number)
    return geom.name or model.body(geom.bodyid[0]).name or f"geom {number}"


@cached_until_changed(8)
def _arena(path: Path) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = compile_mjcf(path)
    return model, at_rest(model)
