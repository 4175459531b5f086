"""How well a simulation went, and what makes it unfit for use."""

from dataclasses import dataclass

import mujoco
import numpy as np

from synth.landmarks import SKELETON

DEEP = 0.04
"""An overlap of two people that shows, m."""
# What a clip may have at most: share of its contact frames with deep overlaps, overlap (m), sidestep (m), median
# distance from the reference (m), drop of somebody's hips below the reference (m), share of frames with sliding feet.
_MOST_DEEP, _MOST_OVERLAP, _MOST_SHIFT, _MOST_ERROR, _MOST_DROP, _MOST_SLIDE = 0.1, 0.12, 1.2, 0.25, 0.35, 0.1
_SLIDING, _SLIDE_TIME = 0.25, 0.04
_ON_FLOOR = 0.035


class FailedSimulation(ValueError):
    """A clip that cannot be used; the message says why."""


@dataclass(frozen=True)
class Quality:
    """How a simulation went.

    Attributes:
        tracking_error_mm: Median distance of the joints from where the reference has them.
        contact_frames: Frames in which people touch each other, cloth included.
        penetration_mm: Deepest overlap of two people's solid parts, looked at every other physics step.
        deep_share: Share of the contact frames in which an overlap exceeds 40 mm.
        object_penetration_mm: Deepest overlap of a person and a thing, floor or wall.
        shift_m: Farthest that anybody in the way pushed a person off the planned path.
        foot_slide: Share of the time in which people have feet on the floor, and all heels and toes there, or both of
            one foot, move faster than 0.25 m/s over 0.04 s. What is below 35 mm before and after is on the floor.
        beyond_limits: Share of all joints' time in which the motion had them turn farther than people's do; it was kept
            within `synth.limits`.
    """

    tracking_error_mm: float
    contact_frames: int
    penetration_mm: float
    deep_share: float
    object_penetration_mm: float
    shift_m: float
    foot_slide: float
    beyond_limits: float


@dataclass(frozen=True)
class Overlaps:
    """The deepest overlaps of every frame.

    Attributes:
        persons: (F,) between people, m; below 0 where only cloth touches, -inf where nothing does.
        objects: (F,) of people with things, m.
    """

    persons: np.ndarray
    objects: np.ndarray


class Contacts:
    """Takes down all contacts of a simulation, step by step."""

    def __init__(self):
        self._frames: list[int] = []
        self._distances: list[np.ndarray] = []
        self._geoms: list[np.ndarray] = []

    def watch(self, data: mujoco.MjData, frame: int) -> None:
        """Take in the contacts of a step on the way to a frame."""
        if data.ncon:
            self._frames.append(frame)
            self._distances.append(data.contact.dist.copy())
            self._geoms.append(data.contact.geom.copy())

    def overlaps(self, geom_persons: np.ndarray, frames: int) -> Overlaps:
        """What they come to.

        Args:
            geom_persons: (ngeom,) person that each geom belongs to, -1 for things.
            frames: How many.
        """
        persons, objects = np.full(frames, -np.inf), np.full(frames, -np.inf)
        if self._frames:
            frame = np.repeat(self._frames, [len(distance) for distance in self._distances])
            depth = -np.concatenate(self._distances)
            one, other = geom_persons[np.concatenate(self._geoms)].T
            thing = np.minimum(one, other) < 0
            people = ~thing & (one != other)
            np.maximum.at(objects, frame[thing], depth[thing])
            np.maximum.at(persons, frame[people], depth[people])
        return Overlaps(persons, objects)


def assess(
    joints: np.ndarray, wanted: np.ndarray, overlaps: Overlaps, shifts: np.ndarray, fps: float, beyond: float
) -> Quality:
    """Sum a simulation up.

    Args:
        joints: (F, P, 39, 3) where the joints of `SKELETON` were, m.
        wanted: (F, P, 39, 3) where the reference had them, m.
        overlaps: Of every frame.
        shifts: (F, P, 2) how far people were pushed off their paths, m.
        fps: Frames per second.
        beyond: What `Quality.beyond_limits` is.

    Raises:
        FailedSimulation: the clip is unfit for use.
    """
    touching = np.isfinite(overlaps.persons)
    quality = Quality(
        tracking_error_mm=_mm(np.median(np.linalg.norm(joints - wanted, axis=-1))),
        contact_frames=int(touching.sum()),
        penetration_mm=_mm(max(0.0, overlaps.persons.max())),
        deep_share=round(float((overlaps.persons[touching] > DEEP).mean()) if touching.any() else 0.0, 4),
        object_penetration_mm=_mm(max(0.0, overlaps.objects.max())),
        shift_m=round(float(np.linalg.norm(shifts, axis=-1).max()), 4),
        foot_slide=_foot_slide(joints, fps),
        beyond_limits=round(beyond, 4),
    )
    (hips,) = SKELETON.index("body25.mid_hip")
    # Motion that skates by itself does so with any seed.
    slide = quality.foot_slide - _foot_slide(wanted, fps)
    drop = float((wanted - joints)[:, :, hips, 2].max())
    limits = [
        ("share of contact frames with overlaps above 40 mm", quality.deep_share, _MOST_DEEP),
        ("deepest overlap of two people, mm", quality.penetration_mm, 1000 * _MOST_OVERLAP),
        ("push off the planned path, m", quality.shift_m, _MOST_SHIFT),
        ("median tracking error, mm", quality.tracking_error_mm, 1000 * _MOST_ERROR),
        ("drop of somebody's hips, m", drop, _MOST_DROP),
        ("share of the time in which feet slide that were to stand", slide, _MOST_SLIDE),
    ]
    for what, found, most in limits:
        if not found <= most:
            raise FailedSimulation(f"{what}: {found:.3g}, at most {most:.3g} is fit for use")
    return quality


def _mm(metres: float) -> float:
    return round(1000 * float(metres), 2)


def _foot_slide(joints: np.ndarray, fps: float) -> float:
    soles = [SKELETON.index(f"body25.{side}_{point}")[0] for side in "lr" for point in ("big_toe", "heel")]
    points = joints[:, :, soles]
    # Over shorter times, what is measured is how feet tremble.
    step = max(1, round(_SLIDE_TIME * fps))
    speed = np.linalg.norm(points[step:, ..., :2] - points[:-step, ..., :2], axis=-1) * fps / step
    low = points[..., 2] < _ON_FLOOR
    bearing = low[step:] & low[:-step]
    slides = (speed > _SLIDING) | ~bearing
    flat, gliding = (every.reshape(*every.shape[:2], 2, 2).all(-1) for every in (bearing, slides))
    skates = (bearing.any(-1) & slides.all(-1)) | (flat & gliding).any(-1)
    return round(float(skates.mean()) if skates.size else 0.0, 4)
