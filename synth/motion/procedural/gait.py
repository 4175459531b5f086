"""Walking after published kinematics of normal gait: the motion of pelvis and feet.

Phases are counted in strides. The phase of a leg is a whole number when its heel strikes. The phase of the walk is the
phase of the right leg.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from scipy.interpolate import PchipInterpolator

from synth.motion.config import ProceduralConfig
from synth.motion.geometry import about, forwards, smoothstep
from synth.motion.motion import FloorPath, Motion
from synth.motion.procedural.trajectory import (
    ANKLE,
    HALF_HIPS,
    HEEL,
    REACH,
    SHIN,
    SIDES,
    STRAIGHTEST,
    THIGH,
    TIP,
    LowerBody,
    gesture,
    hang,
    headroom,
    leg_length,
    random_drift,
    swing_width,
)
from synth.people.hands import GESTURES, HandUse, uses_of


def _fourier(*points: tuple[float, float]) -> Callable[[np.ndarray], np.ndarray]:
    """Return an angle, rad, over the phase: six harmonics fitted through points (percent of the stride, degrees)."""
    percent, degrees = np.array(points, np.float64).T
    curve = PchipInterpolator(np.concatenate([percent - 100, percent, percent + 100]), np.tile(degrees, 3))

    def basis(phase: np.ndarray) -> np.ndarray:
        turns = 2 * np.pi * phase[..., None] * np.arange(1, 7)
        return np.concatenate([np.ones((*phase.shape, 1)), np.cos(turns), np.sin(turns)], axis=-1)

    phase = np.linspace(0, 1, 200, endpoint=False)
    coefficients = np.radians(np.linalg.lstsq(basis(phase), curve(100 * phase), rcond=None)[0])
    return lambda phase: basis(phase) @ coefficients


# Extremes and their timing, after Perry and Burnfield, "Gait Analysis" (2nd ed., 2010), chapters 3 to 6: thigh forward
# of the vertical, knee flexion, ankle dorsiflexion.
thigh_angle = _fourier((0, 22), (12, 20), (31, 0), (50, -19), (62, -10), (73, 15), (85, 26), (95, 23))
knee_angle = _fourier((0, 5), (13, 18), (27, 10), (40, 5), (50, 12), (62, 40), (71, 60), (85, 28), (95, 4))
ankle_angle = _fourier(
    (0, 0), (6, -6), (12, -2), (31, 6), (46, 10), (54, 3), (62, -18), (66, -18), (75, -6), (85, 0), (93, 1)
)


LEGS = ((1.0, 0.5), (-1.0, 0.0))
"""Left and right leg: sign of its side, and the lead of its phase over the phase of the walk, strides."""
_HEEL_OFF = 0.30
"""Phase at which the heel may leave the floor."""
_CLEARANCE = 0.015
"""Height of the toes above the floor at mid swing, m; Winter, Physical Therapy 72 (1992), measured 12.9 mm."""
_STEP = 1e-3
"""Step in phase for numerical derivatives."""


@dataclass(frozen=True)
class Walk:
    """A steady walk along a path."""

    path: FloorPath  # The path
    speed: float  # m/s, 0.6 to 1.7; determines cadence and stride
    width: float  # Distance between the lines on which left and right ankles land, m
    toe_out: float  # Outward turn of the feet from the path, rad

    @property
    def stride(self) -> float:
        """Length of a stride, m: the ratio of step length to cadence is 0.0064 m per step/min.

        Sekiya and Nagasaki, Gait & Posture 7 (1998); Terrier and Schutz, Eur. J. Appl. Physiol. 90 (2003), found
        0.0068. Below 1.03 m/s real steps are somewhat longer and fewer: Murakami and Otaka, J. Phys. Ther. Sci. 29
        (2017).
        """
        return float(2 * np.sqrt(60 * self.speed * 0.0064))

    @property
    def rate(self) -> float:
        """Strides per second."""
        return self.speed / self.stride

    @property
    def stance(self) -> float:
        """Share of the stride for which a foot is on the floor; less at higher speed (Perry and Burnfield, ch. 1)."""
        return float(np.interp(self.speed, (0.7, 1.6), (0.64, 0.59)))

    def lower_body(self, phase: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Return root (F, 3) m, pelvis (F, 3, 3), ankles (F, 2, 3) m and feet (F, 2, 3, 3) at phases (F,).

        Phases are in strides since the right heel struck near the start of the path. Feet on the floor roll over heel
        and tip, which stay in place. Swinging feet follow the published angles of thigh and knee, corrected so that
        they leave the floor and meet it at the right place and velocity.
        """
        ahead, up, left, turn, tilt = self.pelvis(phase)
        ahead = ahead + self.stride * phase
        root = np.concatenate([self.path.at(ahead, left), (self._fit.height + up)[:, None]], axis=1)
        pelvis = about("z", self.path.heading_at(ahead) + turn) @ about("x", tilt)
        ankles, feet = np.zeros((len(phase), 2, 3)), np.zeros((len(phase), 2, 3, 3))
        spare = np.inf
        for leg, (_, early) in enumerate(LEGS):
            strides, own = np.divmod(phase + early, 1)
            swinging = own >= self.stance
            ankles[:, leg] = self.planted(leg, strides, own)
            spare = min(spare, headroom(root, pelvis, ankles)[~swinging, leg].min(initial=np.inf))
            ankles[swinging, leg] = self.swung(
                leg, strides[swinging], own[swinging], _fitted_lift(self.speed, self.width)
            )
            change = smoothstep((own - self.stance) / (1 - self.stance))
            yaw = self.footprint(leg, strides)[1] * (1 - change) + self.footprint(leg, strides + 1)[1] * change
            feet[:, leg] = about("z", yaw) @ about("y", -self.pitch(own))
        # On a tight curve the hips are a little lower than on a straight path.
        root[:, 2] += min(spare, 0)
        return root, pelvis, ankles, feet

    def pelvis(self, phase: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the pelvis relative to its mean path, (F,) each: ahead, up, left, m; turn left, left side up, rad."""
        # From end to end at 0.7 and 1.6 m/s: Orendurff et al., J. Rehabil. Res. Dev. 41 (6A), 2004.
        height, sway = (np.interp(self.speed, (0.7, 1.6), ends) / 2 for ends in ((0.027, 0.048), (0.070, 0.039)))
        return (
            # The pelvis is fastest while it is lowest, in double support.
            0.015 * np.sin(4 * np.pi * (phase - 0.05)),
            -height * np.cos(4 * np.pi * (phase - 0.05)),
            -sway * np.cos(2 * np.pi * (phase - 0.31)),
            # It turns with the striking leg and rises on the bearing side: Perry and Burnfield, ch. 4.
            np.radians(5) * np.cos(2 * np.pi * phase),
            -np.radians(4) * np.cos(2 * np.pi * (phase - 0.13)),
        )

    def hip(self, own: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return a hip at its leg's own phase, m: ahead on the path, above the mean height, and outward of its foot."""
        ahead, up, left, turn, tilt = self.pelvis(own)
        return (
            self.stride * own + ahead + HALF_HIPS * np.sin(turn),
            up - HALF_HIPS * np.sin(tilt),
            HALF_HIPS - left - self.width / 2,
        )

    def published(self, own: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return a leg at its own phase: ankle ahead of and above the hip, m, and pitch of the foot, toes up, rad."""
        # The published thigh angle swings about a mean of 4 degrees; its range fits a stride of 1.31 m on these legs.
        thigh = np.radians(4) + (thigh_angle(own) - np.radians(4)) * self.stride / 1.31
        shin = thigh - knee_angle(own)
        ahead = THIGH * np.sin(thigh) + SHIN * np.sin(shin)
        above = -THIGH * np.cos(thigh) - SHIN * np.cos(shin)
        return ahead, above, shin + ankle_angle(own)

    @property
    def _fit(self) -> "_Fit":
        return _fitted(self.speed, self.width)

    def pitch(self, own: np.ndarray) -> np.ndarray:
        """Return the pitch of the foot, toes up, rad, at the leg's own phase."""
        return np.interp(own % 1, np.linspace(0, 1, len(self._fit.pitch)), self._fit.pitch)

    def footprint(self, leg: int, stride: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the place of the ankle above the flat foot, (F, 2) m, and the foot's heading, (F,) rad, by stride."""
        side, early = LEGS[leg]
        ahead = self.stride * (stride - early) + self._fit.foot_ahead
        return self.path.at(ahead, side * self.width / 2), self.path.heading_at(ahead) + side * self.toe_out

    def planted(self, leg: int, stride: np.ndarray, own: np.ndarray) -> np.ndarray:
        """Return the ankle (F, 3), m, of a foot on the floor in its n-th stride, at its own phase within the stride."""
        xy, yaw = self.footprint(leg, stride)
        forward, up = rolled(self.pitch(own))
        return np.concatenate([xy + forward[:, None] * forwards(yaw), up[:, None]], axis=1)

    def swung(self, leg: int, stride: np.ndarray, own: np.ndarray, lift: float) -> np.ndarray:
        """Return the ankle (F, 3), m, of a foot in the air after the stance of its n-th stride, at its own phase."""
        side, early = LEGS[leg]

        def published(own: np.ndarray) -> np.ndarray:
            hip, up, _ = self.hip(own)
            ahead, above, _ = self.published(own % 1)
            xy = self.path.at(hip - self.stride * early + ahead, side * self.width / 2)
            return np.concatenate([xy, (self._fit.height + up + above)[:, None]], axis=1)

        def off(stride: np.ndarray, own: float) -> np.ndarray:
            return self.planted(leg, stride, np.full(len(stride), own)) - published(stride + own)

        # Offset from the published ankle, and its rate, where the foot leaves the floor and where it meets it.
        parting, meeting = off(stride, self.stance), off(stride + 1, 0)
        parting_speed = (parting - off(stride, self.stance - _STEP)) / _STEP
        meeting_speed = (off(stride + 1, _STEP) - meeting) / _STEP
        # Cubic Hermite interpolation between both ends.
        swing = 1 - self.stance
        u = ((own - self.stance) / swing)[:, None]
        correction = (1 + 2 * u) * (1 - u) ** 2 * parting + u**2 * (3 - 2 * u) * meeting
        correction += swing * u * (1 - u) * ((1 - u) * parting_speed - u * meeting_speed)
        correction[:, 2:] += lift * _arch(u)
        return published(stride + own) + correction


@dataclass(frozen=True)
class _Fit:
    """Parameters that fit the published leg to the floor."""

    foot_ahead: float  # Distance ahead of the hips at which feet are planted, m
    height: float  # Mean height of the hips, m
    pitch: np.ndarray  # (K,) pitch of the foot over a stride, rad


def _straight(speed: float, width: float) -> Walk:
    return Walk(FloorPath.bent(np.arange(-3.0, 6.0), np.zeros(9)), speed, width, toe_out=0.0)


# These results do not depend on the path and take longest to compute, so they are cached.


@lru_cache(maxsize=64)
def _fitted(speed: float, width: float) -> _Fit:
    """Find the hip height and the pitch of the foot for which published leg, hips and rolling foot agree best."""
    walk, own = _straight(speed, width), np.linspace(0, 1, 1001)
    published = walk.published(own)[2]
    ahead, above, outward = walk.hip(own)
    # Before the heel leaves the floor, the farther ahead a foot is planted, the lower the hips must be at heel strike
    # and the higher they may be at mid stance. The best distance lets them be highest.
    pitch = published * (1 - smoothstep((own - 0.03) / 0.06))
    forward, up = rolled(pitch)
    early = own < _HEEL_OFF
    candidates = np.linspace(0.1, 0.5, 401)[:, None]
    level = np.hypot((ahead - forward)[early] - candidates, outward[early])
    allowed = np.sqrt(np.maximum(REACH**2 - level**2, 0)) + (up - above)[early]
    best = allowed.min(1).argmax()
    foot_ahead, height = float(candidates[best, 0]), float(allowed[best].min())
    # Then the heel rises so that the knee follows the published angle.
    late = (own >= _HEEL_OFF) & (own <= walk.stance)
    rises = -np.radians(np.linspace(0, 80, 801))
    forward, up = rolled(rises)
    leg = np.hypot((ahead[late] - foot_ahead)[:, None] - forward, (height + above[late])[:, None] - up)
    leg = np.hypot(leg, outward[late][:, None])
    wanted = leg_length(np.maximum(knee_angle(own[late]), STRAIGHTEST))
    pitch[late] = rises[np.argmax(leg <= wanted[:, None], axis=1)]
    # In the air the foot returns to the published pitch.
    swing, last = own > walk.stance, np.flatnonzero(late)[-1]
    fading = 1 - smoothstep((own - walk.stance) / 0.2)
    pitch[swing] = (published + (pitch[last] - published[last]) * fading)[swing]
    return _Fit(foot_ahead, height, pitch)


@lru_cache(maxsize=64)
def _fitted_lift(speed: float, width: float) -> float:
    """Return how much a swinging foot must be raised at mid swing so that its tip clears the floor, m."""
    walk, u = _straight(speed, width), np.linspace(0.1, 0.9, 81)
    own = walk.stance + (1 - walk.stance) * u
    pitch = walk.pitch(own)
    tip = walk.swung(1, np.zeros(len(u)), own, lift=0)[:, 2] + TIP * np.sin(pitch) - ANKLE * np.cos(pitch)
    return float(np.max(_CLEARANCE - tip / _arch(u)))


def _arch(u: np.ndarray) -> np.ndarray:
    """Return a curve that is 0 with zero slope at u = 0 and u = 1, and 1 half way."""
    return 16 * u**2 * (1 - u) ** 2


def rolled(pitch: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the shift ahead of the ankle of a foot that rolls onto heel or tip, and the ankle's height, m."""
    pivot = np.where(pitch > 0, HEEL, TIP)
    cosine, sine = np.cos(pitch), np.sin(pitch)
    return pivot - cosine * pivot - sine * ANKLE, cosine * ANKLE - sine * pivot


# People who walk or stand throughout, and may gesture


def make_motion(config: ProceduralConfig, *, seconds: float, fps: float, rng: np.random.Generator) -> Motion:
    """Return round(seconds * fps) frames of a person of random style who walks or stands, and may reach out or wave.

    Soles stay in place while they bear weight, on the legs of the reference body; see `trajectory`.
    """
    times = np.arange(max(round(seconds * fps), 1)) / fps
    name, lower, lean = _stand(rng, times) if rng.uniform() < config.standing else _walk(config, rng, times)
    arms = [hang(rng, times, lower.swing * sign) for _, sign in SIDES]
    turn, hands = -0.3 * lower.swing, list[HandUse]()
    if rng.uniform() < config.gesture:
        arm, kind = rng.integers(2), str(rng.choice(("reach", "wave")))
        side, sign = SIDES[arm]
        share, angles = gesture(rng, kind, times)
        arms[arm] += share[:, None] * (angles - arms[arm])
        hands += uses_of(side, share, GESTURES[kind])
        # The shoulder follows.
        turn = turn - sign * np.radians(8) * share
        name += f", {kind} {side}"
    look, nod = (random_drift(rng, times, np.radians(rms), 0.3) for rms in (15, 5))
    chest, head = np.stack([lower.heading + turn, *lean.T], axis=1), np.stack([lower.heading + look, nod], axis=1)
    motion = lower.with_upper_body(chest, head, np.stack(arms, axis=1)).motion(name, fps)
    return replace(motion, hands=tuple(hands))


def _walk(config: ProceduralConfig, rng: np.random.Generator, times: np.ndarray) -> tuple[str, LowerBody, np.ndarray]:
    """Draw a walk: its name for reports, the lower body, and (F, 2) lean of the trunk to the front and right, rad."""
    speed, radius = rng.uniform(*config.speed), rng.uniform(*config.radius) * rng.choice((-1, 1))
    distance = np.arange(-3, speed * times[-1] + 5, 0.01)
    drawn = rng.uniform()
    if drawn < config.straight:
        curvature, way = np.zeros(len(distance)), "straight"
    elif drawn < (1 + config.straight) / 2:
        curvature, way = np.full(len(distance), 1 / radius), f"on a circle of {abs(radius):.1f} m"
    else:
        waves = 2 * np.pi * (distance / rng.uniform(3, 6) + rng.uniform())
        curvature, way = np.cos(waves) / radius, f"winding by {abs(radius):.1f} m"
    path = FloorPath.bent(distance, curvature)
    walk = Walk(path, speed, width=rng.uniform(0.06, 0.13), toe_out=np.radians(rng.uniform(2, 10)))
    # The pace varies a little.
    phase = rng.uniform() + walk.rate * times + random_drift(rng, times, 0.015, 0.4)
    # Lean into a turn as a rigid body must for balance.
    inward = np.arctan(speed**2 * np.interp(walk.stride * phase, distance, curvature) / 9.81)
    width = swing_width(speed) * rng.uniform(0.6, 1.3)
    swing = width * np.cos(2 * np.pi * phase)
    heading, walking = path.heading_at(walk.stride * phase), np.ones(len(times))
    lean = np.stack([np.full(len(times), np.radians(rng.uniform(0, 7))), -inward], axis=1)
    lower = LowerBody(*walk.lower_body(phase), heading, walking, swing)
    return f"walk at {speed:.1f} m/s, {way}", lower, lean


def _stand(rng: np.random.Generator, times: np.ndarray) -> tuple[str, LowerBody, np.ndarray]:
    """Draw the stance of a person who sways; as `_walk`."""
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
    heading = random_drift(rng, times, np.radians(6), 0.25)
    lean = np.stack([np.radians(rng.uniform(-2, 5)) + random_drift(rng, times, np.radians(1), 0.3), -tilt], axis=1)
    swing = random_drift(rng, times, np.radians(1), 0.3)
    return "stand", LowerBody(root, pelvis, ankles, feet, heading, np.zeros(frames), swing), lean
