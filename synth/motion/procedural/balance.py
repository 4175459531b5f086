"""Perform an action on the spot in balance: the centre of mass stays over the feet that bear the weight."""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from synth.motion.easing import smoothstep
from synth.motion.procedural.gait import rolled
from synth.motion.procedural.legs import ANKLE, SHIN, SIDES, THIGH, Stance, hip_joints, knee_directions
from synth.motion.procedural.pose_offsets import Action, PoseOffsets
from synth.motion.procedural.trajectory import BodyTrajectory
from synth.motion.rotations import about

_PRESSURE_CENTRE = 0.045
"""Distance ahead of the ankle at which a foot bears weight, m."""
_SETTLING = 0.3
"""Time over which the balance correction fades in and out, s."""


def perform_on_the_spot(
    action: Action, times: np.ndarray, stance: Stance, ease: np.ndarray, fps: float
) -> BodyTrajectory:
    """Return the trajectory of an action in the world.

    The hips move so that the centre of mass is over the feet that bear the weight, as in any slow motion.

    Args:
        action: The action.
        times: (F,) times since it began, s, evenly spaced.
        stance: Stance in which it begins and ends.
        ease: (F, 2, 5) angles of arms at ease, as `upper_body.HANGING`.
        fps: Frames per second.
    """
    offsets = action.offsets(times)
    heading = stance.middle[2]
    forward, left = np.array((np.cos(heading), np.sin(heading), 0)), np.array((-np.sin(heading), np.cos(heading), 0))
    frame = np.stack([forward, left, (0, 0, 1)])
    turn, front, right = offsets.pelvis.T
    pelvis = about("z", heading + turn) @ about("y", front) @ about("x", right)
    yaw = stance.feet[:, 2] + offsets.feet[..., 3]
    pitch = offsets.feet[..., 4] + offsets.air * (offsets.leg[..., 0] - offsets.leg[..., 2] + offsets.leg[..., 3])
    feet = about("z", yaw) @ about("y", -pitch)
    # On the floor a foot rolls over heel or tip.
    ahead, up = rolled(pitch)
    standing = offsets.feet[..., :3] @ frame
    standing[..., :2] += stance.feet[:, :2] + (1 - offsets.air)[..., None] * ahead[..., None] * feet[..., :2, 0]
    standing[..., 2] += ANKLE
    root = stance.root + offsets.hips @ frame
    trajectory = BodyTrajectory(
        root=root,
        pelvis=pelvis,
        ankles=_ankles(offsets, root, pelvis, heading, standing, up),
        feet=feet,
        knees=_knees(offsets, pelvis, feet, heading),
        chest=offsets.chest + (heading, 0, 0),
        head=offsets.head + (heading, 0),
        arms=ease + offsets.raised[..., None] * (offsets.arms - ease),
    )
    lifted = np.maximum(smoothstep(offsets.air / 0.3), smoothstep(offsets.feet[..., 2] / 0.02))
    weight = gaussian_filter1d(1.001 - lifted, 0.14 * fps, axis=0, mode="nearest")
    middles = standing[..., :2] + _PRESSURE_CENTRE * np.stack([np.cos(yaw), np.sin(yaw)], -1)
    support = (middles * weight[..., None]).sum(1) / weight.sum(1, keepdims=True)
    rest = _offset_at_rest(stance, ease)
    free = (1 - offsets.supported) * smoothstep(times / _SETTLING) * smoothstep((action.seconds - times) / _SETTLING)
    for _ in range(3):
        # The offset of the centre of mass from the support stays the same as in standing at ease.
        off = support - trajectory.centre_of_mass()[:, :2] - rest
        off = gaussian_filter1d(off, 0.06 * fps, axis=0, mode="nearest")
        root = trajectory.root.copy()
        root[:, :2] += free[:, None] * off
        ankles = _ankles(offsets, root, pelvis, heading, standing, up)
        trajectory = replace(trajectory, root=root, ankles=ankles)
    return trajectory


def _ankles(offsets: PoseOffsets, root, pelvis, heading: float, standing: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return the ankles, (F, 2, 3) m: blended between a standing foot and a leg in the air, never below the floor."""
    hips = hip_joints(root, pelvis)
    facing = heading + offsets.pelvis[:, 0]
    ankles = np.empty_like(standing)
    for leg, (_, sign) in enumerate(SIDES):
        thigh, outward, knee, _ = offsets.leg[:, leg].T
        swing = about("z", facing) @ about("x", sign * outward)
        ahead = THIGH * np.sin(thigh) + SHIN * np.sin(thigh - knee)
        down = THIGH * np.cos(thigh) + SHIN * np.cos(thigh - knee)
        hanging = (swing @ np.stack([ahead, np.zeros_like(ahead), -down], -1)[..., None])[..., 0]
        share = offsets.air[:, leg, None]
        ankles[:, leg] = (1 - share) * standing[:, leg] + share * (hips[:, leg] + hanging)
    low = up - ankles[..., 2]
    ankles[..., 2] += np.where(low > -0.05, np.maximum(low, 0), 0)
    return ankles


def _knees(offsets: PoseOffsets, pelvis: np.ndarray, feet: np.ndarray, heading: float) -> np.ndarray:
    """Return knee directions, (F, 2, 3): over the feet, or perpendicular to the thigh for a leg in the air."""
    thigh, facing = offsets.leg[..., 0], (heading + offsets.pelvis[:, 0])[:, None]
    square = np.stack([np.cos(thigh) * np.cos(facing), np.cos(thigh) * np.sin(facing), np.sin(thigh)], -1)
    share = offsets.air[..., None]
    return (1 - share) * knee_directions(pelvis, feet) + share * square


def _offset_at_rest(stance: Stance, ease: np.ndarray) -> np.ndarray:
    """Return the horizontal offset from the centre of mass to the support in standing at ease, (F, 2) m."""
    frames, heading = len(ease), stance.middle[2]
    yaw = stance.feet[:, 2]
    pelvis, feet = about("z", np.full(frames, heading)), np.tile(about("z", yaw), (frames, 1, 1, 1))
    trajectory = BodyTrajectory(
        root=np.tile(stance.root, (frames, 1)),
        pelvis=pelvis,
        ankles=np.tile(np.column_stack([stance.feet[:, :2], np.full(2, ANKLE)]), (frames, 1, 1)),
        feet=feet,
        knees=knee_directions(pelvis, feet),
        chest=np.tile((heading, 0, 0), (frames, 1)),
        head=np.tile((heading, 0), (frames, 1)),
        arms=ease,
    )
    middle = (stance.feet[:, :2] + _PRESSURE_CENTRE * np.stack([np.cos(yaw), np.sin(yaw)], -1)).mean(0)
    return middle - trajectory.centre_of_mass()[:, :2]
