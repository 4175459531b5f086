"""People's joints as motions of the Unitree G1, a humanoid of 1.32 m with 29 motors.

1. **Scale.** The floor plan of a clip is scaled by one factor, so that people keep their places relative to each other;
   heights by the legs of each person. Limbs get the robot's lengths in the directions of the person's.
2. **Hold feet.** While a foot stands flat, its target does not move; in between, it follows the person's foot.
3. **Touch.** A hand that is at another person's hand, arm or trunk is led to the same place of the other robot.
4. **Solve.** In each frame `mink` moves all robots of the clip towards their targets, within the limits of position and
   speed of their motors, and not into each other: differential inverse kinematics, a quadratic program on MuJoCo's
   kinematics.

MuJoCo serves as kinematics only: no forces, no balance. The motion is a reference for a controller.
"""

import importlib.util
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from dmae.data.clip import Poses3D, Source, person_name
from dmae.numerics.filling import STILLS, are_stills, fill_body_frame, smooth
from dmae.numerics.kinematics import ADVICE
from dmae.numerics.paths import linear, neighbours, pchip, runs

if TYPE_CHECKING:
    import mink
    import mujoco

SIDES = ("left", "right")
_MOTORS = {"hip_pitch": 32, "hip_roll": 20, "hip_yaw": 32, "knee": 20, "ankle": 37, "waist_yaw": 32, "waist": 37,
           "shoulder": 37, "elbow": 37, "wrist_roll": 37, "wrist": 22}  # fmt: skip
"""rad/s; speeds of the motors without load, by the start of the joint's name without its side, as Unitree states them
in the G1's URDF."""
_SPEED_SHARE = 0.25  # Share of the speed without load that is used
_MARGIN = 0.01  # rad; distance that is kept from limits of position
_SMOOTHING = 0.05  # s; standard deviation of the weights that smooth joints before they are followed
_STAND_HEIGHT, _STAND_SPEED = 0.04, 0.25
"""m above its lowest, m/s: below both, a heel or toe stands. A foot without them: its ankle."""
_STAND_TIME, _STEP_TIME = 0.1, 0.2
"""s; a foot stands at least this long; from free motion to standing and back takes this long."""
_TURN = 0.7  # rad; feet are turned at most this far from the pelvis
_CROUCH = 0.96  # The robot's legs are longest at this share of their length, so that knees do not become singular
_TOUCH = 0.05  # m between the surfaces of a palm and of another person's limb or trunk; nearer counts as touching
_TOUCH_TIME = 0.15  # s; briefer touches that joints show, and interruptions of touches, are ignored
_REACH_TIME = 0.3  # s; how long before and after it touches a hand is led to its place
_RATE = 100.0  # Steps per second of the solver, at least; a frame has one or more
_RADII = {"trunk": 0.13, "upper_arm": 0.05, "forearm": 0.04, "hand": 0.03}
"""m; half the thickness of people's parts, at a stature of 1.7 m."""
_TRUNK_BREADTH = 0.17  # m; the same of a trunk from side to side
_WRIST = 0.8  # From this share of a forearm on, a contact is one of the hand
_PALM_AHEAD = 0.09  # m from wrist to the middle of the palm, along the forearm, at a stature of 1.7 m
_NEEDED = ("l_hip", "r_hip", "l_ankle", "r_ankle", "l_shoulder", "r_shoulder")

_JOINTS = {
    "hip": ("hip", "knee"), "knee": ("hip", "knee", "ankle"), "ankle": ("knee", "ankle"),
    "shoulder": ("shoulder", "elbow"), "elbow": ("shoulder", "elbow", "wrist"), "wrist": ("wrist",),
}  # fmt: skip
"""Joints of a person, by joint of the robot, that determine its angle. Hips and shoulders determine the waist."""


@dataclass(frozen=True)
class RobotMotion:
    """Motions of P robots in F frames, one for each person."""

    joints: tuple[str, ...]  # Names of the n motors, in the order of the model
    qpos: np.ndarray  # (F, P, 7 + n) base position, m, base quaternion, w first, and angles, rad; never NaN
    # (F, P, n) weakest `Source` of the joints that determine an angle. Where it is absent or completed, it is not
    # measured, as the wrists: a person's hands are not measured, and wrists only place palms.
    source: np.ndarray
    standing: np.ndarray  # (F, P, 2) True where the left and the right foot stand flat
    touching: np.ndarray  # (F, P, 2) True where the left and the right hand touch another person
    # (F, P, 4) m from the robot's elbows and palms to their targets, left before right; NaN without
    residual: np.ndarray
    scale: float  # Size of the robots' floor plan relative to the people's

    def every(self, frames: int) -> "RobotMotion":
        """Return one frame in `frames`."""
        arrays = ("qpos", "source", "standing", "touching", "residual")
        return replace(self, **{name: getattr(self, name)[::frames] for name in arrays})


@dataclass(frozen=True)
class Contact:
    """A hand that touches a part of another person, in F frames."""

    # person, side: Whose hand; 0 is the left one
    person: int
    side: int
    # other, part, other_side: Whose `trunk`, `upper_arm`, `forearm` or `hand`; the side is 0 for the trunk
    other: int
    part: str
    other_side: int
    point: np.ndarray  # (F, 3) m, world, where it touches; NaN where it does not


_BODIES = ("hip_roll", "knee", "ankle_roll", "shoulder_roll", "elbow", "wrist_yaw")
"""Links between which limbs are measured, on each side."""
_HAND = np.array([[0.11, -0.01, 0.0], [0.11, 0.01, 0.0]])
"""m; middle of the left and the right rubber hand from the joint of the wrist's yaw, where targets of palms act."""


