"""Where people may lean on what stands still, and the forces there that carry their motion."""

import copy
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.optimize import nnls

from synth.scene.build import Scene

_NEAR = 0.02
"""Greatest gap between a part of a body and what carries it, m."""
_GAP, _SPEED = 0.005, 0.3
"""Gap, m, and speed along the surface, m/s, at which a place is half as likely to carry as one in firm contact."""
_EDGES = 8
"""Edges of the pyramid within the cone of friction."""
_EVENLY = 1e-6
"""Weight of an even distribution, relative to the balance of forces."""
_ARM = 3.0
"""Lever by which moments are made comparable with forces, m: forces are met first."""


class Places(NamedTuple):
    """Where people touch, or nearly touch, what stands still.

    Attributes:
        frame: (K,) int32 frame, sorted.
        geoms: (K, 2) the person's geom, and that of the other thing.
        point: (K, 3) m, world.
        normal: (K, 3) unit, from the thing to the person.
        friction: (K,) coefficient.
        gap: (K,) m, below 0 for an overlap.
        speed: (K,) m/s of the person's part along the surface.
    """

    frame: np.ndarray
    geoms: np.ndarray
    point: np.ndarray
    normal: np.ndarray
    friction: np.ndarray
    gap: np.ndarray
    speed: np.ndarray


class SeenStates(NamedTuple):
    """What the states of a scene show.

    Attributes:
        places: (F, nbody, 3) centres of mass of bodies, m, world.
        turns: (F, nbody, 3, 3) orientations of their principal axes.
        sites: (F, nsite, 3) m, world.
        frame: (K,) int32 frame of each pair of geoms that touch, or nearly touch, sorted.
        geoms: (K, 2) indices.
        point: (K, 3) m, world.
        normal: (K, 3) unit, from the first geom to the second.
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
    """Put a scene into states (F, nq), and record what touches. Contacts of people are found from 20 mm apart."""
    model = copy.copy(scene.model)
    people = scene.geom_persons >= 0
    model.geom_margin[people] = np.maximum(model.geom_margin[people], _NEAR)
    # The engine looks at bodies first, with the greatest margin of their geoms.
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
    """Return forces (K', 3), N, on a person at some places of a frame, such that they come near to what is needed.

    Least squares of what is missing in force and moment, with forces that push and stay within the cone of friction.
    Where several distributions do as well, the most even one is taken; firm contacts take more than places nearby.

    Args:
        places: Of all frames.
        chosen: (K',) indices of the places.
        centre: (3,) point about which moments are taken, m.
        needed: (6,) force, N, and moment, N m.
        weight: Of the person, N.
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
    balance = np.concatenate([edges, moments / _ARM], axis=-1).reshape(-1, 6).T
    even = np.diag(np.repeat(np.sqrt(_EVENLY * doubt), _EDGES))
    wanted = np.concatenate([needed[:3], needed[3:] / _ARM, np.zeros(len(even))]) / weight
    shares, _ = nnls(np.concatenate([balance, even]), wanted)
    return weight * (shares.reshape(-1, _EDGES, 1) * edges).sum(1)
