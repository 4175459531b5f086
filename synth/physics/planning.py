"""Plan how people move before the physics: within joint limits, with feet on the floor, around each other."""

from typing import NamedTuple

import numpy as np

from synth.motion.feet import foot_contacts, lock_feet, weight_on_feet
from synth.motion.motion import Motion
from synth.motion.path_planning import avoid_collisions
from synth.motion.source import PROCEDURAL
from synth.people.body import Body
from synth.people.joint_limits import limit_joints
from synth.physics.leg_clearance import leg_clearance, limb_points
from synth.scene.spec import PLAN_FPS, SceneSpec

_ROUNDS = 12
"""Greatest number of rounds of leg clearance."""


class PlannedMotion(NamedTuple):
    """The motion of all people that the physics follows.

    Attributes:
        root: (F, P, 3) hips, m.
        rotations: (F, P, 16, 3, 3) orientation of each of `SEGMENTS`, world.
        bearing: (F, P, 2) shares of the weight on the left and the right foot.
        beyond: Share of joints, over all frames, that exceeded their limits before they were limited.
    """

    root: np.ndarray
    rotations: np.ndarray
    bearing: np.ndarray
    beyond: float


def plan_motions(spec: SceneSpec, motions: list[Motion], obstacles: np.ndarray) -> PlannedMotion:
    """Plan how people move: within their joints' limits, around each other and around obstacles.

    Args:
        spec: The scene, P people.
        motions: One for each person, of F frames, in place.
        obstacles: (K, 3) x, y and radius of obstacles, m.
    """
    root = np.stack([motion.root for motion in motions], axis=1)
    recorded = spec.motion.kind != PROCEDURAL
    rotations, beyond = limit_joints(
        np.stack([motion.rotations for motion in motions], axis=1), PLAN_FPS if recorded else None
    )
    standing = [
        foot_contacts(person.body, root[:, p], rotations[:, p], PLAN_FPS, turn=person.turn, recorded=recorded)
        for p, person in enumerate(spec.persons)
    ]
    root[..., :2] += avoid_collisions(root[..., :2], PLAN_FPS, clearance=spec.clearance, obstacles=obstacles)
    bodies = [person.body for person in spec.persons]
    locked = _lock_feet(bodies, root, rotations, standing, PLAN_FPS, recorded=recorded)
    if recorded and not spec.interaction.together:
        # The feet of procedural people stay below the body, and a script sets the distances between its people.
        for _ in range(_ROUNDS):
            limbs = np.stack([limb_points(body, *(a[:, p] for a in locked)) for p, body in enumerate(bodies)], axis=1)
            shift = leg_clearance(limbs, PLAN_FPS, obstacles)
            if not shift.any():
                break
            root[..., :2] += shift
            locked = _lock_feet(bodies, root, rotations, standing, PLAN_FPS, recorded=recorded)
    weight = [weight_on_feet(body, *(a[:, p] for a in locked), standing[p], PLAN_FPS) for p, body in enumerate(bodies)]
    return PlannedMotion(*locked, np.stack(weight, axis=1), beyond)


def _lock_feet(
    bodies: list[Body],
    root: np.ndarray,
    rotations: np.ndarray,
    standing: list[np.ndarray],
    fps: float,
    *,
    recorded: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the results of `lock_feet` for each person, stacked along P."""
    locked = [
        lock_feet(body, root[:, p], rotations[:, p], standing[p], fps, recorded=recorded)
        for p, body in enumerate(bodies)
    ]
    return tuple(np.stack(part, axis=1) for part in zip(*locked, strict=True))