def find_model(path: str | None = None) -> Path:
    """Return the file of `load_robot`."""
    if path is not None:
        if not Path(path).is_file():
            raise FileNotFoundError(f"robot={path}: no such file; expected the MJCF of a Unitree G1 with 29 motors")
        return Path(path)
    found = importlib.util.find_spec("mjlab")
    for root in (found.submodule_search_locations or ()) if found else ():
        model = Path(root) / "asset_zoo" / "robots" / "unitree_g1" / "xmls" / "g1.xml"
        if model.is_file():
            return model
    raise FileNotFoundError(
        "no model of the robot: `pip install --no-deps mjlab` installs one, without that program's dependencies; or "
        "give robot=..., the MJCF of a Unitree G1 with 29 motors"
    )


def load_robot(path: str | None = None) -> "mujoco.MjModel":
    """Return the robot's kinematics: the model without its meshes, with sites `left_hand` and `right_hand`.

    Args:
        path: MJCF of the G1; by default that of an installed `mjlab`, which is found but not imported.

    Raises:
        FileNotFoundError: there is none.
        ValueError: mink is not installed, or the file is malformed or not of a G1 with 29 motors.
    """
    if importlib.util.find_spec("mink") is None:
        raise ValueError("robots need mink: pip install 'dmae-synth[robots]'")
    import mujoco

    file = find_model(path)
    try:
        spec = mujoco.MjSpec.from_file(str(file))
        for geom in list(spec.geoms):
            if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
                spec.delete(geom)
        for mesh in list(spec.meshes):
            spec.delete(mesh)
        names = {body.name for body in spec.bodies}
        lacking = [f"{side}_{part}_link" for side in SIDES for part in _BODIES if f"{side}_{part}_link" not in names]
        if lacking or not {"pelvis", "torso_link"} <= names:
            raise ValueError(f"no body {(lacking or ['torso_link'])[0]!r}")
        for side, place in zip(SIDES, _HAND, strict=True):
            spec.body(f"{side}_wrist_yaw_link").add_site(name=f"{side}_hand", pos=place)
        model = spec.compile()
    except ValueError as error:
        raise ValueError(f"{file}: expected the MJCF of a Unitree G1; {str(error).splitlines()[0]}") from None
    if model.nq != 7 + 29:
        raise ValueError(f"{file}: expected a Unitree G1 with 29 motors on a free base, found {model.nq - 7} angles")
    return model


@dataclass(frozen=True)
class _Robot:
    """Measures of the robot, m, from its zero pose, in which it stands upright and its forearms point ahead (x)."""

    hip: np.ndarray  # (2, 3) from the pelvis
    waist: np.ndarray  # (3,) from the pelvis
    shoulder: np.ndarray  # (2, 3) from the waist
    thigh: float
    shin: float
    upper_arm: float
    forearm: float  # to the palm
    heel_tip: np.ndarray  # (2, 3) ends of a sole from the ankle

    @classmethod
    def measure(cls, model: "mujoco.MjModel") -> "_Robot":
        import mujoco

        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        hip, knee, ankle, shoulder, elbow, _ = (
            np.stack([data.body(f"{side}_{part}_link").xpos for side in SIDES]) for part in _BODIES
        )
        hand = np.stack([data.site(f"{side}_hand").xpos for side in SIDES])
        pelvis, waist = data.body("pelvis").xpos, data.body("torso_link").xpos
        foot = model.body(f"{SIDES[0]}_ankle_roll_link").id
        ends = np.concatenate(
            [_ends(model, data, geom) for geom in range(model.ngeom) if model.geom_bodyid[geom] == foot]
        )
        sole = ends[:, 2].min() - ankle[0, 2]
        heel_tip = np.array([[ends[:, 0].min() - ankle[0, 0], 0, sole], [ends[:, 0].max() - ankle[0, 0], 0, sole]])
        limbs = ((hip, knee), (knee, ankle), (shoulder, elbow), (elbow, hand))
        thigh, shin, arm, forearm = (float(np.linalg.norm(start - end, axis=-1).mean()) for start, end in limbs)
        return cls(hip - pelvis, waist - pelvis, shoulder - waist, thigh, shin, arm, forearm, heel_tip)


def _ends(model: "mujoco.MjModel", data: "mujoco.MjData", geom: int) -> np.ndarray:
    """Return the lowest points (2, 3) at the ends of a capsule, or of a sphere, which has no length; m, world."""
    import mujoco

    radius, half = model.geom_size[geom, :2] * (1, model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CAPSULE)
    along = half * data.geom_xmat[geom].reshape(3, 3)[:, 2]
    return data.geom_xpos[geom] + np.stack([along, -along]) - (0, 0, radius)


