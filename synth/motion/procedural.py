"""People who follow no recording: they walk or stand as published kinematics have it, and use their arms."""

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from synth.motion import SEGMENTS, Motion
from synth.motion.gait import Path, Walk
from synth.motion.legs import ANKLE, HIP_HEIGHT, headroom, solve_legs
from synth.motion.rotations import about
from synth.motion.upper import HANGING, arm, gesture, wander

_SIDES = (("l", 1.0), ("r", -1.0))


@dataclass(frozen=True)
class ProceduralConfig:
    """What people do.

    Attributes:
        standing: Share who stand; the others walk.
        speed: Least and greatest walking speed, m/s.
        straight: Share of walks straight ahead; of the others half go round in a circle, half wind to and fro.
        radius: Least and greatest radius of their turns, m.
        gesture: Share who reach out or wave once.
    """

    standing: float = 0.25
    speed: list[float] = field(default_factory=lambda: [0.8, 1.5])
    straight: float = 0.25
    radius: list[float] = field(default_factory=lambda: [1.5, 6.0])
    gesture: float = 0.5

    def __post_init__(self):
        for name in ("standing", "straight", "gesture"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"procedural motion: {name} must be a share from 0 to 1, found {getattr(self, name)}")
        # Beyond these the published kinematics no longer hold, or feet would cross on the inside of the turn.
        for name, least, greatest in (("speed", 0.6, 1.7), ("radius", 1.0, np.inf)):
            values = getattr(self, name)
            if len(values) != 2 or not least <= values[0] <= values[1] <= greatest:
                raise ValueError(
                    f"procedural motion: {name} must be [least, greatest] within {least} to {greatest}, found {values}"
                )


@dataclass(frozen=True)
class _Course:
    """What the lower body does over F frames, and what the rest of it makes of that.

    Attributes:
        name: For people to read.
        root, pelvis, ankles, feet: As `gait.Walk.lower_body`.
        heading: (F,) where the trunk faces, but for its own turns, rad.
        lean: (F, 2) of the trunk to the front and to the right, rad.
        swing: (F,) of the left arm to the front and the right arm to the back, rad.
    """

    name: str
    root: np.ndarray
    pelvis: np.ndarray
    ankles: np.ndarray
    feet: np.ndarray
    heading: np.ndarray
    lean: np.ndarray
    swing: np.ndarray


def make_motion(config: ProceduralConfig, *, seconds: float, fps: float, rng: np.random.Generator) -> Motion:
    """Somebody of random style who walks or stands, and may reach out or wave meanwhile.

    Soles stay where they are while they bear weight, on legs of the proportions in `legs`.

    Returns:
        round(seconds * fps) frames.
    """
    times = np.arange(max(round(seconds * fps), 1)) / fps
    course = _stand(rng, times) if rng.uniform() < config.standing else _walk(config, rng, times)
    name, rotations = course.name, {"pelvis": course.pelvis, "l_foot": course.feet[:, 0], "r_foot": course.feet[:, 1]}
    arms = {side: _hang(rng, times, course.swing * sign) for side, sign in _SIDES}
    turn = -0.3 * course.swing
    if rng.uniform() < config.gesture:
        (side, sign), kind = _SIDES[rng.integers(2)], str(rng.choice(("reach", "wave")))
        share, angles = gesture(rng, kind, times)
        arms[side] += share[:, None] * (angles - arms[side])
        # The shoulder comes along.
        turn = turn - sign * np.radians(8) * share
        name += f", {kind} {side}"
    forward, right = course.lean.T
    rotations["chest"] = chest = about("z", course.heading + turn) @ about("y", forward) @ about("x", right)
    bend = Rotation.from_matrix(course.pelvis.swapaxes(1, 2) @ chest).as_rotvec()
    rotations["spine"] = course.pelvis @ Rotation.from_rotvec(bend / 2).as_matrix()
    look, nod = (wander(rng, times, np.radians(rms), 0.3) for rms in (15, 5))
    rotations["head"] = about("z", course.heading + look) @ about("y", nod) @ about("x", right / 3)
    ahead = course.feet[..., 0] * (1, 1, 0)
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    legs = solve_legs(course.root, course.pelvis, course.ankles, ahead + course.pelvis[:, None, :, 0])
    for leg, (side, sign) in enumerate(_SIDES):
        rotations[f"{side}_thigh"], rotations[f"{side}_shin"] = legs[0][:, leg], legs[1][:, leg]
        parts = arm(chest, sign, arms[side])
        rotations |= {
            f"{side}_{part}": value for part, value in zip(("upper_arm", "forearm", "hand"), parts, strict=True)
        }
    return Motion(name, fps, course.root, np.stack([rotations[part] for part in SEGMENTS], axis=1), HIP_HEIGHT)


