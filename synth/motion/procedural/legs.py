"""Legs of the reference body, on which procedural motion is made: lengths, inverse kinematics, and standing on both."""

from dataclasses import dataclass

import numpy as np

from synth.motion.rotations import aligned
from synth.people import body

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
    """Return the thighs and shins that join the hips to the ankles.

    Args:
        root: (F, 3) mid hip, m.
        pelvis: (F, 3, 3) orientation, world from pelvis.
        ankles: (F, 2, 3) left and right, m. If an ankle is out of reach, the leg is as straight as allowed.
        forward: (F, 2, 3) direction in which each knee bends.

    Returns:
        (F, 2, 3, 3) orientations of left and right thigh, and of left and right shin.
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
    """Return the directions in which knees bend in standing and walking: half way between pelvis and foot.

    Args:
        pelvis: (F, 3, 3) orientation.
        feet: (F, 2, 3, 3) orientations of left and right foot.

    Returns:
        (F, 2, 3) directions, of any length.
    """
    ahead = feet[..., 0] * (1, 1, 0)
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    return ahead + pelvis[:, None, :, 0]


@dataclass(frozen=True)
class Stance:
    """A stance with both feet flat on the floor.

    Attributes:
        feet: (2, 3) of left and right foot: x and y of the ankle, m, and heading, rad.
    """

    feet: np.ndarray

    @staticmethod
    def at(x: float, y: float, heading: float, width: float, toe_out: float) -> "Stance":
        """Return a stance with the feet side by side, `width` apart, m, each turned outward by `toe_out`, rad."""
        left = width / 2 * np.array((-np.sin(heading), np.cos(heading)))
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
