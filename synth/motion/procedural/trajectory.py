"""The body on which procedural motion is made: its legs, arms, and the trajectory of each part."""

from dataclasses import dataclass, fields

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation

from synth.motion.geometry import about, aligned, leftwards, minimum_jerk
from synth.motion.motion import Motion
from synth.people import body
from synth.people.body import SEGMENTS, Body, segment_origins, side_and_name

SIDES = tuple(body.SIDES.items())
"""Left and right, and the sign of y there: the order of limbs in every array of this package."""
HIP_HEIGHT = 0.9
"""Height of the hip joints in standing, m."""
STATURE = HIP_HEIGHT / (body.LEG_LENGTH + body.ANKLE_HEIGHT)
"""Stature of the reference body, m."""
THIGH, SHIN, ANKLE = (share * STATURE for share in (body.THIGH_LENGTH, body.SHIN_LENGTH, body.ANKLE_HEIGHT))
"""Lengths of thigh and shin, and height of the ankle above the sole, m."""
HALF_HIPS = body.HALF_HIP_WIDTH * STATURE
"""Distance of each hip joint from the mid hip, m."""
_FOOT = 0.152 * STATURE
"""Length of the foot, m: Winter, "Biomechanics and Motor Control of Human Movement" (4th ed., 2009), figure 4.1."""
HEEL, TIP = -0.25 * _FOOT, 0.70 * _FOOT
"""End of the sole behind the ankle, and the point ahead of it over which a foot without toe joints rolls, m."""
STRAIGHTEST = np.radians(4)
"""Least knee flexion, rad, so that knees neither lock nor bend backwards."""
_SLACK = 0.005
"""Distance by which standing hips stay below the height that the legs could reach, m."""


def leg_length(knee: np.ndarray | float) -> np.ndarray:
    """Return the distance from hip to ankle, m, at a knee flexion, rad."""
    return np.sqrt(THIGH**2 + SHIN**2 + 2 * THIGH * SHIN * np.cos(knee))


REACH = float(leg_length(STRAIGHTEST))
"""Greatest distance from hip to ankle, m."""


def hip_joints(root: np.ndarray, pelvis: np.ndarray) -> np.ndarray:
    """Return the left and right hip joints, (F, 2, 3) m, from root (F, 3) and pelvis orientation (F, 3, 3)."""
    return root[:, None] + np.stack([pelvis[..., 1], -pelvis[..., 1]], axis=1) * HALF_HIPS


def headroom(root: np.ndarray, pelvis: np.ndarray, ankles: np.ndarray) -> np.ndarray:
    """Return how far the root (F, 3) could rise before the left and the right leg are straight, (F, 2) m."""
    hips = hip_joints(root, pelvis)
    level = np.linalg.norm((hips - ankles)[..., :2], axis=-1)
    return ankles[..., 2] + np.sqrt(np.maximum(REACH**2 - level**2, 0)) - hips[..., 2]


