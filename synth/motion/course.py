"""How somebody of the proportions in `legs` holds each part of the body, and the motion that comes of it."""

from dataclasses import dataclass, fields

import numpy as np
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from scipy.spatial.transform import Rotation

from synth.body import Body, segment_origins
from synth.motion import SEGMENTS, Motion
from synth.motion.legs import HIP_HEIGHT, headroom, solve_legs
from synth.motion.rotations import about
from synth.motion.upper import arm

SIDES = (("l", 1.0), ("r", -1.0))
"""Left and right, and the sign of y there: the order of limbs in a `Course`."""
_BODY = Body(stature=HIP_HEIGHT / 0.530)
# Where the mass of each segment is, as fractions of stature, left side: Winter (as in `legs`), table 4.1.
_CENTRES = {
    "pelvis": (0, 0, 0.025), "spine": (0, 0, 0.045), "chest": (0, 0, 0.090), "head": (0.005, 0, 0.060),
    "upper_arm": (0, 0.078, 0), "forearm": (0, 0.064, 0), "hand": (0, 0.050, 0),
    "thigh": (0, 0, -0.106), "shin": (0, 0, -0.107), "foot": (0.030, 0, -0.025),
}  # fmt: skip


@dataclass(frozen=True)
class Course:
    """What a body does over F frames, in the world; angles in rad, lengths in m.

    Attributes:
        root: (F, 3) mid point of the hips.
        pelvis: (F, 3, 3) its orientation.
        ankles: (F, 2, 3) left and right.
        feet: (F, 2, 3, 3) their orientations.
        knees: (F, 2, 3) directions to which knees bend, none along its leg.
        chest: (F, 3) its heading, and how far it leans to the front and to the right.
        head: (F, 2) its heading, and how far it nods.
        arms: (F, 2, 5) angles of the left and the right arm as `upper.HANGING`.
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
        """The motion; the spine bends half as far as the chest, legs reach for the ankles."""
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

    def centre(self) -> np.ndarray:
        """(F, 3) the body's centre of mass."""
        rotations = self.motion("", 1.0).rotations
        places = segment_origins(_BODY, self.root, rotations) + (rotations @ _LEVERS[..., None])[..., 0]
        return np.einsum("fsi,s->fi", places, _BODY.masses / _BODY.mass)


def over_feet(pelvis: np.ndarray, feet: np.ndarray) -> np.ndarray:
    """(F, 2, 3) the side to which knees bend of who stands or walks: between where pelvis and foot point."""
    ahead = feet[..., 0] * (1, 1, 0)
    ahead /= np.linalg.norm(ahead, axis=-1, keepdims=True)
    return ahead + pelvis[:, None, :, 0]


def joined(courses: list[Course]) -> Course:
    """One after the other."""
    return Course(*(np.concatenate([getattr(course, field.name) for course in courses]) for field in fields(Course)))


def lowered(course: Course, fps: float) -> np.ndarray:
    """(F, 3) root, smoothly lowered wherever a leg would not reach its ankle."""
    missing = -headroom(course.root, course.pelvis, course.ankles).min(1)
    if (missing <= 0).all():
        return course.root
    drop = maximum_filter1d(np.maximum(missing, 0), 2 * max(1, round(0.12 * fps)) + 1, mode="nearest")
    return course.root - gaussian_filter1d(drop, 0.05 * fps, mode="nearest")[:, None] * (0, 0, 1)


def _levers() -> np.ndarray:
    levers = np.array([_CENTRES[name.removeprefix("l_").removeprefix("r_")] for name in SEGMENTS]) * _BODY.stature
    levers[[name.startswith("r_") for name in SEGMENTS], 1] *= -1
    return levers


_LEVERS = _levers()
