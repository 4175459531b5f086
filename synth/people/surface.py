"""The bare surface of a person: shape from stature, mass, sex and age, fitted to the skeleton, and how it bends.

The assets are MakeHuman's, converted by `docs/tools/body_assets.py`. A body is a weighted mean of shapes by age, sex
and weight. Its bones are brought to the lengths of the person's segments, its volume to the person's mass. The result
is in the pose of the assets, the bind pose, from which linear blend skinning moves it to any other.
"""

from dataclasses import dataclass, fields
from functools import cache, lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from synth.people.body import ANKLE_HEIGHT, HEAD_HEIGHT, PARENTS, SEGMENTS, SIDES, Body, side_and_name, trunk_sections
from synth.people.hands import STILL, Fingers

ASSETS = Path(__file__).with_name("surface.npz")
BONES = SEGMENTS + tuple(f"{side}_finger{f}-{k}" for side in SIDES for f in range(1, 6) for k in range(1, 4))
"""Bones of the assets: our segments, and three bones for each finger from the thumb on."""
_UNIT = 5e-5
"""Resolution of places in the file, m."""


@dataclass(frozen=True)
class Assets:
    """A surface of N vertices in S shapes. x points forward, y to the left, z up."""

    shapes: np.ndarray  # (S, N, 3) m. Shapes by age (1, 11, 18 to 45, and 85 years), in them by sex, in them by weight.
    joints: np.ndarray  # (S, 56, 3) m. The origin of each segment; then, for each finger, three joints and the tip.
    faces: np.ndarray  # (T, 3) triangles, counter-clockwise seen from outside; the surface is closed
    bones: np.ndarray  # (N, 4) index into `BONES`
    weights: np.ndarray  # (N, 4) weights of these bones, sum 1
    eyes: np.ndarray  # (S, 2, E, 3) balls of the left and the right eye, m
    eye_faces: np.ndarray  # (U, 3) triangles of either

    def save(self, path: Path) -> None:
        """Write the file. Places are whole numbers of `_UNIT`, weights of 1/65535."""
        arrays = {each.name: getattr(self, each.name) for each in fields(self)}
        for name in ("shapes", "joints", "eyes"):
            steps = np.round(arrays[name] / _UNIT).astype(np.int16)
            arrays[name] = np.concatenate([steps[:1], steps[1:] - steps[:1]])
        arrays["weights"] = np.round(arrays["weights"] * 65535).astype(np.uint16)
        np.savez_compressed(path, **arrays)


@cache
def assets() -> Assets:
    """Return the assets of the package."""
    with np.load(ASSETS) as file:
        arrays = dict(file)
    for name in ("shapes", "joints", "eyes"):
        steps = arrays[name].astype(float) * _UNIT
        steps[1:] += steps[:1]
        arrays[name] = steps
    weights = arrays["weights"].astype(float)
    arrays["weights"] = weights / weights.sum(1, keepdims=True)
    return Assets(**arrays)


# The shape of a person, and its fit to the skeleton

_AGES = ((1, 0), (11, 1), (18, 2), (45, 2), (85, 3))
"""Ages, years, and the number of the shape."""
DENSITY = 985.0
"""Density of a body with air in its lungs, kg/m^3; without air it is about 1050."""
_FOOT = (-0.043, 0.105)
"""Heel and toes of a bare foot relative to the ankle, fractions of stature."""
_SOLE = 0.006
"""Thickness of a shoe's sole, fraction of stature."""


@dataclass(frozen=True)
class BareBody:
    """The bare surface of a person in the bind pose."""

    vertices: np.ndarray  # (N, 3) m; the mid point of the hip joints is the origin
    # (N, 16) weights of `SEGMENTS`, sum 1; if fingers move, (N, 46): then of `FINGER_BONES`, the parts of their hands'
    # weights that they take
    weights: np.ndarray
    rotations: np.ndarray  # (16, 3, 3) orientation of each segment, the identity in T-pose
    origins: np.ndarray  # (16, 3) origin of each segment, m
    eyes: np.ndarray  # (2, E, 3) balls of the eyes, m
    fingers: Fingers  # The bones of the fingers in the pose of the assets