def solve_legs(
    root: np.ndarray, pelvis: np.ndarray, ankles: np.ndarray, forward: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the thighs and shins that join the hips to the ankles: (F, 2, 3, 3) orientations, left and right, of each.

    Args:
        root: (F, 3) mid hip, m.
        pelvis: (F, 3, 3) orientation, world from pelvis.
        ankles: (F, 2, 3) left and right, m. If an ankle is out of reach, the leg is as straight as allowed.
        forward: (F, 2, 3) direction in which each knee bends.
    """
    hips = hip_joints(root, pelvis)
    thighs, shins = np.empty((2, *forward.shape, 3))
    for leg in range(2):
        reach = ankles[:, leg] - hips[:, leg]
        distance = np.linalg.norm(reach, axis=1, keepdims=True)
        straight = aligned(reach, forward[:, leg], (0, 0, -1))
        # Law of cosines, at the hip.
        distance = np.minimum(distance, REACH)
        cosine = np.clip((THIGH**2 + distance**2 - SHIN**2) / (2 * THIGH * distance), -1, 1)
        knee = THIGH * (np.sqrt(1 - cosine**2) * straight[..., 0] - cosine * straight[..., 2])
        ankle = -distance * straight[..., 2]
        thighs[:, leg] = aligned(knee, straight[..., 0], (0, 0, -1))
        shins[:, leg] = aligned(ankle - knee, straight[..., 0], (0, 0, -1))
    return thighs, shins


def knee_directions(pelvis: np.ndarray, feet: np.ndarray) -> np.ndarray:
    """Return directions (F, 2, 3), of any length, in which knees bend in standing and walking: half way between pelvis
    (F, 3, 3) and foot (F, 2, 3, 3)."""
    ahead = feet[..., 0] * (1, 1, 0)
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    return ahead + pelvis[:, None, :, 0]


@dataclass(frozen=True)
class Stance:
    """A stance with both feet flat on the floor."""

    feet: np.ndarray  # (2, 3) of left and right foot: x and y of the ankle, m, and heading, rad

    @staticmethod
    def at(x: float, y: float, heading: float, width: float, toe_out: float) -> "Stance":
        """Return a stance with the feet side by side, `width` apart, m, each turned outward by `toe_out`, rad."""
        left = width / 2 * leftwards(heading)
        return Stance(np.array([(x + s * left[0], y + s * left[1], heading + s * toe_out) for _, s in SIDES]))

    @property
    def middle(self) -> np.ndarray:
        """(3,) point between the ankles, m, and heading of the body, rad."""
        return self.feet.mean(0)

    @property
    def width(self) -> float:
        """Distance between the ankles, m."""
        return float(np.linalg.norm(self.feet[0, :2] - self.feet[1, :2]))

    @property
    def toe_out(self) -> float:
        """Outward turn of each foot, rad."""
        return float(self.feet[0, 2] - self.feet[1, 2]) / 2

    @property
    def root(self) -> np.ndarray:
        """(3,) mid hip of a body in this stance, m."""
        hips = hip_joints(np.zeros((1, 3)), np.eye(3)[None])[0]
        return np.array((*self.middle[:2], ANKLE + np.sqrt(REACH**2 - (self.width / 2 - hips[0, 1]) ** 2) - _SLACK))


# Arms, gestures and small random movements

HANGING = np.radians((0, 8, 20, 20, 20))
"""(5,) angles of an arm at ease, rad: flexion (forward) and abduction (outward) of the upper arm from hanging, inward
turn about its length, flexion of the elbow, pronation (turn of the thumb inward) from thumb forward."""


def arm(chest: np.ndarray, side: float, angles: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return upper arm, forearm and hand, (F, 3, 3) each, on a chest (F, 3, 3), at angles (F, 5) as `HANGING`, rad.
    `side` is 1 for left, -1 for right."""
    flexion, abduction, inward, elbow, pronation = angles.T
    hanging = about("x", -side * (np.pi / 2 - abduction))
    upper = chest @ about("y", -flexion) @ hanging @ about("y", inward)
    forearm = upper @ about("z", -side * elbow) @ about("y", pronation)
    return upper, forearm, forearm


def random_drift(rng: np.random.Generator, times: np.ndarray, rms: float, fastest: float) -> np.ndarray:
    """Return random smooth drift (F,): eight sines of random phase and frequency, from a tenth of `fastest` to it, Hz.

    Unlike AR(1) noise it is smooth enough to move a body. `rms` is its root mean square.
    """
    frequencies, phases = rng.uniform(0.1 * fastest, fastest, 8), rng.uniform(0, 2 * np.pi, 8)
    return rms * 0.5 * np.sin(2 * np.pi * frequencies * times[:, None] + phases).sum(1)


def swing_width(speed: float) -> float:
    """Return the arms' swing, rad, at a walking speed, m/s: Murray, Sepic and Barnard, Physical Therapy 47
    (1967)."""
    return float(np.radians(np.interp(speed, (0.7, 1.6), (8, 20))))


def hang(rng: np.random.Generator, times: np.ndarray, swing: np.ndarray) -> np.ndarray:
    """Return angles (F, 5), as `HANGING`, of an arm at ease that swings to the front by `swing` (F,), rad."""
    angles = HANGING + np.radians(rng.uniform((-8, -3, -15, -10, -15), (3, 6, 15, 15, 20)))
    angles = angles + np.stack([random_drift(rng, times, np.radians(1.5), 0.5) for _ in range(5)], axis=1)
    angles[:, 0] += swing
    # The elbow bends as the arm comes forward.
    angles[:, 3] += 0.5 * (np.abs(swing).max() + swing)
    return angles


def gesture(rng: np.random.Generator, kind: str, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Draw a gesture of one arm, `reach` or `wave`, at a random time of the clip.

    Returns its weight (F,) against the other motion of the arm, 0 to 1, and angles (F, 5) as `HANGING`, rad.
    """
    move = rng.uniform(0.6, 1.0)
    hold = rng.uniform(0.3, 1.0) if kind == "reach" else rng.uniform(1.2, 2.5)
    first = times[0] + rng.uniform(0, max(times[-1] - times[0] - 2 * move - hold, 0.1))
    share = minimum_jerk((times - first) / move) - minimum_jerk((times - first - move - hold) / move)
    if kind == "reach":
        angles = np.radians(rng.uniform((50, 0, -10, 5, 0), (115, 35, 30, 45, 60)))
        return share, np.tile(angles, (len(times), 1))
    # The forearm is upright and swings back and forth as the upper arm turns about its length.
    angles = np.tile(np.radians(rng.uniform((5, 65, -85, 80, -10), (30, 95, -60, 105, 20))), (len(times), 1))
    angles[:, 2] += np.radians(rng.uniform(15, 25)) * np.sin(2 * np.pi * rng.uniform(1.4, 2.4) * (times - first))
    return share, angles


# The trajectory of each part, and the `Motion` that follows from it

_BODY = Body(stature=STATURE)
# Centre of mass of each segment in its own frame, as fractions of stature, left side: Winter, "Biomechanics and Motor
# Control of Human Movement" (4th ed., 2009), table 4.1.
_CENTRES = {
    "pelvis": (0, 0, 0.025), "spine": (0, 0, 0.045), "chest": (0, 0, 0.090), "head": (0.005, 0, 0.060),
    "upper_arm": (0, 0.078, 0), "forearm": (0, 0.064, 0), "hand": (0, 0.050, 0),
    "thigh": (0, 0, -0.106), "shin": (0, 0, -0.107), "foot": (0.030, 0, -0.025),
}  # fmt: skip


@dataclass(frozen=True)
class BodyTrajectory:
    """The whole body over F frames, world; lengths in m, angles in rad."""

    root: np.ndarray  # (F, 3) mid hip
    pelvis: np.ndarray  # (F, 3, 3) orientation
    ankles: np.ndarray  # (F, 2, 3) left and right
    feet: np.ndarray  # (F, 2, 3, 3) orientations
    knees: np.ndarray  # (F, 2, 3) directions in which the knees bend; not parallel to the leg
    chest: np.ndarray  # (F, 3) heading, lean to the front, lean to the right
    head: np.ndarray  # (F, 2) heading, nod
    arms: np.ndarray  # (F, 2, 5) angles of the left and the right arm, as `trajectory.HANGING`

    def motion(self, name: str, fps: float) -> Motion:
        """Return the motion. The spine bends half as far as the chest, and the legs are solved to reach the ankles."""
        rotations = {"pelvis": self.pelvis, "l_foot": self.feet[:, 0], "r_foot": self.feet[:, 1]}
        heading, forward, right = self.chest.T
        rotations["chest"] = chest = about("z", heading) @ about("y", forward) @ about("x", right)
        bend = Rotation.from_matrix(self.pelvis.swapaxes(1, 2) @ chest).as_rotvec()
        rotations["spine"] = self.pelvis @ Rotation.from_rotvec(bend / 2).as_matrix()
        rotations["head"] = about("z", self.head[:, 0]) @ about("y", self.head[:, 1]) @ about("x", right / 3)
        legs = solve_legs(self.root, self.pelvis, self.ankles, self.knees)
        for leg, (side, sign) in enumerate(SIDES):
            rotations[f"{side}_thigh"], rotations[f"{side}_shin"] = legs[0][:, leg], legs[1][:, leg]
            parts = arm(chest, sign, self.arms[:, leg])
            rotations |= {
                f"{side}_{part}": value for part, value in zip(("upper_arm", "forearm", "hand"), parts, strict=True)
            }
        return Motion(name, fps, self.root, np.stack([rotations[part] for part in SEGMENTS], axis=1), HIP_HEIGHT)

    def centre_of_mass(self) -> np.ndarray:
        """Return the centre of mass of the reference body, (F, 3) m."""
        rotations = self.motion("", 1.0).rotations
        places = segment_origins(_BODY, self.root, rotations) + (rotations @ _LEVERS[..., None])[..., 0]
        return np.einsum("fsi,s->fi", places, _BODY.masses / _BODY.mass)


@dataclass(frozen=True)
class LowerBody:
    """The lower body over F frames, world, and the heading and arm swing that go with it."""

    root: np.ndarray  # (F, 3) mid hip, m
    pelvis: np.ndarray  # (F, 3, 3) orientation
    ankles: np.ndarray  # (F, 2, 3) left and right, m
    feet: np.ndarray  # (F, 2, 3, 3) orientations of left and right foot
    heading: np.ndarray  # (F,) heading of the trunk, rad
    walking: np.ndarray  # (F,) share of walking against standing, 0 to 1
    swing: np.ndarray  # (F,) swing of the left arm to the front and of the right arm to the back, 1 at its widest

    def with_upper_body(self, chest: np.ndarray, head: np.ndarray, arms: np.ndarray) -> BodyTrajectory:
        """Return the whole body, with knees that bend over the feet."""
        knees = knee_directions(self.pelvis, self.feet)
        return BodyTrajectory(self.root, self.pelvis, self.ankles, self.feet, knees, chest, head, arms)


def concatenate(trajectories: list[BodyTrajectory]) -> BodyTrajectory:
    """Join trajectories in time."""
    names = [field.name for field in fields(BodyTrajectory)]
    return BodyTrajectory(*(np.concatenate([getattr(one, name) for one in trajectories]) for name in names))


def reachable_root(trajectory: BodyTrajectory, fps: float) -> np.ndarray:
    """Return the root, (F, 3) m, lowered smoothly wherever a leg would not reach its ankle."""
    missing = -headroom(trajectory.root, trajectory.pelvis, trajectory.ankles).min(1)
    if (missing <= 0).all():
        return trajectory.root
    drop = maximum_filter1d(np.maximum(missing, 0), 2 * max(1, round(0.12 * fps)) + 1, mode="nearest")
    return trajectory.root - gaussian_filter1d(drop, 0.05 * fps, mode="nearest")[:, None] * (0, 0, 1)


_LEVERS = np.array([_CENTRES[side_and_name(name)[1]] for name in SEGMENTS]) * _BODY.stature
"""(16, 3) centre of mass of each segment in its own frame, m."""
_LEVERS[[name.startswith("r_") for name in SEGMENTS], 1] *= -1
