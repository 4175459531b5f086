"""The quality of a simulation, and the limits beyond which it is unfit for use."""

from dataclasses import dataclass

import numpy as np

from synth.errors import FailedSimulation
from synth.people.landmarks import SKELETON
from synth.physics.contacts import Overlaps

DEEP = 0.04
"""Overlap of two people above which it is visible, m."""
# Limits of a clip: share of its contact frames with deep overlaps, overlap (m), sidestep (m), median distance from the
# reference (m), drop of hips below the reference (m), share of frames with sliding feet.
_MOST_DEEP, _MOST_OVERLAP, _MOST_SHIFT, _MOST_ERROR, _MOST_DROP, _MOST_SLIDE = 0.1, 0.12, 1.2, 0.25, 0.35, 0.1
_SLIDING, _SLIDE_TIME = 0.25, 0.04
_ON_FLOOR = 0.035


@dataclass(frozen=True)
class SimulationQuality:
    """The quality of a simulation.

    Attributes:
        tracking_error_mm: Median distance of the joints from the reference, mm.
        contact_frames: Number of frames in which people touch each other, cloth included.
        penetration_mm: Deepest overlap of two people's solid parts, measured every other physics step, mm.
        deep_share: Share of the contact frames in which an overlap exceeds 40 mm.
        object_penetration_mm: Deepest overlap of a person and an object, floor or wall, mm.
        shift_m: Greatest distance by which contact pushed a person off the planned path, m.
        foot_slide: Share of the time in which people have feet on the floor and slide: all heels and toes on the floor,
            or both of one foot, move faster than 0.25 m/s over 0.04 s. Points below 35 mm before and after are on the
            floor.
        beyond_limits: Share of joints, over all frames, in which the motion exceeded `synth.people.joint_limits`; it
            was limited.
    """

    tracking_error_mm: float
    contact_frames: int
    penetration_mm: float
    deep_share: float
    object_penetration_mm: float
    shift_m: float
    foot_slide: float
    beyond_limits: float


def assess(
    joints: np.ndarray, wanted: np.ndarray, overlaps: Overlaps, shifts: np.ndarray, fps: float, beyond: float
) -> SimulationQuality:
    """Assess a simulation.

    Args:
        joints: (F, P, 39, 3) simulated joints of `SKELETON`, m.
        wanted: (F, P, 39, 3) joints of the reference, m.
        overlaps: The deepest overlaps of every frame.
        shifts: (F, P, 2) displacements of people off their paths, m.
        fps: Frames per second.
        beyond: The value of `SimulationQuality.beyond_limits`.

    Raises:
        FailedSimulation: the clip is unfit for use.
    """
    contact = np.isfinite(overlaps.persons)
    quality = SimulationQuality(
        tracking_error_mm=_mm(np.median(np.linalg.norm(joints - wanted, axis=-1))),
        contact_frames=int(contact.sum()),
        penetration_mm=_mm(max(0.0, overlaps.persons.max())),
        deep_share=round(float((overlaps.persons[contact] > DEEP).mean()) if contact.any() else 0.0, 4),
        object_penetration_mm=_mm(max(0.0, overlaps.objects.max())),
        shift_m=round(float(np.linalg.norm(shifts, axis=-1).max()), 4),
        foot_slide=_foot_slide(joints, fps),
        beyond_limits=round(beyond, 4),
    )
    (hips,) = SKELETON.index("body25.mid_hip")
    # Sliding of the reference motion itself is not counted: another seed would not change it.
    slide = quality.foot_slide - _foot_slide(wanted, fps)
    drop = float((wanted - joints)[:, :, hips, 2].max())
    limits = [
        ("share of contact frames with overlaps above 40 mm", quality.deep_share, _MOST_DEEP),
        ("deepest overlap of two people, mm", quality.penetration_mm, 1000 * _MOST_OVERLAP),
        ("push off the planned path, m", quality.shift_m, _MOST_SHIFT),
        ("median tracking error, mm", quality.tracking_error_mm, 1000 * _MOST_ERROR),
        ("drop of a person's hips, m", drop, _MOST_DROP),
        ("share of the time in which standing feet slide", slide, _MOST_SLIDE),
    ]
    for what, found, most in limits:
        if not found <= most:
            raise FailedSimulation(f"{what}: {found:.3g}, at most {most:.3g} is allowed")
    return quality


def _mm(metres: float) -> float:
    return round(1000 * float(metres), 2)


def _foot_slide(joints: np.ndarray, fps: float) -> float:
    soles = [SKELETON.index(f"body25.{side}_{point}")[0] for side in "lr" for point in ("big_toe", "heel")]
    points = joints[:, :, soles]
    # Over shorter times the tremor of feet dominates.
    step = max(1, round(_SLIDE_TIME * fps))
    speed = np.linalg.norm(points[step:, ..., :2] - points[:-step, ..., :2], axis=-1) * fps / step
    low = points[..., 2] < _ON_FLOOR
    bearing = low[step:] & low[:-step]
    slides = (speed > _SLIDING) | ~bearing
    flat, gliding = (every.reshape(*every.shape[:2], 2, 2).all(-1) for every in (bearing, slides))
    skates = (bearing.any(-1) & slides.all(-1)) | (flat & gliding).any(-1)
    return round(float(skates.mean()) if skates.size else 0.0, 4)
