"""What a rig's cameras can see of the place where people are, and whether they stand where a camera can."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import mujoco
import numpy as np

from dmae.cameras import CameraRig
from dmae.images import FIRST_OBJECT_ID
from synth.quality import FailedSimulation
from synth.visibility import cast

_TALLEST = 2.0
_SECTORS, _RINGS, _LEVELS = 16, 3, 5
_GROUPS = tuple(range(6))
# To the corners, edges and faces of a cube.
_AROUND = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)]) - 1.0
_AROUND /= np.linalg.norm(_AROUND, axis=1, keepdims=True)


@dataclass(frozen=True)
class Stage:
    """Where people are, and what stands about there.

    Attributes:
        radius: How far from the vertical through the origin people stray, m. Their area reaches 2 m up.
        arena: MJCF file of the room; None for open ground.
    """

    radius: float = 1.9
    arena: Path | None = None

    def __str__(self) -> str:
        return f"the people's area (up to {self.radius:g} m from the middle, up to {_TALLEST:g} m high)"


def area(stage: Stage) -> np.ndarray:
    """(R, S, L, 3) corners of cells whose convex hulls together hold the people's area, m: rings, sectors, levels."""
    # Chords cut circles short: a polygon around the circle does not.
    rings = np.linspace(0, stage.radius / np.cos(np.pi / _SECTORS), _RINGS)
    angle = 2 * np.pi * np.arange(_SECTORS) / _SECTORS
    ring, angle, level = np.meshgrid(rings, angle, np.linspace(0, _TALLEST, _LEVELS), indexing="ij")
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), level], -1)


def views_of_cells(rig: CameraRig, stage: Stage) -> np.ndarray:
    """(R - 1, S, L - 1) how many cameras have each cell of `area` whole in their image, walls or no walls.

    A cell counts as whole in an image if its corners are, which is exact for a pinhole, since what it sees is convex.
    """
    corners = area(stage)
    inside = rig.inside(rig.project(corners[None])[0])[0]
    inside &= np.roll(inside, -1, 2)
    inside = inside[:, :-1] & inside[:, 1:]
    return (inside[..., :-1] & inside[..., 1:]).sum(0)


def find_faults(rig: CameraRig, stage: Stage) -> dict[int, str]:
    """What is wrong with where cameras are, by view: under the floor, in a thing of the arena, or seeing nobody."""
    points = area(stage).reshape(-1, 3)
    seen = rig.inside(rig.project(points[None])[0])[0]
    faults = {}
    for view, (name, center) in enumerate(zip(rig.names, rig.centers, strict=True)):
        thing, between = _surroundings(stage.arena, center, points[seen[view]])
        at = ", ".join(f"{x:.2f}" for x in center)
        if center[2] <= 0:
            faults[view] = (
                f"camera {name!r} at ({at}) m is under the floor; move it, or say by rig.up and rig.origin which way "
                "is up in a calibration file's world and where its floor is"
            )
        elif thing:
            faults[view] = f"camera {name!r} at ({at}) m is inside {thing!r} of the arena; move it"
        elif not seen[view].any():
            faults[view] = (
                f"camera {name!r} at ({at}) m sees nobody: its image holds no point of {stage}. Turn or move it; "
                "rig.origin says which point of a calibration file's world is the middle"
            )
        elif between:
            faults[view] = f"camera {name!r} at ({at}) m sees nobody: {between!r} is between it and {stage}"
    return faults


def check_rig(rig: CameraRig, source: str, stage: Stage) -> None:
    """Make sure that every camera can see somebody.

    Args:
        rig: Cameras.
        source: Where they come from, for the message.

    Raises:
        FailedSimulation: a camera is under the floor, within a thing of the arena, or sees nobody; the message names
            camera and thing.
    """
    faults = find_faults(rig, stage)
    if faults:
        raise FailedSimulation(f"{source}: " + "; ".join(faults.values()))


def check_outside(rig: CameraRig, model: mujoco.MjModel, geom_ids: np.ndarray) -> None:
    """Make sure that no camera is within a thing of a scene as it is compiled; people come and go.

    Args:
        rig: Cameras.
        model: The scene.
        geom_ids: (ngeom,) what each geom belongs to, 256 + k for object k.

    Raises:
        FailedSimulation: one is; the message names camera and thing.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for name, center in zip(rig.names, rig.centers, strict=True):
        thing = _around(model, data, center, geom_ids >= FIRST_OBJECT_ID)
        if thing:
            raise FailedSimulation(f"camera {name!r} is inside {thing!r}; move it, or have fewer props")


def _surroundings(arena: Path | None, center: np.ndarray, points: np.ndarray) -> tuple[str | None, str | None]:
    """The thing of the arena a point is in, and the one that hides all of (n, 3) points from it; None for none."""
    if arena is None:
        return None, None
    model, data = _arena(arena, arena.stat().st_mtime_ns)
    thing = _around(model, data, center, np.ones(model.ngeom, bool))
    if thing or not len(points):
        return thing, None
    rays = points - center
    reach = np.linalg.norm(rays, axis=1)
    geom, distance, _ = cast(model, data, center, rays / reach[:, None], _GROUPS)
    # Points of the floor are met by rays to them.
    hidden = (geom >= 0) & (distance < reach - 1e-3)
    return None, _name(model, np.bincount(geom[hidden]).argmax()) if hidden.all() else None


def _around(model: mujoco.MjModel, data: mujoco.MjData, point: np.ndarray, solid: np.ndarray) -> str | None:
    """Name of the thing that a point is in, among the geoms that are (ngeom,) `solid`; None for none."""
    geom, _, outward = cast(model, data, point, _AROUND, _GROUPS)
    # Only from within are surfaces met from behind; planes never are, so rooms may be looked into from outside.
    behind = (geom >= 0) & solid[geom] & (np.einsum("rx,rx->r", outward, _AROUND) > 1e-3)
    return _name(model, geom[behind][0]) if behind.any() else None


def _name(model: mujoco.MjModel, geom: int) -> str:
    geom = model.geom(geom)
    return geom.name or model.body(geom.bodyid[0]).name or f"geom {geom.id}"


@lru_cache(maxsize=8)
def _arena(path: Path, changed: int) -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    return model, data
