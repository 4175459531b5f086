"""Kinematics of one person's joints: angles, speeds, accelerations, and feet on the floor."""

from dataclasses import dataclass

import numpy as np

from dmae.data.skeleton import BODY25
from dmae.numerics.paths import local_parabola

SMOOTHING = 0.04
"""Standard deviation of the Gaussian weights with which a parabola is fitted to each joint, s.

It halves the power at 6 Hz, a usual cut-off frequency of gait laboratories: Winter, Biomechanics and Motor Control
(4th ed.), ch. 3."""


@dataclass(frozen=True)
class Quantity:
    """A quantity measured on a person, the same for the left and the right side where there are two."""

    name: str  # Unique label for reports
    unit: str  # Unit of its values
    span: tuple[float, float]  # Least and greatest value that a figure shows
    log: bool = False  # Whether the figure has a logarithmic axis


def _row(kind: str, unit: str, span: tuple[float, float], *names: str) -> tuple[Quantity, ...]:
    return tuple(Quantity(f"{name}, {kind}", unit, span, log=True) for name in names)


_OUTWARD = np.array((1.0, -1.0))[:, None]
"""(2, 1) sign of y that points outward, on the left and on the right side."""
_FLEXED = ("hip flexion", "knee flexion", "ankle flexion", "arm raised", "elbow flexion")
GROUPS = {
    "Legs and pelvis": (
        Quantity("hip flexion", "°", (-40, 140)),
        Quantity("hip abduction", "°", (-25, 45)),
        Quantity("knee flexion", "°", (0, 120)),
        Quantity("ankle flexion", "°", (-70, 60)),
        Quantity("pelvis tilt, left up", "°", (-20, 20)),
    ),
    "Trunk and head": (
        Quantity("trunk lean, forward", "°", (-20, 80)),
        Quantity("trunk lean, left", "°", (-30, 30)),
        Quantity("trunk twist, left", "°", (-40, 40)),
        Quantity("head turn, left", "°", (-70, 70)),
        Quantity("face, up", "°", (-90, 50)),
    ),
    "Arms": (
        Quantity("arm raised", "°", (0, 150)),
        Quantity("arm forward", "°", (-60, 90)),
        Quantity("arm outward", "°", (-40, 90)),
        Quantity("elbow flexion", "°", (0, 140)),
        Quantity("arms raised unequally", "°", (0, 100)),
    ),
    "Stance": (
        Quantity("hip height, legs", "%", (70, 120)),
        Quantity("feet apart", "m", (-0.2, 0.8)),
        Quantity("foot over floor", "cm", (0, 25)),
        Quantity("foot slide", "cm/s", (0.1, 300), log=True),
        Quantity("hand over hips", "m", (-0.5, 0.8)),
    ),
    "Angular speed": _row("speed", "°/s", (0.1, 1000), *_FLEXED),
    "Angular acceleration": _row("acceleration", "°/s²", (1, 10000), *_FLEXED),
    "Speed": (
        Quantity("hips along floor, speed", "m/s", (0.003, 5), log=True),
        Quantity("hips up and down, speed", "m/s", (0.001, 3), log=True),
        Quantity("pelvis turning, speed", "°/s", (0.3, 500), log=True),
        Quantity("ankle, speed", "m/s", (0.001, 8), log=True),
        Quantity("wrist from hips, speed", "m/s", (0.003, 5), log=True),
    ),
    "Acceleration": _row("acceleration", "m/s²", (0.01, 100), "hips", "head", "knee", "ankle", "wrist"),
}
"""The quantities, in rows of five."""
QUANTITIES = tuple(quantity for group in GROUPS.values() for quantity in group)


