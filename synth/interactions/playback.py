"""Play a role with a motion: along its path, with its gaze, and with hands that reach."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from synth.interactions.paths import wrapped
from synth.interactions.script import Reach, Role, poses_of
from synth.motion.feet import foot_contacts, lock_feet
from synth.motion.footsteps import step_along
from synth.motion.inverse_kinematics import reach_with_arm
from synth.motion.motion import Motion
from synth.motion.rotations import about
from synth.people.body import Body
from synth.people.segments import SEGMENTS

_PACE = (0.75, 1.3)
"""Least and greatest factor on the speed of a walk to keep up with others."""
_SWING = 0.5
"""Arm swing against the legs, rad per metre of stride."""
_LOOK = np.radians(65)
"""Greatest turn of the head, rad."""
_ARMS = {side: [SEGMENTS.index(f"{side}_{part}") for part in ("upper_arm", "forearm", "hand")] for side in "lr"}
_HEAD, _CHEST, _SPINE = (SEGMENTS.index(name) for name in ("head", "chest", "spine"))


def follow(base: Motion, role: Role, body: Body, *, bend: bool, rng: np.random.Generator) -> Motion:
    """Return a motion along a role's path.

    Args:
        base: The motion, at the body's size.
        role: The role.
        body: The person's body.
        bend: Whether the motion is a walk, and is bent along the path; otherwise new legs step along it.
        rng: Draws the steps.
    """
    return _along(base, role.path, body) if bend else _over_steps(base, role, body, rng=rng)


def heading(rotations: np.ndarray, fps: float) -> np.ndarray:
    """Return the (F,) smoothed and continuous heading of a pelvis, from segments (F, 16, 3, 3), rad."""
    forward = gaussian_filter1d(rotations[:, 0, :2, 0], 0.4 * fps, axis=0, mode="nearest")
    return np.unwrap(np.arctan2(forward[:, 1], forward[:, 0]))


def course(base: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the path of a walk without sway (F, 2), m, the distance walked (F,), m, and the direction (F,), rad."""
    way = gaussian_filter1d(base.root[:, :2], 0.3 * base.fps, axis=0, mode="nearest")
    # The filter slows down at the ends: continue there at the rate from further in.
    edge = min(round(0.9 * base.fps), (len(base) - 1) // 2)
    time = np.arange(len(base))
    if edge > 0:
        for ends, inner, outer in ((time < edge, edge, edge + 1), (time >= len(time) - edge, -edge - 1, -edge - 2)):
            rate = (way[outer] - way[inner]) * (1 if inner > 0 else -1)
            way[ends] = way[inner] + (time[ends] - time[inner])[:, None] * rate
    step = np.gradient(way, axis=0)
    return way, np.cumsum(np.linalg.norm(step, axis=1)), np.unwrap(np.arctan2(step[:, 1], step[:, 0]))


def _along(base: Motion, path: np.ndarray, body: Body) -> Motion:
    """Return a walk bent along a path (F, 3), with the path's middle at half time, at the nearest pace possible."""
    way, along, direction = course(base)
    half = len(base) // 2
    step = np.linalg.norm(np.diff(path[:, :2], axis=0), axis=1)
    planned = np.concatenate([[0], np.cumsum(step)])
    pace = np.clip(planned[-1] / max(along[-1] - along[0], 1e-6), *_PACE)
    travelled = planned[half] + pace * (along - along[half])
    # The path continues straight beyond its ends.
    ends = np.clip(travelled, planned[0], planned[-1])
    line = np.stack([np.interp(ends, planned, column) for column in path.T], axis=1)
    line[:, :2] += (travelled - ends)[:, None] * np.stack([np.cos(line[:, 2]), np.sin(line[:, 2])], 1)
    turn = about("z", gaussian_filter1d(line[:, 2] - direction, 0.2 * base.fps, mode="nearest"))
    root = base.root.copy()
    root[:, :2] = line[:, :2] + np.einsum("fij,fj->fi", turn[:, :2, :2], base.root[:, :2] - way)
    standing = foot_contacts(body, base.root, base.rotations, base.fps, turn=0.0)
    root, rotations = lock_feet(body, root, turn[:, None] @ base.rotations, standing, base.fps)
    return replace(base, root=root, rotations=rotations)


def _over_steps(base: Motion, role: Role, body: Body, *, rng: np.random.Generator) -> Motion:
    """Return the trunk, arms and head of a motion over legs that step along the role's path."""
    footsteps = step_along(body, role.path, base.fps, rng=rng, hips=role.hips, ahead=role.ahead)
    turn = about("z", role.path[:, 2] - heading(base.rotations, base.fps))
    rotations = turn[:, None] @ base.rotations
    if role.lean is not None:
        _bend(rotations, role, base.fps)
    across = np.stack([-np.sin(role.path[:, 2]), np.cos(role.path[:, 2]), 0 * role.path[:, 2]], 1)
    swing = _SWING * gaussian_filter1d(footsteps.stride, 0.08 * base.fps, mode="nearest")
    for side, sign in (("l", 1.0), ("r", -1.0)):
        turned = Rotation.from_rotvec(across * (sign * swing)[:, None]).as_matrix()
        rotations[:, _ARMS[side]] = turned[:, None] @ rotations[:, _ARMS[side]]
    rotations[:, 0] = footsteps.pelvis
    for leg, side in enumerate("lr"):
        for place, name in enumerate(("thigh", "shin", "foot")):
            rotations[:, SEGMENTS.index(f"{side}_{name}")] = footsteps.legs[:, leg, place]
    name = f"{base.name}, over steps"
    return Motion(name, base.fps, footsteps.root, rotations, body.hip_height)


def _bend(rotations: np.ndarray, role: Role, fps: float) -> None:
    """Bend the trunk forward in place, the spine half as much as the chest."""
    across = np.stack([-np.sin(role.path[:, 2]), np.cos(role.path[:, 2]), 0 * role.path[:, 2]], 1)
    for share, segments in ((0.5, [_SPINE]), (1.0, [_CHEST, _HEAD, *_ARMS["l"], *_ARMS["r"]])):
        bent = Rotation.from_rotvec(across * (share * role.lean)[:, None]).as_matrix()
        rotations[:, segments] = bent[:, None] @ rotations[:, segments]


def look_at(motion: Motion, person: int, gaze: np.ndarray, heads: np.ndarray) -> Motion:
    """Return a motion with the head turned to the people that the gaze (F,) names; heads (F, P, 3), m."""
    frames = np.arange(len(motion))
    sight = heads[frames, np.maximum(gaze, 0)] - heads[:, person]
    chest = motion.rotations[:, _CHEST]
    facing = np.arctan2(chest[:, 1, 0], chest[:, 0, 0])
    looking = (gaze >= 0) & (gaze != person)
    yaw = np.clip(wrapped(np.arctan2(sight[:, 1], sight[:, 0]) - facing), -_LOOK, _LOOK)
    pitch = -np.arctan2(sight[:, 2], np.linalg.norm(sight[:, :2], axis=1).clip(0.3))
    head = motion.rotations[:, _HEAD]
    own = np.arctan2(head[:, 1, 0], head[:, 0, 0])
    yaw, pitch = np.where(looking, yaw, wrapped(own - facing)), np.where(looking, np.clip(pitch, -0.4, 0.6), 0)
    yaw, pitch = (gaussian_filter1d(angle, 0.15 * motion.fps, mode="nearest") for angle in (yaw, pitch))
    rotations = motion.rotations.copy()
    rotations[:, _HEAD] = about("z", facing + yaw) @ about("y", pitch)
    return replace(motion, rotations=rotations)


def reach_for(motion: Motion, body: Body, reach: Reach) -> Motion:
    """Return the motion with a reach of an arm, blended over the arm's own motion."""
    poses = poses_of((body,), [motion])
    segments = _ARMS[reach.side]
    chest, shoulder = motion.rotations[:, _CHEST], poses.origins[:, 0, segments[0]]
    target = (reach.palm, reach.normal, reach.elbow)
    arm = reach_with_arm(body, reach.side, chest, shoulder, *target, straight=reach.straight)
    rotations = motion.rotations.copy()
    away = np.einsum("fsji,fsjk->fsik", rotations[:, segments], arm)
    vectors = Rotation.from_matrix(away.reshape(-1, 3, 3)).as_rotvec().reshape(-1, 3, 3)
    part = Rotation.from_rotvec((vectors * reach.share[:, None, None]).reshape(-1, 3)).as_matrix().reshape(away.shape)
    rotations[:, segments] = rotations[:, segments] @ part
    return replace(motion, rotations=rotations)
