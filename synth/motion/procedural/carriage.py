"""The posture of each person, and balance: the centre of mass stays over the feet that bear the weight.

Sizes and frequencies are chosen so that angles, speeds and accelerations are as close as possible to the takes of the
CMU Graphics Lab Motion Capture Database (free for research and commercial use), as `synth compare by=motion` measures
them. No recorded motion is played.
"""

from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter1d

from synth.motion.geometry import about, forwards, smoothstep
from synth.motion.procedural.actions import Action, PoseOffsets
from synth.motion.procedural.gait import rolled
from synth.motion.procedural.trajectory import (
    ANKLE,
    HIP_HEIGHT,
    SHIN,
    SIDES,
    THIGH,
    BodyTrajectory,
    Stance,
    hip_joints,
    knee_directions,
    random_drift,
)

_DEEPEST = 0.09
"""Greatest drop of the hips by which knees stay bent in standing, m."""
_WALKING = 0.35
"""Share of this drop, and of the sway, that remains in walking."""
_LOW, _HIGH = 0.78, 0.93
"""Hip heights, as shares of the standing height, between which the drop sets in; it does not apply in sitting."""
# Root mean square of each drift, m or degrees, and its greatest frequency, Hz.
_SWAY, _BOUNCE, _HEELS = (0.010, 0.9), (0.015, 1.2), (6.5, 0.8)
_PELVIS = ((2.5, 0.6), (2.0, 0.6), (3.0, 0.6))
_CHEST = ((3.0, 0.6), (2.5, 0.7), (2.5, 0.7))
_HEAD = ((16.0, 0.5), (7.0, 0.5))
_ARMS = ((6.0, 1.0), (4.0, 1.0), (6.0, 0.8), (11.0, 1.3), (6.0, 0.8))
"""Drifts of the turns about each axis, or of the angles of an arm as in `HANGING`: degrees, Hz."""
_COUNTER = 0.10
"""Distance by which hips move against a lean of the trunk, m / rad."""
_MOST_HEAD = np.radians((62, 45))
"""Greatest turn and nod of the head against the chest, rad."""
_ARM_LEAST, _ARM_MOST = np.radians((-26, -8, -10, 0, -10)), np.radians((2, 6, 15, 62, 20))
"""Bounds of the offsets that a person adds to the angles of arms at ease, rad."""


