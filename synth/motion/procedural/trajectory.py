"""The trajectory of each part of the reference body, and the `Motion` that follows from it."""

from dataclasses import dataclass, fields

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation

from synth.motion.motion import Motion
from synth.motion.procedural.legs import HIP_HEIGHT, SIDES, STATURE, headroom, solve_legs
from synth.motion.procedural.upper_body import arm
from synth.motion.rotations import about
from synth.people.body import Body, segment_origins
from synth.people.segments import SEGMENTS

_BODY = Body(stature=STATURE)
# Centre of mass of each segment in its own frame, as fractions of stature, left side: Winter, "Biomechanics and Motor
# Control of Human Movement" (4th ed., 2009), table 4.1.
_CENTRES = {
    "pelvis": (0, 0, 0.025), "spine": (0, 0, 0.045), "chest": (0, 0, 0.090), "head": (0.005, 0, 0.060),
    "upper_arm": (0, 0.078, 0), "forearm": (0, 0.064, 0), "hand": (0, 0.050, 0),
    "thigh": (0, 0, -0.106), "shin": (0, 0, -0.107), "foot": (0.030, 0, -0.025),
}  # fmt: skip


@dataclass(frozen=True)
class LowerBody:
    """The lower body over F frames, world, and the heading and arm swing that go with it.

    Attributes:
        root: (F, 3) mid hip, m.
        pelvis: (F, 3, 3) orientation.
        ankles: (F, 2, 3) left and right, m.
        feet: (F, 2, 3, 3) orientations of left and right foot.
        heading: (F,) heading of the trunk, rad.
        walking: (F,) share of walking against standing, 0 to 1.
        swing: (F,) swing of the left arm to the front and of the right arm to the back, 1 at its widest.
    """

    root: np.ndarray
    pelvis: np.ndarray
    ankles: np.ndarray
    feet: np.ndarray
    heading: np.ndarray
    walking: np.ndarray
    swing: np.ndarray


@dataclass(frozen=True)
class BodyTrajectory:
    """The whole body over F frames, world; lengths in m, angles in rad.

    Attributes:
        root: (F, 3) mid hip.
        pelvis: (F, 3, 3) orientation.
        ankles: (F, 2, 3) left and right.
        feet: (F, 2, 3, 3) orientations.
        knees: (F, 2, 3) directions in which the knees bend; not parallel to the leg.
        chest: (F, 3) heading, lean to the front, lean to the right.
        head: (F, 2) heading, nod.
        arms: (F, 2, 5) angles of the left and the right arm, as `upper_body.HANGING`.
    """

    root: np.ndarray
    pelvis: np.ndarray
    ankles: np.ndarray
    feet: np.ndarray
    knees: np.ndarray
    chest: np.ndarray
    head: np.ndarray
    arms: np.ndarray

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


def _levers() -> np.ndarray:
    levers = np.array([_CENTRES[name.removeprefix("l_").removeprefix("r_")] for name in SEGMENTS]) * _BODY.stature
    levers[[name.startswith("r_") for name in SEGMENTS], 1] *= -1
    return levers


_LEVERS = _levers()
"""(16, 3) centre of mass of each segment in its own frame, m."""