def kinematics(xyz: np.ndarray, fps: float) -> dict[str, np.ndarray]:
    """Return all `QUANTITIES` in every frame by name: (F,), or (F, 2) for quantities with two sides; NaN where unknown.

    Angles are between lines from joint to joint, so they mean the same for any skeleton. Angles of hips and arms are
    relative to the trunk (mid hip to neck) and the line through both hips or shoulders. "From hips" is relative to the
    mid hip, in axes that turn about the vertical with the hips.

    Args:
        xyz: (F, 25, 3) joints of `BODY25`, m, world, floor at z = 0; NaN where unknown.
        fps: Frames per second. Speeds are central differences of smoothed positions; see `SMOOTHING`.
    """
    xyz = local_parabola(np.asarray(xyz, np.float64), SMOOTHING * fps)
    hip, knee, ankle, toe, heel, shoulder, elbow, wrist, ear = (
        xyz[:, BODY25.index(f"l_{part}", f"r_{part}")]
        for part in ("hip", "knee", "ankle", "big_toe", "heel", "shoulder", "elbow", "wrist", "ear")
    )
    middle, neck, nose = np.moveaxis(xyz[:, BODY25.index("mid_hip", "neck", "nose")], 1, 0)
    up, vertical = _unit(neck - middle), np.array((0.0, 0.0, 1.0))

    thigh, shin, down = _unit(knee - hip), _unit(ankle - knee), -up[:, None]
    forward, left, _ = _axes(hip, up)
    values = {
        "hip flexion": _angle(_dot(thigh, forward[:, None]), _dot(thigh, down)),
        "hip abduction": _elevation(_dot(thigh, left[:, None] * _OUTWARD)),
        "knee flexion": _between(thigh, shin),
        "ankle flexion": -_elevation(_dot(shin, _unit(toe - heel))),
    }
    upper, fore = _unit(elbow - shoulder), _unit(wrist - elbow)
    forward, left, _ = _axes(shoulder, up)
    raised = _between(upper, down)
    values |= {
        "arm raised": raised,
        "arm forward": _elevation(_dot(upper, forward[:, None])),
        "arm outward": _elevation(_dot(upper, left[:, None] * _OUTWARD)),
        "elbow flexion": _between(upper, fore),
        "arms raised unequally": np.abs(raised[:, 0] - raised[:, 1]),
    }
    # The level axes of hips and of shoulders.
    level, shoulders, face = _axes(hip, vertical), _axes(shoulder, vertical), nose - ear.mean(1)
    values |= {
        "pelvis tilt, left up": _elevation(_unit(hip[:, 0] - hip[:, 1])[:, 2]),
        "trunk lean, forward": _angle(_dot(up, level[0]), up[:, 2]),
        "trunk lean, left": _angle(_dot(up, level[1]), up[:, 2]),
        "trunk twist, left": _angle(_dot(shoulders[0], level[1]), _dot(shoulders[0], level[0])),
        "head turn, left": _angle(_dot(face, shoulders[1]), _dot(face, shoulders[0])),
        "face, up": _elevation(_unit(face)[:, 2]),
    }

    lengths = np.linalg.norm(knee - hip, axis=-1) + np.linalg.norm(ankle - knee, axis=-1)
    leg = float(np.median(known)) if (known := lengths[lengths > 0]).size else np.nan
    sole = np.stack([toe, heel], axis=2)
    # The slowest sole point is the support: a heel or a toe may stay in place while the rest turns about it.
    slide = np.linalg.norm(_speed(sole, fps)[..., :2], axis=-1).min((1, 2))
    values |= {
        "hip height, legs": 100 * middle[:, 2] / leg,
        "feet apart": _dot(ankle[:, 0] - ankle[:, 1], level[1]),
        "foot over floor": 100 * sole[..., 2].min(-1),
        "foot slide": 100 * slide,
        "hand over hips": wrist[..., 2] - middle[:, None, 2],
    }
    for name in _FLEXED:
        values[f"{name}, speed"] = np.abs(_speed(values[name], fps))
        values[f"{name}, acceleration"] = np.abs(_acceleration(values[name], fps))
    # In axes that turn about the vertical with the hips.
    wrist_from_hips = np.stack([_dot(wrist - middle[:, None], axis[:, None]) for axis in level], axis=-1)
    before, after = level[1][:-2], level[1][2:]
    turned = _angle(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], _dot(before, after))
    turning = np.pad(np.abs(turned) * fps / 2, 1, constant_values=np.nan)
    values |= {
        "hips along floor, speed": np.linalg.norm(_speed(middle, fps)[:, :2], axis=-1),
        "hips up and down, speed": np.abs(_speed(middle, fps)[:, 2]),
        "pelvis turning, speed": turning,
        "ankle, speed": np.linalg.norm(_speed(ankle, fps), axis=-1),
        "wrist from hips, speed": np.linalg.norm(_speed(wrist_from_hips, fps), axis=-1),
    }
    joints = {"hips": middle, "head": ear.mean(1), "knee": knee, "ankle": ankle, "wrist": wrist}
    for name, joint in joints.items():
        values[f"{name}, acceleration"] = np.linalg.norm(_acceleration(joint, fps), axis=-1)
    return values


def _axes(pair: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the forward, left and up axes, (F, 3) each, from pairs of left and right joints (F, 2, 3)."""
    forward = _unit(np.cross(pair[:, 0] - pair[:, 1], up))
    return forward, np.cross(up, forward), np.broadcast_to(up, forward.shape)


def _unit(vectors: np.ndarray) -> np.ndarray:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    # The direction between joints in the same place is undefined.
    return vectors / np.where(length > 0, length, np.nan)


def _dot(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return (one * other).sum(-1)


def _angle(sine: np.ndarray, cosine: np.ndarray) -> np.ndarray:
    return np.degrees(np.arctan2(sine, cosine))


def _elevation(sine: np.ndarray) -> np.ndarray:
    return np.degrees(np.arcsin(np.clip(sine, -1, 1)))


def _between(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip(_dot(one, other), -1, 1)))


def _speed(values: np.ndarray, fps: float) -> np.ndarray:
    """Return central differences per second; NaN in the first and the last frame."""
    speed = np.full_like(values, np.nan)
    speed[1:-1] = (values[2:] - values[:-2]) * fps / 2
    return speed


def _acceleration(values: np.ndarray, fps: float) -> np.ndarray:
    acceleration = np.full_like(values, np.nan)
    acceleration[1:-1] = (values[2:] - 2 * values[1:-1] + values[:-2]) * fps**2
    return acceleration
