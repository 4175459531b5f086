"""Procedural people who walk or stand throughout, after published kinematics, and may gesture."""

from dataclasses import dataclass, field

import numpy as np

from synth.motion.motion import Motion
from synth.motion.path_planning import FloorPath
from synth.motion.procedural.gait import Walk
from synth.motion.procedural.legs import ANKLE, SIDES, headroom, knee_directions
from synth.motion.procedural.trajectory import BodyTrajectory
from synth.motion.procedural.upper_body import gesture, hang, random_drift, swing_width
from synth.motion.rotations import about


@dataclass(frozen=True)
class ProceduralConfig:
    """Motion of procedural people who walk or stand throughout. With `motion.actions`, only `speed` applies.

    Attributes:
        standing: Share, 0 to 1, of the people who stand; the others walk.
        speed: m/s, least and greatest walking speed.
        straight: Share, 0 to 1, of the walks that go straight ahead; half of the others are circles, half are winding.
        radius: m, least and greatest radius of turns.
        gesture: Share, 0 to 1, of the people who reach out or wave once.
    """

    standing: float = 0.25
    speed: list[float] = field(default_factory=lambda: [1.0, 1.7])
    straight: float = 0.25
    radius: list[float] = field(default_factory=lambda: [1.5, 6.0])
    gesture: float = 0.5

    def __post_init__(self):
        for name in ("standing", "straight", "gesture"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"motion.procedural.{name}: expected a share from 0 to 1, found {getattr(self, name)}")
        # Beyond these bounds the published kinematics no longer hold, or feet cross on the inside of the turn.
        for name, least, greatest in (("speed", 0.6, 1.7), ("radius", 1.0, np.inf)):
            values = getattr(self, name)
            if len(values) != 2 or not least <= values[0] <= values[1] <= greatest:
                raise ValueError(
                    f"motion.procedural.{name}: expected [least, greatest] within {least} to {greatest}, found {values}"
                )


@dataclass(frozen=True)
class _Gait:
    """The lower body over F frames, and the trunk and arm motion that goes with it.

    Attributes:
        name: Label for reports.
        root, pelvis, ankles, feet: As in `LowerBody`.
        heading: (F,) heading of the trunk, rad.
        lean: (F, 2) lean of the trunk to the front and to the right, rad.
        swing: (F,) swing of the left arm to the front and of the right arm to the back, rad.
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
    """Return the motion of a person of random style who walks or stands, and may reach out or wave.

    Soles stay in place while they bear weight, on the legs of the reference body; see `legs`.

    Args:
        config: Shares of walking, standing and gestures, and ranges of speed and radius.
        seconds: Length, s.
        fps: Frames per second.
        rng: Draws everything.

    Returns:
        round(seconds * fps) frames.
    """
    times = np.arange(max(round(seconds * fps), 1)) / fps
    gait = _stand(rng, times) if rng.uniform() < config.standing else _walk(config, rng, times)
    name, arms = gait.name, [hang(rng, times, gait.swing * sign) for _, sign in SIDES]
    turn = -0.3 * gait.swing
    if rng.uniform() < config.gesture:
        arm, kind = rng.integers(2), str(rng.choice(("reach", "wave")))
        side, sign = SIDES[arm]
        share, angles = gesture(rng, kind, times)
        arms[arm] += share[:, None] * (angles - arms[arm])
        # The shoulder follows.
        turn = turn - sign * np.radians(8) * share
        name += f", {kind} {side}"
    look, nod = (random_drift(rng, times, np.radians(rms), 0.3) for rms in (15, 5))
    trajectory = BodyTrajectory(
        root=gait.root,
        pelvis=gait.pelvis,
        ankles=gait.ankles,
        feet=gait.feet,
        knees=knee_directions(gait.pelvis, gait.feet),
        chest=np.stack([gait.heading + turn, *gait.lean.T], axis=1),
        head=np.stack([gait.heading + look, nod], axis=1),
        arms=np.stack(arms, axis=1),
    )
    return trajectory.motion(name, fps)


def _walk(config: ProceduralConfig, rng: np.random.Generator, times: np.ndarray) -> _Gait:
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
    path = FloorPath.bent(distance, curvature)
    walk = Walk(path, speed, width=rng.uniform(0.06, 0.13), toe_out=np.radians(rng.uniform(2, 10)))
    # The pace varies a little.
    phase = rng.uniform() + speed / walk.stride * times + random_drift(rng, times, 0.015, 0.4)
    root, pelvis, ankles, feet = walk.lower_body(phase)
    # Lean into a turn as a rigid body must for balance.
    inward = np.arctan(speed**2 * np.interp(walk.stride * phase, distance, curvature) / 9.81)
    width = swing_width(speed) * rng.uniform(0.6, 1.3)
    return _Gait(
        name=f"walk at {speed:.1f} m/s, {way}",
        root=root,
        pelvis=pelvis,
        ankles=ankles,
        feet=feet,
        heading=path.heading_at(walk.stride * phase),
        lean=np.stack([np.full(len(times), np.radians(rng.uniform(0, 7))), -inward], axis=1),
        swing=width * np.cos(2 * np.pi * phase),
    )


def _stand(rng: np.random.Generator, times: np.ndarray) -> _Gait:
    width, stagger, toe_out = rng.uniform(0.14, 0.30), rng.uniform(-0.06, 0.06), np.radians(rng.uniform(3, 15))
    frames = len(times)
    ankles = np.tile([(stagger, width / 2, ANKLE), (-stagger, -width / 2, ANKLE)], (frames, 1, 1))
    feet = np.tile(about("z", np.array((toe_out, -toe_out))), (frames, 1, 1, 1))
    turn, tilt = (random_drift(rng, times, np.radians(rms), 0.2) for rms in (4, 1.2))
    pelvis = about("z", turn) @ about("x", tilt)
    # Shifts of weight plus the sway of quiet standing: Prieto et al., IEEE Trans. Biomed. Eng. 43 (1996).
    forward, left = (
        random_drift(rng, times, slow, 0.15) + random_drift(rng, times, sway, 0.7)
        for slow, sway in ((0.012, 0.004), (0.022, 0.003))
    )
    root = np.stack([forward, left, np.zeros(frames)], axis=1)
    # The greatest height that both legs reach in all frames, slightly lowered so that the knees are not locked.
    root[:, 2] = headroom(root, pelvis, ankles).min() - rng.uniform(0.002, 0.012)
    return _Gait(
        name="stand",
        root=root,
        pelvis=pelvis,
        ankles=ankles,
        feet=feet,
        heading=random_drift(rng, times, np.radians(6), 0.25),
        lean=np.stack([np.radians(rng.uniform(-2, 5)) + random_drift(rng, times, np.radians(1), 0.3), -tilt], axis=1),
        swing=random_drift(rng, times, np.radians(1), 0.3),
    )