def volume(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Return the volume within a closed surface, m^3."""
    one, two, three = vertices[faces.T]
    return float(np.einsum("ti,ti->", one, np.cross(two, three)) / 6)


@lru_cache(maxsize=64)
def bare_body(body: Body, hands: tuple[str, str] | None = ("relaxed", "relaxed")) -> BareBody:
    """Return the surface of a person.

    Args:
        body: Proportions. The surface has this mass, within the accuracy of MakeHuman's shapes.
        hands: Shapes of the left and the right hand, of `synth.people.clothing.HANDS`; None for hands as in the
            assets, whose fingers follow bones.
    """
    heavy, stout = _build(body)
    shape, joints, eyes = _shape(body, heavy)
    each, weights = _weights()
    fingers = Fingers.of(joints)
    if hands is not None:
        shape = _posed_hands(shape, each, fingers, hands)
    fit = _fitted(body, stout, shape, joints, eyes)
    if hands is None:
        weights = np.concatenate([weights, each[:, len(SEGMENTS) :]], axis=1)
    head, palms = SEGMENTS.index("head"), [SEGMENTS.index(f"{side}_hand") for side in SIDES]
    return BareBody(
        fit.vertices,
        weights,
        fit.rotations,
        fit.origins,
        eyes @ fit.linear[head].T + fit.shift[head],
        fingers.scaled(fit.linear[palms], fit.shift[palms]),
    )


@lru_cache(maxsize=64)
def _build(body: Body) -> tuple[float, float]:
    """Return how heavy a shape is, 0 to 2, and how much wider it becomes, so that it has the mass of a body."""

    def found(heavy: float, stout: float) -> float:
        return volume(_fitted(body, stout, *_shape(body, heavy)).vertices, assets().faces)

    goal = body.mass / DENSITY
    low, high, stout = 0.0, 2.0, 1.0
    spans = [found(heavy, stout) for heavy in (low, high)]
    if spans[0] < goal < spans[1]:
        for _ in range(12):
            heavy = low + (high - low) * (goal - spans[0]) / (spans[1] - spans[0])
            size = found(heavy, stout)
            if abs(size / goal - 1) < 1e-3:
                break
            if size < goal:
                low, spans[0] = heavy, size
            else:
                high, spans[1] = heavy, size
    else:
        heavy = low if goal <= spans[0] else high
        for _ in range(4):
            stout *= np.sqrt(goal / found(heavy, stout))
    return heavy, stout


def _shape(body: Body, heavy: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices, joints and eyes of the mean of the shapes for a body, in the pose of the assets, m."""
    shares = _mixed(body, heavy)
    shape, joints, eyes = (np.tensordot(shares, each, 1) for each in (assets().shapes, assets().joints, assets().eyes))
    return shape, joints, eyes


def _mixed(body: Body, heavy: float) -> np.ndarray:
    """Return the (S,) shares of the shapes. `heavy` is 0 for the least weight, 1 for the average, 2 for the most."""
    age = np.interp(body.age, *np.array(_AGES).T)
    shares = [
        np.clip(1 - np.abs(np.arange(count) - at), 0, 1) for count, at in ((4, age), (2, body.figure), (3, heavy))
    ]
    return np.einsum("a,s,w->asw", *shares).ravel()


@cache
def _weights() -> tuple[np.ndarray, np.ndarray]:
    """Return the weights of `BONES` (N, 46) and of `SEGMENTS` (N, 16), whose hands include fingers."""
    each = np.zeros((len(assets().bones), len(BONES)))
    np.put_along_axis(each, assets().bones.astype(int), assets().weights, 1)
    weights = each[:, : len(SEGMENTS)].copy()
    for side, fingers in zip(SIDES, np.split(np.arange(len(SEGMENTS), len(BONES)), 2), strict=True):
        weights[:, SEGMENTS.index(f"{side}_hand")] += each[:, fingers].sum(1)
    return each, weights


class _Fit(NamedTuple):
    """A shape fitted to the segments of a body."""

    vertices: np.ndarray  # (N, 3) m
    rotations: np.ndarray  # (16, 3, 3) orientation of each segment
    origins: np.ndarray  # (16, 3) m
    # linear, shift: (16, 3, 3) and (16, 3) m, how each segment was scaled and moved
    linear: np.ndarray
    shift: np.ndarray


def _fitted(body: Body, stout: float, shape: np.ndarray, joints: np.ndarray, eyes: np.ndarray) -> _Fit:
    """Fit a shape to the segments; `stout` widens it further."""
    _, weights = _weights()
    rotations = _bind_rotations(joints)
    origins = np.zeros((len(SEGMENTS), 3))
    for i, parent in enumerate(PARENTS[1:], start=1):
        origins[i] = origins[parent] + rotations[parent] @ body.offsets[i]

    size = body.stature / (shape[:, 2].max() - shape[:, 2].min())
    linear, shift = np.empty((len(SEGMENTS), 3, 3)), np.empty((len(SEGMENTS), 3))
    arms, hips = ([SEGMENTS.index(f"{side}_{name}") for side in SIDES] for name in ("upper_arm", "thigh"))
    middle, (high, mine) = joints[hips].mean(0), (joints[arms].mean(0) - joints[hips].mean(0), origins[arms].mean(0))
    trunk = np.diag([size * stout, size * stout, mine[2] / high[2]])
    trunk[0, 2] = (mine[0] - size * stout * high[0]) / high[2]
    for i, segment in enumerate(SEGMENTS):
        _, name = side_and_name(segment)
        at = joints[i]
        if name in ("pelvis", "spine", "chest"):
            linear[i], shift[i] = trunk, -trunk @ middle
            continue
        if name == "head":
            scale, shift[i] = _head_fit(body, shape, joints, eyes, weights[:, i], origins[i])
            linear[i] = np.diag(scale)
            continue
        if name == "hand":
            linear[i] = np.eye(3) * size * body.arms
        elif name == "foot":
            own = shape[weights[:, i] > 0.9] - at
            along = rotations[i][:, 0]
            heel, toes = (own @ along).min(), (own @ along).max()
            long = (_FOOT[1] - _FOOT[0]) * body.stature / (toes - heel)
            tall = (ANKLE_HEIGHT - _SOLE) * body.stature / -own[:, 2].min()
            linear[i] = rotations[i] @ np.diag([long, size, tall]) @ rotations[i].T
            at = at + along * (heel - _FOOT[0] * body.stature / long)
        else:
            bone, wanted = joints[i + 1] - at, origins[i + 1] - origins[i]
            length = np.linalg.norm(bone)
            along, wide = bone / length, size * stout
            linear[i] = wide * np.eye(3) + (np.linalg.norm(wanted) / length - wide) * np.outer(along, along)
        shift[i] = origins[i] - linear[i] @ at
    moved = np.einsum("ns,sij,nj->ni", weights, linear, shape, optimize=True) + weights @ shift
    moved[:, 0] += _trunk_shift(body, moved)
    for i, segment in enumerate(SEGMENTS):
        wider = np.interp(body.figure, (0, 1), _ENDS.get(side_and_name(segment)[1], (1, 1))) - 1
        if wider:
            out, bone = moved - origins[i], origins[i + 1] - origins[i]
            place = out @ bone / (bone @ bone)
            near = wider * np.interp(place, (0.55, 0.9, 1.0, 1.15), (0, 1, 1, 0)) * weights[:, [i, i + 1]].sum(1)
            moved += near[:, None] * (out - np.outer(place, bone))
    return _Fit(moved, rotations, origins, linear, shift)


_ENDS = {"forearm": (0.95, 1.14), "shin": (0.96, 1.08)}
"""Widths of wrists and ankles relative to MakeHuman's, of men and of women, after ANSUR II."""
_AROUND_HIPS = ("pelvis", "spine", "chest", "thigh")
_LEVELS = np.array((-0.2, -0.03, 0.0, 0.03, 0.06, 0.09, 0.12, 0.15, 0.18, 0.21, 0.24, 0.27, 0.29, 0.32))
"""Heights above the hip joints, fractions of stature, at which the trunk is centred, but for the first and last."""


@cache
def _weight_around_hips() -> np.ndarray:
    return _weights()[1][:, [i for i, each in enumerate(SEGMENTS) if side_and_name(each)[1] in _AROUND_HIPS]].sum(1)


def _trunk_shift(body: Body, vertices: np.ndarray) -> np.ndarray:
    """Return the (N,) shifts along x that centre the trunk on `trunk_sections`: MakeHuman's joints are too far back."""
    wanted, level = trunk_sections(body, _LEVELS).T[:2]
    own = _weight_around_hips()
    shifts = np.zeros(len(_LEVELS))
    for k in range(1, len(_LEVELS) - 1):
        ring = vertices[(own > 0.5) & (np.abs(vertices[:, 2] - level[k]) < 0.015 * body.stature), 0]
        shifts[k] = wanted[k] - (ring.min() + ring.max()) / 2
    return own * PchipInterpolator(level, shifts)(vertices[:, 2].clip(level[0], level[-1]))


def _bind_rotations(joints: np.ndarray) -> np.ndarray:
    """Return the (16, 3, 3) orientations of segments in the pose of joints (56, 3): arms lowered, legs apart."""
    rotations = np.tile(np.eye(3), (len(SEGMENTS), 1, 1))
    for i, segment in enumerate(SEGMENTS):
        side, name = side_and_name(segment)
        if not side:
            continue
        sign, fingers = SIDES[side], joints[len(SEGMENTS) :].reshape(2, 5, 4, 3)["lr".index(side)]
        if name in ("hand", "forearm"):
            # From the little finger's knuckle to the index finger's, the thumb's side.
            ahead = fingers[1, 0] - fingers[4, 0]
            along = sign * ((fingers[1:, 0].mean(0) if name == "hand" else joints[i + 1]) - joints[i])
            rotations[i] = _frame(along, ahead, (1, 0))
        elif name == "upper_arm":
            rotations[i] = _frame(sign * (joints[i + 1] - joints[i]), np.array((1.0, 0, 0)), (1, 0))
        elif name in ("thigh", "shin"):
            rotations[i] = _frame(joints[i] - joints[i + 1], np.array((1.0, 0, 0)), (2, 0))
        else:
            rotations[i] = _frame(np.array((0, 0, 1.0)), rotations[i - 1][:, 0], (2, 0))
    return rotations


def _frame(first: np.ndarray, second: np.ndarray, axes: tuple[int, int]) -> np.ndarray:
    """Return a rotation whose column `axes[0]` is along `first`, and whose column `axes[1]` is near `second`."""
    frame = np.empty((3, 3))
    frame[:, axes[0]] = first / np.linalg.norm(first)
    near = second - (second @ frame[:, axes[0]]) * frame[:, axes[0]]
    frame[:, axes[1]] = near / np.linalg.norm(near)
    last = 3 - sum(axes)
    (a, b, c), (d, e, f) = frame[:, (last + 1) % 3].tolist(), frame[:, (last + 2) % 3].tolist()
    frame[:, last] = b * f - c * e, c * d - a * f, a * e - b * d
    return frame


# Where nose, eyes, ears and crown are, relative to the joint of the head, fractions of stature and of the head's size.
_NOSE, EYES, _EARS = (0.073, 0.068), (0.056, 0.091), (0.003, 0.046, 0.082)


def _head_fit(body, shape, joints, eyes, weight, origin) -> tuple[np.ndarray, np.ndarray]:
    """Return scale (3,) and shift (3,) that bring nose, eyes, ears and crown to their places."""
    own = shape[weight > 0.95]
    middle = own[np.abs(own[:, 1]) < 0.012]
    eye = eyes.reshape(2, -1, 3)
    front = np.array([eye[0, :, 0].max(), eye[0].mean(0)[1], eye[0].mean(0)[2]])
    nose = middle[(middle[:, 2] < front[2]) & (middle[:, 2] > front[2] - 0.08)]
    nose = nose[nose[:, 0].argmax()]
    ear = own[own[:, 1] > own[:, 1].max() - 0.012].mean(0)
    size = body.stature * body.head
    places = [
        ([nose[0], front[0], ear[0]], [_NOSE[0], EYES[0], _EARS[0]]),
        ([-ear[1], ear[1]], [-_EARS[1], _EARS[1]]),
        ([nose[2], front[2], ear[2], own[:, 2].max()], [_NOSE[1], EYES[1], _EARS[2], HEAD_HEIGHT]),
    ]
    scale, shift = np.array([np.polyfit(here, np.array(there) * size, 1) for here, there in places]).T
    return scale, shift + origin


def _posed_hands(shape: np.ndarray, weights: np.ndarray, fingers: Fingers, hands: tuple[str, str]) -> np.ndarray:
    """Return the vertices with the fingers of both hands bent, from the pose of the assets."""
    turns, begins = fingers.posed(np.stack([STILL[name] for name in hands]))
    bones = zip(
        weights[:, len(SEGMENTS) :].T, *(each.reshape(30, *each.shape[3:]) for each in (turns, begins)), strict=True
    )
    moved, total = np.zeros_like(shape), np.zeros(len(shape))
    for (share, turn, begin), start in zip(bones, fingers.joints.reshape(-1, 3), strict=True):
        own = np.flatnonzero(share)
        moved[own] += share[own, None] * (begin + (shape[own] - start) @ turn.T)
        total += share
    return moved + (1 - total[:, None]) * shape
