"""Plan how people move before the physics: within joint limits, feet on the floor, legs and people apart."""

from typing import NamedTuple

import numpy as np

from synth.motion.config import PROCEDURAL
from synth.motion.feet import foot_contacts, lock_feet, sole_points, weight_on_feet
from synth.motion.motion import Motion, avoid_collisions, ramp_around
from synth.people.body import SEGMENTS, Body, segment_origins
from synth.people.joint_limits import limit_joints
from synth.scene.spec import PLAN_FPS, SceneSpec

_HIPS, _KNEES, _ANKLES = ([SEGMENTS.index(f"{side}_{part}") for side in "lr"] for part in ("thigh", "shin", "foot"))
_TRUNK = [SEGMENTS.index(name) for name in ("pelvis", "chest", "head")]
_RADII = np.repeat((0.07, 0.06, 0.05, 0.15), (2, 4, 6, 3))
"""Radii around the points of `limb_points`: thighs, knees and ankles, shins and soles, trunk, m."""
_TRUNKS = slice(-len(_TRUNK), None)
_GAP = 0.08
"""Distance that is left between the limbs of two people, m."""
_DIRECTIONS = np.stack([f(np.arange(16) * np.pi / 8) for f in (np.cos, np.sin)], axis=1)
_FARTHEST = 0.3
"""Longest sidestep of a round, m."""


def limb_points(body: Body, root: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """Return (F, 15, 3) points on the legs and the trunk of a person that keep clear of other people's points, m.

    Args:
        root: (F, 3) hips, m.
        rotations: (F, 16, 3, 3) orientation of each of `SEGMENTS`.
    """
    origins = segment_origins(body, root, rotations)
    hips, knees, ankles = (origins[:, joints] for joints in (_HIPS, _KNEES, _ANKLES))
    feet = sole_points(body, root, rotations).reshape(len(root), 4, 3)
    legs = [(hips + knees) / 2, knees, ankles, (knees + ankles) / 2, feet]
    return np.concatenate([*legs, origins[:, _TRUNK]], axis=1)


def leg_clearance(limbs: np.ndarray, fps: float, obstacles: np.ndarray) -> np.ndarray:
    """Return sidesteps that add missing clearance of legs, as far as one round can.

    Args:
        limbs: (F, P, 15, 3) `limb_points`, m.
        obstacles: (K, 3) x, y and radius of obstacles, m.

    Returns:
        (F, P, 2) shift of each path, m; zero if all legs are clear.
    """
    frames, persons = limbs.shape[:2]
    shift = np.zeros((frames, persons, 2))
    for one in range(persons):
        for other in range(one + 1, persons):
            apart = limbs[:, one, :, None] - limbs[:, other, None]
            missing = _RADII[:, None] + _RADII + _GAP - np.linalg.norm(apart, axis=-1)
            # The distance of trunks follows from the clearance of hips.
            missing[:, _TRUNKS, _TRUNKS] = -np.inf
            step = _sidestep(apart, missing, fps)
            shift[:, one] += step / 2
            shift[:, other] -= step / 2
        legs = limbs[:, one, : _TRUNKS.start]
        away = legs[:, :, None, :2] - obstacles[:, :2]
        room = _RADII[: _TRUNKS.start, None] + obstacles[:, 2]
        shift[:, one] += _sidestep(np.insert(away, 2, 0.0, axis=-1), room - np.linalg.norm(away, axis=-1), fps)
    return shift


def _sidestep(apart: np.ndarray, missing: np.ndarray, fps: float) -> np.ndarray:
    """Return the shortest smooth displacement, (F, 2) m, of vectors `apart` (F, n, m, 3) that lack `missing` (F, n, m),
    m."""
    most = missing.max((1, 2), initial=-np.inf)
    worst = int(most.argmax())
    if not most[worst] > 0.005:
        return np.zeros((len(most), 2))
    run, ramp = ramp_around(most > 0, worst, fps)
    lacks = missing[run] > 0
    vectors = apart[run][lacks]
    room = np.linalg.norm(vectors, axis=-1) + missing[run][lacks]
    along = vectors[:, :2] @ _DIRECTIONS.T
    across = (vectors**2).sum(-1)[:, None] - along**2
    needed = (np.sqrt(np.maximum(room[:, None] ** 2 - across, 0)) - along).max(0)
    best = int(needed.argmin())
    return min(needed[best] + 0.005, _FARTHEST) * ramp[:, None] * _DIRECTIONS[best]


# The plan

_ROUNDS = 12
"""Greatest number of rounds of leg clearance."""


class PlannedMotion(NamedTuple):
    """The motion of all people that the physics follows."""

    root: np.ndarray  # (F, P, 3) hips, m
    rotations: np.ndarray  # (F, P, 16, 3, 3) orientation of each of `SEGMENTS`, world
    bearing: np.ndarray  # (F, P, 2) shares of the weight on the left and the right foot
    beyond: float  # Share of joints, over all frames, that exceeded their limits before they were limited


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

    def with_locked_feet() -> tuple[np.ndarray, np.ndarray]:
        each = [
            lock_feet(body, root[:, p], rotations[:, p], standing[p], PLAN_FPS, recorded=recorded)
            for p, body in enumerate(bodies)
        ]
        roots, turns = (np.stack(part, axis=1) for part in zip(*each, strict=True))
        return roots, turns

    locked = with_locked_feet()
    if recorded and not spec.interaction.together:
        # The feet of procedural people stay below the body, and a script sets the distances between its people.
        for _ in range(_ROUNDS):
            limbs = np.stack([limb_points(body, *(a[:, p] for a in locked)) for p, body in enumerate(bodies)], axis=1)
            shift = leg_clearance(limbs, PLAN_FPS, obstacles)
            if not shift.any():
                break
            root[..., :2] += shift
            locked = with_locked_feet()
    roots, turns = locked
    weight = [weight_on_feet(body, roots[:, p], turns[:, p], standing[p], PLAN_FPS) for p, body in enumerate(bodies)]
    return PlannedMotion(roots, turns, np.stack(weight, axis=1), beyond)
