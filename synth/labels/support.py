"""Find places where objects that stand still may support people, and solve for the forces there."""

import copy
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.optimize import nnls

from synth.scene.build import Scene

_NEAR = 0.02
"""Greatest gap between a part of a body and an object that supports it, m."""
_GAP, _SPEED = 0.005, 0.3
"""Gap, m, and speed along the surface, m/s, each of which doubles the penalty on a force compared with firm contact."""
_EDGES = 8
"""Number of edges of the pyramid that approximates the friction cone from inside."""
_EVENNESS_WEIGHT = 1e-6
"""Weight of an even distribution of forces, relative to the balance of forces."""
_MOMENT_LENGTH = 3.0
"""Length by which moments are divided to compare them with forces, m. It gives the forces more weight."""


class Places(NamedTuple):
    """K places where people touch, or nearly touch, objects that stand still.

    Attributes:
        frame: (K,) int32 frame, sorted.
        geoms: (K, 2) geom of the person, and geom of the object.
        point: (K, 3) m, world.
        normal: (K, 3) unit vector from the object to the person, world.
        friction: (K,) coefficient.
        gap: (K,) m, below 0 for an overlap.
        speed: (K,) speed of the person's part along the surface, m/s.
    """

    frame: np.ndarray
    geoms: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    friction: np.ndarray
    gap: np.ndarray
    speed: np.ndarray


class SeenStates(NamedTuple):
    """Positions and contacts in the states of a scene.

    Attributes:
        places: (F, nbody, 3) centres of mass of bodies, m, world.
        turns: (F, nbody, 3, 3) orientations of their principal axes.
        sites: (F, nsite, 3) positions of sites, m, world.
        frame: (K,) int32 frame of each pair of geoms that touch, or nearly touch, sorted.
        geoms: (K, 2) indices of the geoms.
        point: (K, 3) m, world.
        normal: (K, 3) unit vector from the first geom to the second, world.
        friction: (K,) coefficient.
        gap: (K,) m, below 0 for an overlap.
    """

    places: np.ndarray
    turns: np.ndarray
    sites: np.ndarray
    frame: np.ndarray
    geoms: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    friction: np.ndarray
    gap: np.ndarray


def look(scene: Scene, qpos: np.ndarray) -> SeenStates:
    """Put a scene into states (F, nq), and record its contacts. Pairs with people count up to a gap of 20 mm."""
    model = copy.copy(scene.model)
    people = scene.geom_persons >= 0
    model.geom_margin[people] = np.maximum(model.geom_margin[people], _NEAR)
    # MuJoCo tests bodies before geoms, with the greatest margin of their geoms.
    np.maximum.at(model.body_margin, model.geom_bodyid[people], _NEAR)
    data, frames = mujoco.MjData(model), len(qpos)
    places, turns = np.empty((frames, model.nbody, 3)), np.empty((frames, model.nbody, 9))
    sites, found = np.empty((frames, model.nsite, 3)), []
    for number, state in enumerate(qpos):
        data.qpos[:] = state
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        places[number], turns[number], sites[number] = data.xipos, data.ximat, data.site_xpos
        contact = data.contact
        found.append(
            (
                np.full(data.ncon, number, np.int32),
                contact.geom.copy(),
                contact.pos.copy(),
                contact.frame[:, :3].copy(),
                contact.friction[:, 0].copy(),
                contact.dist.copy(),
            )
        )
    touching = (np.concatenate(part) for part in zip(*found, strict=True))
    return SeenStates(places, turns.reshape(frames, -1, 3, 3), sites, *touching)


def solve(places: Places, chosen: np.ndarray, centre: np.ndarray, needed: np.ndarray, weight: float) -> np.ndarray:
    """Return the forces (K', 3), N, on a person at some places of a frame that come closest to the needed force.

    The missing force and moment are minimised by least squares. The forces push and stay inside the friction cone. Of
    several equally good distributions the most even one is returned. Firm contacts get more force than places with a
    gap.

    Args:
        places: Places of all frames.
        chosen: (K',) indices of the places.
        centre: (3,) point about which moments are taken, m.
        needed: (6,) needed force, N, and moment, N m.
        weight: Weight of the person, N.
    """
    if not len(chosen):
        return np.zeros((0, 3))
    normal = places.normal[chosen]
    across = np.cross(normal, np.where(np.abs(normal[:, :1]) < 0.8, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle = 2 * np.pi * np.arange(_EDGES) / _EDGES
    around = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * np.cross(normal, across)[:, None]
    edges = normal[:, None] + places.friction[chosen, None, None] * around
    moments = np.cross((places.point[chosen] - centre)[:, None], edges)
    doubt = 1 + (places.gap[chosen].clip(0) / _GAP) ** 2 + (places.speed[chosen] / _SPEED) ** 2
    balance = np.concatenate([edges, moments / _MOMENT_LENGTH], axis=-1).reshape(-1, 6).T
    even = np.diag(np.repeat(np.sqrt(_EVENNESS_WEIGHT * doubt), _EDGES))
    wanted = np.concatenate([needed[:3], needed[3:] / _MOMENT_LENGTH, np.zeros(len(even))]) / weight
    shares, _ = nnls(np.concatenate([balance, even]), wanted)
    return weight * (shares.reshape(-1, _EDGES, 1) * edges).sum(1)