def retarget(
    poses: Poses3D, fps: float, model: "mujoco.MjModel", contacts: Sequence[Contact] | None = None
) -> RobotMotion:
    """Return the motions of robots that move as P people do, together.

    Raises ValueError if a person lacks hips, shoulders or ankles in all frames, there are no frames or no persons, or
    frames are stills.

    Args:
        poses: (F, P, 25, 3) poses on `body25`, F > 0; gaps are filled, see `fill_body_frame`. Before a person's first
            and after its last known frame the robot stands still.
        model: Of `load_robot`.
        contacts: Hands that touch other people; by default those that the joints show.
    """
    frames, persons = poses.xyz.shape[:2]
    if are_stills(fps):
        raise ValueError(f"{fps:g} frames/s: below {STILLS:g} frame/s frames are stills, and a robot follows motion")
    if not frames or not persons:
        raise ValueError(f"expected people to retarget, found {persons} in {frames} frames")
    known = (poses.source != Source.ABSENT).any(0)
    for person in range(persons):
        lacking = [joint for joint in _NEEDED if not known[person, poses.skeleton.index(joint)[0]]]
        if lacking:
            raise ValueError(
                f"{person_name(person)}: {', '.join(lacking)} are never known; a robot that stands "
                f"needs hips, ankles and shoulders; {ADVICE}"
            )
    filled = smooth(fill_body_frame(poses, fps, pchip), fps, _SMOOTHING)
    people = [_Person(linear(filled.xyz[:, person].astype(np.float64)), fps) for person in range(persons)]
    robot = _Robot.measure(model)
    scale = (robot.thigh + robot.shin) / float(np.mean([person.leg for person in people]))
    targets = [_targets(person, robot, scale, fps) for person in people]
    contacts = near_contacts(people, fps) if contacts is None else contacts
    touches = _touches(people, contacts, fps)
    qpos, residual = _solve(model, targets, touches, fps)
    motors = tuple(model.joint(number).name for number in range(1, model.njnt))
    touching = np.zeros((frames, persons, 2), bool)
    for contact in contacts:
        touching[:, contact.person, contact.side] |= np.isfinite(contact.point).all(-1)
    standing = np.stack([target.hold == 1 for target in targets], 1)
    return RobotMotion(motors, qpos, _sources(poses, motors), standing, touching, residual, scale)


def _sources(poses: Poses3D, motors: tuple[str, ...]) -> np.ndarray:
    """Return the weakest source (F, P, n) of the joints that determine each motor's angle."""
    ever = (poses.source != Source.ABSENT).any(0)
    # Filled in a gap: completed. Never known: absent, and weaker than everything.
    source = np.where((poses.source == Source.ABSENT) & ever, Source.COMPLETED, poses.source)
    rank = np.where(source == Source.ABSENT, len(Source), source)
    found = []
    for motor in motors:
        side, _, part = motor.partition("_")
        parts = _JOINTS.get(part.partition("_")[0])
        names = [f"{side[0]}_{each}" for each in parts] if parts else list(_NEEDED[:2] + _NEEDED[-2:])
        found.append(rank[:, :, poses.skeleton.index(*names)].max(-1))
        if part.startswith("wrist"):
            found[-1] = np.maximum(found[-1], Source.COMPLETED)
    worst = np.stack(found, -1)
    return np.where(worst == len(Source), Source.ABSENT, worst).astype(np.uint8)


class _Person:
    """Joints of a person in F frames, m, world, without gaps; NaN for joints that are never known."""

    def __init__(self, xyz: np.ndarray, fps: float):
        from dmae.data.skeleton import BODY25

        def joints(*names: str) -> np.ndarray:
            return xyz[:, BODY25.index(*names)]

        def both(part: str) -> np.ndarray:
            return joints(f"l_{part}", f"r_{part}")

        self.hips, self.ankles = both("hip"), both("ankle")
        self.shoulders, self.elbows, self.wrists = both("shoulder"), both("elbow"), both("wrist")
        self.heels, self.toes = both("heel"), both("big_toe")
        self.mid_hip, self.neck = self.hips.mean(1), self.shoulders.mean(1)
        knees = both("knee")
        bones = np.linalg.norm(self.hips - knees, axis=-1) + np.linalg.norm(knees - self.ankles, axis=-1)
        straight = np.linalg.norm(self.hips - self.ankles, axis=-1)
        # Without knees: the longest distance from hip to ankle.
        self.leg = float(np.nanmedian(bones) if np.isfinite(bones).any() else straight.max())
        self.size = self.leg / 0.835  # 1 for a stature of 1.7 m, with legs of Drillis and Contini (1966)
        fore = _unit(self.wrists - self.elbows)
        self.palms = self.wrists + _PALM_AHEAD * self.size * fore
        self.floor = float(np.percentile(self.ankles[..., 2].min(1), 10))
        self.trunk = _unit(self.neck - self.mid_hip)
        self.stands = np.stack([self._stands(side, fps) for side in range(2)], 1)

    def _stands(self, side: int, fps: float) -> np.ndarray:
        """Return (F,) True where heel and toe of a foot stand, or its ankle if they are never known."""
        points = np.stack([self.heels[:, side], self.toes[:, side]], 1)
        if np.isnan(points).any():
            points = self.ankles[:, side, None]
        low = np.percentile(points[..., 2], 10, axis=0)
        near = (points[..., 2] - low).max(1) < _STAND_HEIGHT * self.size
        if len(points) == 1:
            return near
        speed = np.linalg.norm(np.gradient(points, axis=0) * fps, axis=-1).max(1)
        return _lasting(near & (speed < _STAND_SPEED), _STAND_TIME * fps)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-9)


def _frame(left: np.ndarray, up: np.ndarray) -> np.ndarray:
    """Return rotations (F, 3, 3) with z along `up` (F, 3) and y as near as possible to `left` (F, 3)."""
    ahead = _unit(np.cross(left, up))
    return np.stack([ahead, np.cross(up, ahead), up], -1)


def _smoothstep(x: np.ndarray) -> np.ndarray:
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def _near_in_time(at: np.ndarray, fps: float, seconds: float) -> np.ndarray:
    """Return weights (F,): 1 where `at` (F,) is True, falling to 0 within `seconds` before and after."""
    before, after = neighbours(at)
    frame = np.arange(len(at))
    away = np.minimum(np.where(before < 0, np.inf, frame - before), np.where(after == len(at), np.inf, after - frame))
    return _smoothstep(1 - away / max(seconds * fps, 1e-9))


