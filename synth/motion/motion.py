"""One person's motion on the canonical segments, and its path over the floor."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.numerics.paths import runs
from synth.motion.geometry import forwards, leftwards
from synth.people.body import SEGMENTS
from synth.people.hands import HandUse


@dataclass(frozen=True)
class Motion:
    """Motion of one person, independent of the person's proportions.

    In the canonical pose every rotation is the identity. The pose is a T-pose that faces +x, with +y to the left and
    +z up. The arms point straight out along +y and -y, the palms face down, and the feet are flat and point forward.
    From this pose, elbows bend forward as hinges about z, and knees bend backward as hinges about y.
    """

    name: str  # Human-readable source: file stem and frame range, or the procedural recipe
    fps: float  # Frames per second
    root: np.ndarray  # (F, 3) mid point of the hip joints, m, world z up, floor at z = 0
    rotations: np.ndarray  # (F, 16, 3, 3) world orientation of each of `SEGMENTS`, world from segment
    # Height of the hip joints above the soles when the source's body stands straight, m. For a body with other
    # proportions, `root` is scaled by the ratio of both hip heights.
    hip_height: float
    seats: tuple[int, ...] = ()  # Frames in which the person begins to sit on a stool
    # First frame and name of each action. If empty, the whole motion is one action, named `name`.
    actions: tuple[tuple[int, str], ...] = ()
    hands: tuple[HandUse, ...] = ()  # What hands are needed for; of two uses at a time, the latter counts
    first: int = 0  # Frame of the recording at which this motion begins. It aligns takes of people recorded together.

    def __post_init__(self):
        for field, shape in (("root", (3,)), ("rotations", (len(SEGMENTS), 3, 3))):
            array = np.asarray(getattr(self, field), np.float64)
            if array.shape[1:] != shape or len(array) != len(self.root):
                raise ValueError(f"motion {self.name!r}: {field} must have shape (F, *{shape}), found {array.shape}")
            if not np.isfinite(array).all():
                raise ValueError(f"motion {self.name!r}: {field} has values that are not finite")
            object.__setattr__(self, field, array)
        if not (self.fps > 0 and self.hip_height > 0 and len(self.root) > 0):
            raise ValueError(f"motion {self.name!r}: needs frames, fps > 0 and hip_height > 0")

    def __len__(self) -> int:
        return len(self.root)


# Paths over the floor: lines to walk along, motions moved and bent, sidesteps around people and obstacles

_ROUNDS = 24
"""Greatest number of passes over all pairs of people; one sidestep may cause another."""
_SETTLED = 0.005
"""Smallest lack of clearance that causes a sidestep, m."""
_HEAD_ON = 0.02
"""Distance below which two paths count as the same, so that it does not determine the side of the sidestep, m."""


@dataclass(frozen=True)
class FloorPath:
    """A line on the floor, given at K points."""

    distance: np.ndarray  # (K,) distance along the line, m
    heading: np.ndarray  # (K,) rad
    xy: np.ndarray  # (K, 2) m

    @staticmethod
    def bent(distance: np.ndarray, curvature: np.ndarray) -> "FloorPath":
        """Return a path that starts at the origin along +x and turns by `curvature` (K,), rad/m, left if positive."""
        step = np.diff(distance, prepend=distance[0])
        heading = np.cumsum(curvature * step)
        xy = np.cumsum(forwards(heading) * step[:, None], axis=0)
        return FloorPath(distance, heading, xy)

    def heading_at(self, distance: np.ndarray) -> np.ndarray:
        """Return the heading at distances (...), rad."""
        return np.interp(distance, self.distance, self.heading)

    def at(self, distance: np.ndarray, left: np.ndarray | float) -> np.ndarray:
        """Return positions (..., 2), m, at distances (...) along the line and at offsets `left` of it, m."""
        heading = self.heading_at(distance)
        along = np.stack([np.interp(distance, self.distance, self.xy[:, i]) for i in range(2)], axis=-1)
        return along + leftwards(heading) * np.asarray(left)[..., None]


def redirect(motion: Motion, start: tuple[float, float], yaw: float, turn: float) -> Motion:
    """Return a motion with another start of the mid hip, m, turned about the vertical by `yaw`, rad, and bent along a
    curve by `turn`, rad/s: a straight walk becomes a walk around a circle."""
    root = motion.root.copy()
    root[:, :2] = redirected_path(motion, start, yaw, turn)
    return replace(motion, root=root, rotations=_turns(motion, yaw, turn)[:, None] @ motion.rotations)


def redirected_path(motion: Motion, start: tuple[float, float], yaw: float, turn: float) -> np.ndarray:
    """Return the path of the mid hip, (F, 2) m, that `redirect` gives to a motion."""
    turns = _turns(motion, yaw, turn)
    steps = np.einsum("fij,fj->fi", turns[:-1, :2, :2], np.diff(motion.root[:, :2], axis=0))
    return np.concatenate([[start], start + np.cumsum(steps, axis=0)])


def _turns(motion: Motion, yaw: float, turn: float) -> np.ndarray:
    angle = yaw + turn * np.arange(len(motion)) / motion.fps
    return Rotation.from_rotvec(angle[:, None] * (0.0, 0.0, 1.0)).as_matrix()


def avoid_collisions(paths: np.ndarray, fps: float, *, clearance: float, obstacles: np.ndarray) -> np.ndarray:
    """Return sidesteps (F, P, 2), m, that keep people apart from each other and from obstacles.

    Where two paths come closer than the clearance, each person steps aside by half of the missing distance, sideways to
    the direction in which they pass each other. The sidestep begins one second before. One sidestep may cause another,
    so the paths are checked again; a few rounds resolve most conflicts.

    Args:
        paths: (F, P, 2) mid hips, m.
        clearance: Least distance between the mid hips of two people, m.
        obstacles: (K, 3) x, y and radius, m. Paths keep half the clearance from the edge of each.
    """
    frames, persons = paths.shape[:2]
    still = np.broadcast_to(obstacles[:, :2], (frames, len(obstacles), 2))
    distances = np.full((persons, persons + len(obstacles)), clearance)
    distances[:, persons:] = clearance / 2 + obstacles[:, 2]
    shift = np.zeros_like(paths)
    for _ in range(_ROUNDS):
        settled = True
        for one in range(persons):
            for other in range(one + 1, persons + len(obstacles)):
                places = np.concatenate([paths + shift, still], axis=1)
                apart = places[:, one] - places[:, other]
                step = _sidestep(apart, fps, distances[one, other])
                if step is None:
                    continue
                settled = False
                if other < persons:
                    shift[:, one] += step / 2
                    shift[:, other] -= step / 2
                else:
                    shift[:, one] += step
        if settled:
            break
    return shift


def _sidestep(apart: np.ndarray, fps: float, clearance: float) -> np.ndarray | None:
    """Return a smooth shift, (F, 2) m, that lengthens the shortest vector of `apart`, (F, 2) m, to the clearance, or
    None."""
    distance = np.linalg.norm(apart, axis=1)
    nearest = int(distance.argmin())
    missing = clearance - distance[nearest]
    if missing < _SETTLED:
        return None
    away = apart[nearest]
    if distance[nearest] < _HEAD_ON:
        # If paths meet head-on, both people step to the right. If neither moves, any direction works.
        passing = np.gradient(apart, axis=0)[nearest] if len(apart) > 1 else np.zeros(2)
        away = np.array((passing[1], -passing[0])) if passing.any() else np.array((1.0, 0.0))
    _, ramp = ramp_around(distance < clearance, nearest, fps)
    return (missing + _SETTLED) * ramp[:, None] * (away / np.linalg.norm(away))


def ramp_around(close: np.ndarray, frame: int, fps: float) -> tuple[slice, np.ndarray]:
    """Return the run of True in `close` (F,) that holds a frame, and weights (F,) of a sidestep there: 1 in the run,
    and less over a second before and after it."""
    first, end = next(run for run in runs(close) if run[0] <= frame < run[1])
    time = np.arange(len(close))
    beyond = np.maximum(np.maximum(first - time, time - end + 1), 0) / fps
    return slice(first, end), 0.5 + 0.5 * np.cos(np.pi * np.minimum(beyond, 1.0))