def carried(
    trajectory: BodyTrajectory,
    walking: np.ndarray,
    raised: np.ndarray,
    times: np.ndarray,
    fps: float,
    *,
    rng: np.random.Generator,
) -> BodyTrajectory:
    """Return a trajectory of F frames with the posture of a person applied. Feet on the floor stay in place.

    `walking` (F,) is the share of walking against standing; `raised` (F, 2) the weight of the action of each arm
    against the arm at ease; `rng` draws the posture and small movements.
    """
    # Offsets of arms at ease, which are alike on both sides; how low the hips are; lean of the trunk to the front and
    # to the right; nod of the head; size of all small movements.
    both, apart = rng.uniform(_ARM_LEAST, _ARM_MOST), rng.uniform(_ARM_LEAST, _ARM_MOST, (2, 5))
    lowered = _DEEPEST * rng.uniform(0.05, 1.0)
    lean, nod = np.radians(rng.normal((2.0, 0.0), (4.0, 2.0))), np.radians(rng.normal(6.0, 8.0))
    activity = rng.uniform(0.5, 1.6)

    def drifts(kinds) -> np.ndarray:
        drawn = [random_drift(rng, times, np.radians(rms), fastest) for rms, fastest in kinds]
        return activity * np.stack(drawn, axis=1)

    upright = smoothstep((trajectory.root[:, 2] / HIP_HEIGHT - _LOW) / (_HIGH - _LOW))
    upright = gaussian_filter1d(upright, 0.1 * fps, mode="nearest")
    standing = gaussian_filter1d(1 - np.minimum(1, 2 * walking), 0.2 * fps, mode="nearest")
    still = upright * (_WALKING + (1 - _WALKING) * standing)
    root = trajectory.root.copy()
    sway, bounce = (activity * rms for rms in (_SWAY[0], _BOUNCE[0]))
    root[:, :2] += still[:, None] * np.stack([random_drift(rng, times, sway, _SWAY[1]) for _ in range(2)], axis=1)
    # The hips never rise above the height of straight legs, and their path has no kink there.
    drop = lowered + random_drift(rng, times, bounce, _BOUNCE[1])
    root[:, 2] -= still * (drop + np.hypot(drop, 0.02)) / 2
    still_feet = upright * standing * (1 - np.minimum(1, 4 * walking)) * activity
    ankles, feet = _on_toes(trajectory, still_feet, times, fps, rng=rng)
    turn, front, side = (upright[:, None] * drifts(_PELVIS)).T
    turned = about("z", turn) @ trajectory.pelvis @ about("y", front) @ about("x", side)
    chest = trajectory.chest + upright[:, None] * drifts(_CHEST)
    chest[:, 1:] += upright[:, None] * lean
    # The hips balance a leaning trunk.
    ahead, right = (chest[:, axis] - trajectory.chest[:, axis] for axis in (1, 2))
    cos, sin = np.cos(chest[:, 0]), np.sin(chest[:, 0])
    root[:, :2] -= _COUNTER * np.stack([cos * ahead + sin * right, sin * ahead - cos * right], axis=1)
    # The head turns with the chest, within the range of the neck.
    head = trajectory.head + chest[:, :2] - trajectory.chest[:, :2] + (1 - raised.max(1) / 2)[:, None] * drifts(_HEAD)
    head = chest[:, :2] + _MOST_HEAD * np.tanh((head + (0, nod) - chest[:, :2]) / _MOST_HEAD)
    free = 1 - raised
    arms = trajectory.arms + free[..., None] * (0.65 * both + 0.35 * apart)
    for arm in range(2):
        arms[:, arm] += (0.4 + 0.6 * free[:, arm, None]) * drifts(_ARMS)
    # Elbows bend in one direction only.
    arms[..., 3] = np.maximum(arms[..., 3], np.minimum(trajectory.arms[..., 3], np.radians(5)))
    # Feet in the air move with the hips.
    lifted = smoothstep((trajectory.ankles[..., 2] - ANKLE - 0.08) / 0.2)[..., None]
    ankles = ankles + lifted * (root - trajectory.root)[:, None]
    return replace(trajectory, root=root, pelvis=turned, ankles=ankles, feet=feet, chest=chest, head=head, arms=arms)


def _on_toes(
    trajectory: BodyTrajectory, size: np.ndarray, times: np.ndarray, fps: float, *, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Return ankles (F, 2, 3) and feet (F, 2, 3, 3) whose heels rise over resting tips, by a `size` (F,) of 1 on
    average."""
    ankles, feet = trajectory.ankles.copy(), trajectory.feet.copy()
    for leg in range(2):
        pitched = np.abs(feet[:, leg, 2, 0])
        flat = 1 - smoothstep(np.maximum((ankles[:, leg, 2] - ANKLE) / 0.02, pitched / 0.05))
        drift = random_drift(rng, times, np.radians(_HEELS[0]), _HEELS[1])
        heel = size * flat * (drift + np.hypot(drift, 0.03) - 0.03).clip(0) / 2
        heel = gaussian_filter1d(heel, 0.06 * fps, mode="nearest")
        ahead, up = rolled(-heel)
        ankles[:, leg, :2] += ahead[:, None] * feet[:, leg, :2, 0]
        ankles[:, leg, 2] += up - ANKLE
        feet[:, leg] = feet[:, leg] @ about("y", heel)
    return ankles, feet


# Actions on the spot in balance

_PRESSURE_CENTRE = 0.045
"""Distance ahead of the ankle at which a foot bears weight, m."""
_SETTLING = 0.3
"""Time over which the balance correction fades in and out, s."""


def perform_on_the_spot(
    action: Action, times: np.ndarray, stance: Stance, ease: np.ndarray, fps: float
) -> BodyTrajectory:
    """Return the trajectory of an action in the world, at evenly spaced times (F,) since it began, s.

    The hips move so that the centre of mass is over the feet that bear the weight, as in any slow motion. The action
    begins and ends in `stance`; `ease` (F, 2, 5) are angles of arms at ease, as `HANGING`.
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
    middles = standing[..., :2] + _PRESSURE_CENTRE * forwards(yaw)
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
    middle = (stance.feet[:, :2] + _PRESSURE_CENTRE * forwards(yaw)).mean(0)
    return middle - trajectory.centre_of_mass()[:, :2]