@dataclass(frozen=True)
class _Targets:
    """What one robot is led to, F frames; places m, world, NaN if unknown; orientations to the world."""

    pelvis: np.ndarray  # (F, 3)
    pelvis_turn: np.ndarray  # (F, 3, 3)
    trunk_turn: np.ndarray  # (F, 3, 3)
    elbows: np.ndarray  # (F, 2, 3)
    palms: np.ndarray
    ankles: np.ndarray
    foot_turns: np.ndarray  # (F, 2, 3, 3)
    hold: np.ndarray  # (F, 2) from 0, the foot moves freely, to 1, it stands


def _targets(person: _Person, robot: _Robot, scale: float, fps: float) -> _Targets:
    own = (robot.thigh + robot.shin) / person.leg
    ankle_height, up = -float(robot.heel_tip[0, 2]), np.array([0.0, 0.0, 1.0])

    def placed(xyz: np.ndarray) -> np.ndarray:
        return np.concatenate([scale * xyz[..., :2], own * (xyz[..., 2:] - person.floor) + ankle_height], -1)

    trunk_turn = _frame(person.shoulders[:, 0] - person.shoulders[:, 1], person.trunk)
    # The pelvis leans half as much as the trunk: hips and shoulders do not show where the back bends.
    pelvis_turn = _frame(person.hips[:, 0] - person.hips[:, 1], _unit(up + person.trunk))
    middle = placed(person.mid_hip)
    middle[:, 2] = ankle_height + _CROUCH * (middle[:, 2] - ankle_height)
    pelvis = middle - pelvis_turn @ robot.hip.mean(0)
    shoulders = (pelvis + pelvis_turn @ robot.waist)[:, None] + np.einsum("fij,sj->fsi", trunk_turn, robot.shoulder)
    elbows = shoulders + robot.upper_arm * _unit(person.elbows - person.shoulders)
    palms = elbows + robot.forearm * _unit(person.wrists - person.elbows)
    ankles = placed(person.ankles)
    # The robot's hips are wider than a person's; its feet stand as much wider.
    width = np.median(np.linalg.norm(person.hips[:, 0] - person.hips[:, 1], axis=-1))
    beside = robot.hip[:, 1] - own * width / 2 * np.array([1, -1])
    ankles[..., :2] += beside[:, None] * _unit(pelvis_turn[:, :2, 1])[:, None]
    hold = np.stack([_near_in_time(stands, fps, _STEP_TIME) for stands in person.stands.T], 1)
    foot_turns = np.empty((len(pelvis), 2, 3, 3))
    for side in range(2):
        yaw, pitch = _foot_angles(person, side, pelvis_turn)
        path = np.concatenate([ankles[:, side], yaw[:, None]], -1)
        path += hold[:, side, None] * (_held(path, person.stands[:, side], ankle_height) - path)
        pitch = np.clip(pitch, -0.7, 0.7) * (1 - hold[:, side])
        foot_turns[:, side] = Rotation.from_euler("ZY", np.stack([path[:, 3], pitch], -1)).as_matrix()
        # No end of the sole below the floor.
        low = (foot_turns[:, side] @ robot.heel_tip.T)[:, 2].min(-1)
        ankles[:, side] = path[:, :3]
        ankles[:, side, 2] = np.maximum(path[:, 2], -low)
    return _Targets(pelvis, pelvis_turn, trunk_turn, elbows, palms, ankles, foot_turns, hold)