def _walk(config: ProceduralConfig, rng: np.random.Generator, times: np.ndarray) -> _Course:
    speed, radius = rng.uniform(*config.speed), rng.uniform(*config.radius) * rng.choice((-1, 1))
    distance = np.arange(-3, speed * times[-1] + 5, 0.01)
    way = rng.uniform()
    if way < config.straight:
        curvature, way = np.zeros(len(distance)), "straight"
    elif way < (1 + config.straight) / 2:
        curvature, way = np.full(len(distance), 1 / radius), f"on a circle of {abs(radius):.1f} m"
    else:
        waves = 2 * np.pi * (distance / rng.uniform(3, 6) + rng.uniform())
        curvature, way = np.cos(waves) / radius, f"winding by {abs(radius):.1f} m"
    path = Path.bent(distance, curvature)
    walk = Walk(path, speed, width=rng.uniform(0.06, 0.13), toe_out=np.radians(rng.uniform(2, 10)))
    # Nobody keeps quite the same pace.
    phase = rng.uniform() + speed / walk.stride * times + wander(rng, times, 0.015, 0.4)
    root, pelvis, ankles, feet = walk.lower_body(phase)
    # Leaning into a turn, as far as balance asks of a body that is stiff.
    inward = np.arctan(speed**2 * np.interp(walk.stride * phase, distance, curvature) / 9.81)
    # Arms go with the opposite legs, the wider the faster: Murray, Sepic and Barnard, Physical Therapy 47 (1967).
    width = np.radians(np.interp(speed, (0.7, 1.6), (8, 20))) * rng.uniform(0.6, 1.3)
    return _Course(
        name=f"walk at {speed:.1f} m/s, {way}",
        root=root,
        pelvis=pelvis,
        ankles=ankles,
        feet=feet,
        heading=path.heading_at(walk.stride * phase),
        lean=np.stack([np.full(len(times), np.radians(rng.uniform(0, 7))), -inward], axis=1),
        swing=width * np.cos(2 * np.pi * phase),
    )


def _stand(rng: np.random.Generator, times: np.ndarray) -> _Course:
    width, stagger, toe_out = rng.uniform(0.14, 0.30), rng.uniform(-0.06, 0.06), np.radians(rng.uniform(3, 15))
    frames = len(times)
    ankles = np.tile([(stagger, width / 2, ANKLE), (-stagger, -width / 2, ANKLE)], (frames, 1, 1))
    feet = np.tile(about("z", np.array((toe_out, -toe_out))), (frames, 1, 1, 1))
    turn, tilt = (wander(rng, times, np.radians(rms), 0.2) for rms in (4, 1.2))
    pelvis = about("z", turn) @ about("x", tilt)
    # Shifts of weight, and on top the sway of quiet standing: Prieto et al., IEEE Trans. Biomed. Eng. 43 (1996).
    forward, left = (
        wander(rng, times, slow, 0.15) + wander(rng, times, sway, 0.7)
        for slow, sway in ((0.012, 0.004), (0.022, 0.003))
    )
    root = np.stack([forward, left, np.zeros(frames)], axis=1)
    # As high as both legs reach throughout, less what makes the knees' ease.
    root[:, 2] = headroom(root, pelvis, ankles).min() - rng.uniform(0.002, 0.012)
    return _Course(
        name="stand",
        root=root,
        pelvis=pelvis,
        ankles=ankles,
        feet=feet,
        heading=wander(rng, times, np.radians(6), 0.25),
        lean=np.stack([np.radians(rng.uniform(-2, 5)) + wander(rng, times, np.radians(1), 0.3), -tilt], axis=1),
        swing=wander(rng, times, np.radians(1), 0.3),
    )


def _hang(rng: np.random.Generator, times: np.ndarray, swing: np.ndarray) -> np.ndarray:
    """(F, 5) angles, as `upper.HANGING`, of an arm at ease that swings (F,) to the front, rad."""
    angles = HANGING + np.radians(rng.uniform((-8, -3, -15, -10, -15), (3, 6, 15, 15, 20)))
    angles = angles + np.stack([wander(rng, times, np.radians(1.5), 0.5) for _ in range(5)], axis=1)
    angles[:, 0] += swing
    # The elbow bends as the arm comes forward.
    angles[:, 3] += 0.5 * (np.abs(swing).max() + swing)
    return angles