def _foot_angles(person: _Person, side: int, pelvis_turn: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return yaw and pitch (F,), rad, of a foot; as the pelvis faces and level if heel or toe are never known."""
    heading = np.unwrap(np.arctan2(pelvis_turn[:, 1, 0], pelvis_turn[:, 0, 0]))
    along, stands = person.toes[:, side] - person.heels[:, side], person.stands[:, side]
    if np.isnan(along).any():
        return heading, np.zeros(len(heading))
    yaw = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
    pitch = -np.arctan2(along[:, 2], np.linalg.norm(along[:, :2], axis=-1))
    # Nobody's hips turn farther for long, and the robot's less far where a leg crosses the other.
    yaw = heading + np.clip((yaw - heading + np.pi) % (2 * np.pi) - np.pi, -_TURN, _TURN)
    return yaw, pitch - (np.median(pitch[stands]) if stands.any() else 0.0)


def _held(path: np.ndarray, stands: np.ndarray, height: float) -> np.ndarray:
    """Return a path (F, 4) of an ankle, m, and its yaw, rad, that stays at one place at `height` while a foot stands,
    and moves straight from place to place."""
    held = path.copy()
    held[:, 2] = height
    for first, last in runs(stands):
        held[first:last] = held[first:last].mean(0)
    return linear(np.where(stands[:, None], held, np.nan)[:, None])[:, 0] if stands.any() else held


def _lasting(flags: np.ndarray, least: float) -> np.ndarray:
    """Return flags (F,) without runs of True below `least` frames, after interruptions that short are closed."""
    kept = flags.copy()
    for value in (False, True):
        for first, last in runs(kept == value):
            if last - first < least and first > 0 and last < len(flags):
                kept[first:last] = not value
    return kept


@dataclass(frozen=True)
class _Touch:
    """A hand that is led to a place of another robot."""

    contact: Contact  # What touches what. A forearm that is touched at its wrist is a hand.
    weight: np.ndarray  # (F,) from 0 to 1, of this place for this hand
    along: np.ndarray  # (F,) place along the part, from 0 to 1
    outwards: np.ndarray  # (F, 3) unit vector from the part to the palm


_LINKS = {
    "trunk": ("pelvis", "torso_link"), "upper_arm": ("{}_shoulder_yaw_link", "{}_elbow_link"),
    "forearm": ("{}_elbow_link", "{}_wrist_pitch_link", "{}_wrist_yaw_link"), "hand": ("{}_wrist_yaw_link",),
}  # fmt: skip
"""Links of the robot whose collision shapes are a part, by side."""
_HAND_RADIUS = 0.035  # m; distance of palms from what they touch if the model has no collision shapes there


def _part(person: _Person, part: str, side: int) -> tuple[np.ndarray, np.ndarray]:
    if part == "trunk":
        return person.mid_hip, person.neck
    places = {"upper_arm": (person.shoulders, person.elbows), "forearm": (person.elbows, person.wrists)}
    start, end = places.get(part, (person.palms, person.palms))
    return start[:, side], end[:, side]


def _along(point: np.ndarray, start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest place on the way from `start` to `end`, (F,) from 0 to 1, and vectors (F, 3) from there."""
    bone = end - start
    along = np.clip(((point - start) * bone).sum(-1) / np.maximum((bone * bone).sum(-1), 1e-9), 0, 1)
    return along, point - start - along[:, None] * bone


def near_contacts(people: list[_Person], fps: float) -> list[Contact]:
    """Return the contacts that joints show: hands whose surface is within `_TOUCH` of another person's part."""
    found = []
    for (person, one), (other, two) in permutations(enumerate(people), 2):
        for side, part in product(range(2), _RADII):
            for other_side in range(1 if part == "trunk" else 2):
                gaps, points = zip(
                    *(_gap(place[:, side], one.size, two, part, other_side) for place in (one.palms, one.wrists)),
                    strict=True,
                )
                at = _lasting(np.minimum(*gaps) < _TOUCH, _TOUCH_TIME * fps)
                if at.any():
                    point = np.where((gaps[1] < gaps[0])[:, None], points[1], points[0])
                    found.append(Contact(person, side, other, part, other_side, np.where(at[:, None], point, np.nan)))
    return found


def _gap(hand: np.ndarray, size: float, other: _Person, part: str, side: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the distance between the surfaces of a hand and of a part of another person, (F,) m, and the place where
    they touch or would, (F, 3) m.

    Args:
        hand: (F, 3) m, place in a hand.
        size: Of the hand's person.
        part, side: As in `Contact`.
    """
    away = _along(hand, *_part(other, part, side))[1]
    radius = np.full(len(away), _RADII[part])
    if part == "trunk":
        # A trunk is broader than deep.
        beside = (_unit(away) * _unit(other.shoulders[:, 0] - other.shoulders[:, 1])).sum(-1)
        radius = 1 / np.sqrt((beside / _TRUNK_BREADTH) ** 2 + (1 - beside**2) / radius**2)
    gap = np.linalg.norm(away, axis=-1) - radius * other.size - _RADII["hand"] * size
    return gap, hand - away / 2 if part == "hand" else hand - _unit(away) * gap[:, None]


def _touches(people: list[_Person], contacts: Sequence[Contact], fps: float) -> list[_Touch]:
    """Return where hands are led. Between two contacts of a hand with a part, its place moves on a straight line."""
    found = []
    for contact in contacts:
        one, two, side = people[contact.person], people[contact.other], contact.side
        at = np.isfinite(contact.point).all(-1)
        if not at.any():
            continue
        along, outwards = _along(contact.point, *_part(two, contact.part, contact.other_side))
        if contact.part == "forearm" and np.median(along[at]) > _WRIST:
            contact = replace(contact, part="hand")
        if contact.part == "hand":
            outwards = one.palms[:, side] - two.palms[:, contact.other_side]
        place = linear(np.where(at[:, None], np.c_[along, _unit(outwards)], np.nan)[:, None])[:, 0]
        found.append(_Touch(contact, _near_in_time(at, fps, _REACH_TIME), place[:, 0], _unit(place[:, 1:])))
    return found


# The solver. Costs are per m and per rad; they matter relative to each other only.

_PELVIS, _TRUNK, _ELBOW, _PALM, _FOOT = (2.0, 0.3), (0.0, 0.6), (0.6, 0.0), (1.5, 0.0), (6.0, 0.5)
_TOUCHING, _STANDING = 10.0, (80.0, 8.0)  # What is added to the cost of a palm that touches and of a foot that stands
_POSTURE, _WRISTS, _MOMENTUM, _WRIST_MOMENTUM, _DAMPING = 0.03, 0.05, 0.2, 0.4, 6e-3
_REST = {"hip_pitch": -0.1, "knee": 0.3, "ankle_pitch": -0.2, "shoulder_pitch": 0.2, "shoulder_roll": 0.2, "elbow": 1.2}
"""rad; the pose, knees a little bent, to which a joint that nothing determines returns."""
_LEAD_SPEED = 2.0  # m/s at which a hand is led away from where the person holds it, at most
_ADVANCES = 6  # Steps in which hands are moved until they touch
_OFF, _CORRECTIONS = 1e-4, 4  # m; farthest that a standing foot may be from its place, and how often a step is solved
_FIRST = 40  # Steps to the first pose, without limits of speed, and as many to come apart there
_APART, _LEGS_APART, _NEAR = 40.0, 12.0, 0.1
"""Costs of overlap of two robots' collision shapes: well above `_TOUCHING`, and below `_STANDING` for two legs, as a
foot that stands stays; m between shapes below which it is looked for."""
_APPROACH, _RETREAT = 0.5, 1.0
"""Share of a distance that one robot may use up in a step, and m/s at which shapes that overlap come apart."""


def _solve(
    model: "mujoco.MjModel", targets: list[_Targets], touches: list[_Touch], fps: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return qpos (F, P, nq) and residual (F, P, 4)."""
    frames, steps = len(targets[0].pelvis), max(1, math.ceil(_RATE / fps))
    fastest = np.r_[np.full(6, np.inf), [_SPEED_SHARE * speed for speed in speeds(model).values()]]
    robots = [
        _Follower(model, target, [touch for touch in touches if touch.contact.person == person])
        for person, target in enumerate(targets)
    ]
    qpos, residual = np.empty((frames, len(robots), model.nq)), np.empty((frames, len(robots), 4))
    for number in range(2 * _FIRST):
        for each in robots:
            each.step(0, 1.0, robots, np.full(model.nv, np.inf), apart=number >= _FIRST)
    for each in robots:
        each.moved = np.zeros(model.nv)
    for frame in range(frames):
        for step in range(1, steps + 1 if frame else 1):
            for each in robots:
                each.step(frame - 1 + step / steps, 1 / (fps * steps), robots, fastest)
        for person, each in enumerate(robots):
            qpos[frame, person], residual[frame, person] = each.configuration.q, each.residual()
    return qpos, residual


def speeds(model: "mujoco.MjModel") -> dict[str, float]:
    """Return the speed of each motor without load, rad/s, by joint."""
    found: dict[str, float] = {}
    for number in range(1, model.njnt):
        name = model.joint(number).name
        part = name.removeprefix("left_").removeprefix("right_")
        found[name] = next(speed for start, speed in _MOTORS.items() if part.startswith(start))
    return found


def _momentum_task(model: "mujoco.MjModel") -> Any:
    """Return the task to go on as fast as before, unless a target needs another speed. Without it, limbs jerk."""
    from mink.tasks.task import BaseTask, Objective

    class Momentum(BaseTask):
        def __init__(self):
            self.step, weights = np.zeros(model.nv), np.full(model.nv, _MOMENTUM)
            for joint in map(model.joint, range(1, model.njnt)):
                if "wrist" in joint.name:
                    weights[joint.dofadr] = _WRIST_MOMENTUM
            self.weight = np.diag(weights)

        def compute_qp_residual(self, configuration):
            return self.weight, self.weight @ self.step, 0.0

        def compute_qp_objective(self, configuration):
            return Objective(self.weight**2, -(self.weight**2) @ self.step)

    return Momentum()


def _apart(own: "_Follower", others: list["_Follower"], dt: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return G (n, nv), h (n,) and costs (n,): with G dq <= h no collision shape of a robot enters another robot."""
    import mujoco

    model, data = own.configuration.model, own.configuration.data
    rows, bounds, costs, jacobian = [], [], [], np.empty((3, model.nv))
    mine = own.shapes()
    for other in others:
        theirs = other.shapes()
        reach = mine.reach[:, None] + theirs.reach + _NEAR
        away = mine.middle[:, None] - theirs.middle
        one, two = np.nonzero((away * away).sum(-1) < reach * reach)
        points, there = _nearest(mine.middle[one], mine.half[one], theirs.middle[two], theirs.half[two])
        normals = points - there
        lengths = np.linalg.norm(normals, axis=-1)
        gaps = lengths - mine.radius[one] - theirs.radius[two]
        # Of each two links the nearest shapes count: a foot has seven.
        order = np.argsort(gaps)
        links = mine.body[one] * model.nbody + theirs.body[two]
        order = order[np.unique(links[order], return_index=True)[1]]
        for pair in order[(gaps[order] < _NEAR) & (lengths[order] > 1e-6)].tolist():
            mujoco.mj_jac(model, data, jacobian, None, points[pair], mine.body[one[pair]])
            rows.append(-normals[pair] / lengths[pair] @ jacobian)
            gap = float(gaps[pair])
            bounds.append(_APPROACH * gap if gap > 0 else max(gap, -_RETREAT * dt))
            legs = own.legs[mine.body[one[pair]]] and own.legs[theirs.body[two[pair]]]
            costs.append(_LEGS_APART if legs else _APART)
    return np.array(rows).reshape(-1, model.nv), np.array(bounds), np.array(costs)


@dataclass(frozen=True)
class _Shapes:
    """Collision shapes of a robot: n segments with a radius, m, world."""

    body: np.ndarray  # (n,) of the model
    # middle, half: (n, 3) middle of a segment, and half of it
    middle: np.ndarray
    half: np.ndarray
    # radius, reach: (n,) of the shape, and from the middle to its end
    radius: np.ndarray
    reach: np.ndarray


def _nearest(
    middle: np.ndarray, half: np.ndarray, other: np.ndarray, other_half: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest points (n, 3) of two segments (Ericson, Real-Time Collision Detection, 5.1.9)."""
    a, e, b = ((one * two).sum(-1) for one, two in ((half, half), (other_half, other_half), (half, other_half)))
    between = middle - other
    c, f = (half * between).sum(-1), (other_half * between).sum(-1)
    across = a * e - b * b
    s = np.where(across > 1e-12, np.clip((b * f - c * e) / np.maximum(across, 1e-12), -1, 1), 0.0)
    t = np.clip((b * s + f) / np.maximum(e, 1e-12), -1, 1)
    s = np.clip((b * t - c) / np.maximum(a, 1e-12), -1, 1)
    return middle + s[:, None] * half, other + t[:, None] * other_half


def _touching_at(one: _Shapes, two: _Shapes, outwards: np.ndarray) -> float:
    """Return how far, m, in the direction `outwards` (3,) from the origin of `two` `one` is when they touch."""
    pairs = np.indices((len(one.middle), len(two.middle))).reshape(2, -1)
    ends = np.abs(one.half @ outwards)[pairs[0]] + np.abs(two.half @ outwards)[pairs[1]]
    a, b = one.middle[pairs[0]], two.middle[pairs[1]]
    radii = one.radius[pairs[0]] + two.radius[pairs[1]]
    # From where they are apart, one moves by the distance that is left (conservative advancement).
    gap = max(ends + radii + (b - a) @ outwards, default=2 * _HAND_RADIUS)
    for _ in range(_ADVANCES if len(a) else 0):
        points, there = _nearest(a + gap * outwards, one.half[pairs[0]], b, two.half[pairs[1]])
        gap -= min(np.linalg.norm(points - there, axis=-1) - radii)
    return float(gap)


def _between(values: np.ndarray, at: float) -> np.ndarray:
    """Return values (F, ...) at a time in frames; between two frames on a straight line."""
    low = int(at)
    return values[low] + (at - low) * (values[min(low + 1, len(values) - 1)] - values[low])


class _Follower:
    """One robot: its configuration, and the tasks that lead it to its targets."""

    def __init__(self, model: "mujoco.MjModel", targets: _Targets, touches: list[_Touch]):
        import mink
        import mujoco

        def task(name: str, costs: tuple[float, float], kind: str = "body") -> "mink.FrameTask":
            return mink.FrameTask(name, kind, *costs, lm_damping=1e-3)

        self.targets, self.touches = targets, touches
        self.pelvis, self.trunk = task("pelvis", _PELVIS), task("torso_link", _TRUNK)
        self.elbows = [task(f"{side}_elbow_link", _ELBOW) for side in SIDES]
        self.palms = [task(f"{side}_hand", _PALM, "site") for side in SIDES]
        self.feet = [task(f"{side}_ankle_roll_link", _FOOT) for side in SIDES]
        self.momentum, self.moved = _momentum_task(model), np.zeros(model.nv)
        costs, rest = np.full(model.nv, _POSTURE), np.zeros(model.nq)
        for joint in map(model.joint, range(1, model.njnt)):
            if "wrist" in joint.name:
                costs[joint.dofadr] = _WRISTS
            for part, angle in _REST.items():
                if part in joint.name:
                    rest[joint.qposadr] = -angle if part.endswith("roll") and joint.name.startswith("right") else angle
        rest[:3] = targets.pelvis[0]
        rest[3:7] = Rotation.from_matrix(targets.pelvis_turn[0]).as_quat(scalar_first=True)
        self.posture = mink.PostureTask(model, cost=costs)
        self.posture.set_target(rest)
        self.configuration = mink.Configuration(model, rest)
        self.limits = [mink.ConfigurationLimit(model, min_distance_from_limits=_MARGIN)]
        capsule, sphere = mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_SPHERE
        self.used = np.flatnonzero(np.isin(model.geom_type, (capsule, sphere)) & (model.geom_bodyid > 0))
        self.along = (model.geom_size[:, 1] * (model.geom_type == capsule))[self.used]
        names = [model.body(number).name for number in range(model.nbody)]
        self.legs = np.array([any(part in name for part in ("hip", "knee", "ankle")) for name in names])
        self.led = np.zeros((2, 3))  # m, how far palms are led from where the person holds them
        self.moved_shapes: _Shapes | None = None  # of `shapes`, until the robot moves
        links = model.geom_bodyid[self.used]
        self.parts = {
            (part, side): np.isin(links, [model.body(name.format(SIDES[side])).id for name in names])
            for part, names in _LINKS.items()
            for side in range(2)
        }

    def shapes(self) -> _Shapes:
        """Return the collision shapes where they are now: capsules, and spheres, which have no length."""
        if self.moved_shapes is None:
            model, data, used = self.configuration.model, self.configuration.data, self.used
            half = self.along[:, None] * data.geom_xmat[used].reshape(-1, 3, 3)[:, :, 2]
            radius = model.geom_size[used, 0]
            middle = data.geom_xpos[used]
            self.moved_shapes = _Shapes(model.geom_bodyid[used], middle, half, radius, radius + self.along)
        return self.moved_shapes

    def step(self, at: float, dt: float, robots: list["_Follower"], fastest: np.ndarray, apart: bool = True) -> None:
        """Move towards the targets at a time in frames, within `dt` s; if `apart`, not into other robots.

        Args:
            fastest: (nv,) m/s and rad/s.
        """
        import mink
        import qpsolvers

        others = [each for each in robots if apart and each is not self]
        tasks = [*self._aim(at), *self._lead_hands(at, dt, robots)]
        standing = [foot for foot, hold in zip(self.feet, _between(self.targets.hold, at), strict=True) if hold == 1]
        moved = np.zeros_like(self.moved)
        # A step is linear. Where legs turn fast it leaves a standing foot off its place; further ones correct that.
        for _ in range(_CORRECTIONS):
            self.momentum.step = self.moved - moved
            problem: Any = mink.build_ik(self.configuration, tasks, dt, _DAMPING, self.limits)
            rows, bounds, costs = _apart(self, others, dt)
            # Overlap costs as its square does: where it cannot be avoided, feet and limits come first.
            slack = np.eye(len(bounds))
            problem.P = block_diag(problem.P, costs**2 * slack)
            problem.q = np.r_[problem.q, 0 * bounds]
            problem.G = np.block([[problem.G, np.zeros((len(problem.h), len(slack)))], [rows, -slack]])
            problem.h = np.r_[problem.h, bounds]
            problem.lb, problem.ub = (np.r_[sign * dt * fastest - moved, sign * np.inf + bounds] for sign in (-1, 1))
            solution: Any = qpsolvers.solve_problem(problem, "daqp")
            velocity = solution.x[: len(moved)] / dt
            self.configuration.integrate_inplace(velocity, dt)
            self.moved_shapes = None
            moved += dt * velocity
            if all(np.abs(foot.compute_error(self.configuration)[:3]).max() < _OFF for foot in standing):
                break
        self.moved = moved

    def _aim(self, at: float) -> list:
        """Set the targets of everything but palms. Return the tasks."""
        t = self.targets
        _set(self.pelvis, _between(t.pelvis, at), _between(t.pelvis_turn, at))
        _set(self.trunk, np.zeros(3), _between(t.trunk_turn, at))
        elbows = [each for each in zip(self.elbows, _between(t.elbows, at), strict=True) if np.isfinite(each[1]).all()]
        for task, place in elbows:
            _set(task, place)
        hold = _between(t.hold, at) ** 2
        for side, task in enumerate(self.feet):
            _set(task, _between(t.ankles, at)[side], _between(t.foot_turns, at)[side])
            task.cost[:] = np.repeat(np.array(_FOOT) + hold[side] * np.array(_STANDING), 3)
        return [self.pelvis, self.trunk, self.posture, self.momentum, *(task for task, _ in elbows), *self.feet]

    def _lead_hands(self, at: float, dt: float, robots: list["_Follower"]) -> list:
        """Set the targets of palms: as the person holds them or, where they touch, at places of other robots."""
        led, weights, tasks = ([], []), ([], []), []
        palms = _between(self.targets.palms, at)
        for touch in self.touches:
            contact, weight = touch.contact, _between(touch.weight, at)
            if weight < 1e-3:
                continue
            other, side = robots[contact.other], contact.side
            outwards = _between(touch.outwards, at)
            if contact.part == "hand":
                # Both hands go half the way from where they would be.
                there = other._shapes_of("hand", contact.other_side, other._palm(contact.other_side))
                gap = _touching_at(self._shapes_of("hand", side, self._palm(side)), there, outwards)
                place = (palms[side] + _between(other.targets.palms, at)[contact.other_side] + gap * outwards) / 2
            else:
                start, end = other._ends(contact.part, contact.other_side)
                place = start + _between(touch.along, at) * (end - start)
                there = other._shapes_of(contact.part, contact.other_side, place)
                place += _touching_at(self._shapes_of("hand", side, self._palm(side)), there, outwards) * outwards
            if np.isfinite(place).all():
                led[side].append(place)
                weights[side].append(weight)
        for side, task in enumerate(self.palms):
            place, total = palms[side], min(sum(weights[side]), 1.0)
            away = np.zeros(3)
            if total:
                target = np.average(led[side], 0, weights[side])
                place = target if np.isnan(place).any() else place
                away = total * (target - place)
            # Where contacts begin, end or change parts their places jump; a hand led that fast would drag the feet.
            change = away - self.led[side]
            self.led[side] += change * min(1.0, _LEAD_SPEED * dt / max(float(np.linalg.norm(change)), 1e-9))
            place = place + self.led[side]
            if np.isfinite(place).all():
                _set(task, place)
                task.cost[:3] = _PALM[0] + total * _TOUCHING
                tasks.append(task)
        return tasks

    def _palm(self, side: int) -> np.ndarray:
        return self.configuration.data.site(f"{SIDES[side]}_hand").xpos

    def _shapes_of(self, part: str, side: int, origin: np.ndarray) -> _Shapes:
        """Return the collision shapes of a part, relative to an origin (3,)."""
        shapes, on = self.shapes(), self.parts[part, side]
        away = shapes.middle[on] - origin
        return _Shapes(shapes.body[on], away, shapes.half[on], shapes.radius[on], shapes.reach[on])

    def _ends(self, part: str, side: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the ends of the trunk, an upper arm or a forearm, m, world."""
        place = {
            name: self.configuration.data.body(f"{SIDES[side]}_{name}_link").xpos
            for name in ("shoulder_roll", "elbow", "wrist_yaw")
        }
        if part == "trunk":
            other = self.configuration.data.body(f"{SIDES[1 - side]}_shoulder_roll_link").xpos
            return self.configuration.data.body("torso_link").xpos, (place["shoulder_roll"] + other) / 2
        return {"upper_arm": (place["shoulder_roll"], place["elbow"]), "forearm": (place["elbow"], place["wrist_yaw"])}[
            part
        ]

    def residual(self) -> list[float]:
        return [
            math.nan
            if task.transform_target_to_world is None
            else float(np.linalg.norm(task.compute_error(self.configuration)[:3]))
            for task in (*self.elbows, *self.palms)
        ]


def _set(task: "mink.FrameTask", place: np.ndarray, turn: np.ndarray | None = None) -> None:
    """Set the target of a task. `turn` (3, 3) lies between two near rotations; the target is the nearest rotation."""
    import mink

    rotation = mink.SO3.identity()
    if turn is not None:
        x = turn[:, 0] / np.linalg.norm(turn[:, 0])
        z = np.cross(x, turn[:, 1])
        z /= np.linalg.norm(z)
        rotation = mink.SO3.from_matrix(np.stack([x, np.cross(z, x), z], -1))
    task.set_target(mink.SE3.from_rotation_and_translation(rotation, place))
