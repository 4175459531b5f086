"""The body as rigid segments of constant size: inverse kinematics, joint angles and their standard deviations.

A person has 17 segments. Their axes are those of the ISB and of OpenSim: x forward, y up, z to the right while the
person stands upright with hanging arms, thumbs forward. That pose is neutral: all rotations are the identity.

The rotations of one frame minimise the squared distances of the joints to the landmarks of the body, weighted by the
covariances of the joints, plus squared deviations of the rotations from neutral in units of a prior standard deviation
(Gauss-Newton on rotations, as in Sola et al., "A micro Lie theory", 2018; Huber weights on joints). The inverse of the
normal matrix is the covariance of the rotations. An angle that the joints determine little better than the prior is
NaN.

Joint angles are Cardan angles in the order z, x, y of a segment in its parent: flexion, adduction, rotation (Wu et al.,
J. Biomech. 2002 and 2005; Grood and Suntay, J. Biomech. Eng. 1983). Names, signs and units are those of OpenSim.

Hips, shoulders and neck do not show how the pelvis tilts. It is level while the person stands upright, as in a static
trial of gait laboratories; from there, the lumbar spine bends by 36 % of the angle between trunk and thighs. The share
and its standard deviation are from recordings of CMU with markers on the pelvis (`docs/tools/angles.py`).
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.clip import Poses3D, Source, person_name
from dmae.data.skeleton import Skeleton
from dmae.numerics.paths import hold
from dmae.numerics.statistics import evenly_spaced

ISB = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Axes of a segment, as columns, of a person who faces x and stands upright in our world."""


class _Segment(NamedTuple):
    name: str  # Name; segments on a side have a twin, `l_` and `r_`
    parent: str  # Name of the parent, with `l_` or `r_` left out
    # Joint with the parent, in the parent's axes, fractions of stature; of the right side
    origin: tuple[float, float, float]
    prior: tuple[float, float, float]  # Standard deviations of the rotation about x, y and z from neutral, degrees
    joint: str = ""  # The joint of a skeleton at the origin; empty if there is none


# Lengths after Drillis and Contini (1966), as in Winter, Biomechanics and Motor Control (4th ed., fig. 4.1); lumbar
# joint after Delp et al., IEEE Trans. Biomed. Eng. 1990. They are scaled to each person.
_MIDDLE = (
    _Segment("pelvis", "", (0, 0, 0), (np.inf, np.inf, np.inf)),
    _Segment("torso", "pelvis", (-0.017, 0.082, 0), (10, 15, 4.0)),
    _Segment("head", "torso", (0.017, 0.234, 0), (25, 40, 30)),
)
_SIDES = (
    _Segment("clavicle", "torso", (0.017, 0.206, 0.015), (12, 12, 3)),
    _Segment("upper_arm", "clavicle", (0, 0, 0.095), (60, 60, 60), "shoulder"),
    _Segment("forearm", "upper_arm", (0, -0.186, 0), (4, 45, 70), "elbow"),
    _Segment("hand", "forearm", (0, -0.146, 0), (25, 5, 30), "wrist"),
    _Segment("thigh", "pelvis", (0, 0, 0.052), (30, 25, 50), "hip"),
    _Segment("shank", "thigh", (0, -0.245, 0), (2, 6, 60), "knee"),
    _Segment("foot", "shank", (0, -0.246, 0), (10, 15, 30), "ankle"),
)
_LUMBAR_SHARE = 0.36
"""Lean of the trunk against the pelvis as a share of the angle between trunk and thighs, from upright standing."""
_LUMBAR_SD = (4.0, 0.09)
"""Standard deviation of this lean: degrees in upright standing, and degrees more for each degree away from it."""
_STANDING, _STANDING_SD = (2.3, 13.8), 3.5
"""Lean of the trunk and flexion of the thighs against a level pelvis in upright standing, means of people, degrees;
standard deviation of what they say about the tilt of the pelvis."""
_UPRIGHT_TRUNK, _UPRIGHT_THIGHS = 20.0, (-20.0, 35.0)
"""A person stands upright if the trunk leans by no more and both thighs are between these angles, degrees."""

_LANDMARKS = {
    "mid_hip": ("pelvis", (0, 0, 0)),
    "neck": ("torso", (0.017, 0.206, 0)),
    "nose": ("head", (0.072, 0.066, 0)),
    "mouth": ("head", (0.066, 0.044, 0.014)),
    "eye": ("head", (0.058, 0.090, 0.018)),
    "eye_inner": ("head", (0.060, 0.090, 0.009)),
    "eye_outer": ("head", (0.054, 0.090, 0.027)),
    "ear": ("head", (0.006, 0.081, 0.045)),
    "head_top": ("head", (0.005, 0.155, 0)),
    "top_head": ("head", (0.072, 0.110, 0)),
    "bottom_head": ("head", (0, 0.027, 0)),
    "index_finger": ("hand", (0.018, -0.053, 0)),
    "little_finger": ("hand", (-0.018, -0.047, 0)),
    "thumb": ("hand", (0.030, -0.033, 0)),
    "heel": ("foot", (-0.037, -0.030, 0)),
    "big_toe": ("foot", (0.108, -0.030, -0.013)),
    "small_toe": ("foot", (0.085, -0.031, 0.026)),
}
"""Segment and place, in fractions of stature, of joints that are not where a segment begins; of the right side."""
_ON_SKULL = {"body25b"}  # Skeletons whose neck is where the neck meets the skull
_HIP, _LOW_HIPS = np.array([0, 0.010, 0.006]), {"shelf14"}
"""Place of detected hips relative to the hip joint, fractions of stature, right side: OpenPose's are slightly above and
outside it. Hips of some skeletons are below it and move with the thigh."""

_MODEL_ERROR = 0.008
"""m; standard deviation of a joint from its landmark on a rigid body, besides its covariance: soft tissue, and what
detectors call a joint."""
_UNKNOWN_ERROR = {Source.MEASURED: 0.01, Source.DENOISED: 0.01, Source.COMPLETED: 0.06}
"""m; standard deviation of a joint without a covariance."""
_HUBER = 3.0  # Distance in standard deviations from which a joint pulls no stronger
_STEPS, _MOST_STEP, _CONVERGED = 12, 0.6, 1e-4
"""Gauss-Newton steps, the largest rotation of one, and the largest change that ends them, rad or m."""
_FRAMES, _FITTED, _REFINED = 256, 100, 3
"""Frames that are solved together, frames from which the size of a body is measured, and how often it is."""
_ENOUGH = 10  # Fewest frames that show where a landmark is, or how a person stands upright
_DETERMINED, _LARGEST_SD = 0.6, 20.0
"""An angle is determined if its standard deviation is below this share of the prior's, and below this, degrees."""


@dataclass(frozen=True)
class Body:
    """The segments of one person: S segments, parents first, and J landmarks."""

    segments: tuple[str, ...]  # Names
    parents: tuple[int, ...]  # (S,) index of the parent; -1 for the pelvis
    origins: np.ndarray  # (S, 3) m, joint with the parent, in its axes; zero for the pelvis
    prior: np.ndarray  # (S, 3) rad, prior standard deviations of the rotation about x, y and z
    joints: tuple[str, ...]  # Names of the landmarks
    on: tuple[int, ...]  # (J,) segment of each landmark
    landmarks: np.ndarray  # (J, 3) m, in the axes of their segment
    # (3,) m, place of the right landmark of the hips relative to the hip joint, in the axes of the pelvis
    hip: np.ndarray
    standing: float  # rad, `(1 - share) lumbar extension + share x hip flexion` in upright standing with a level pelvis
    lumbar_sd: float  # rad, standard deviation of this sum in upright standing

    def place(self, root: np.ndarray, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return origins (F, S, 3) and rotations (F, S, 3, 3) of the segments in the world.

        Args:
            root: (F, 3) mid point of the hips, m.
            local: (F, S, 3, 3) rotations to the axes of the parent.
        """
        at, turned = np.empty((*local.shape[:2], 3)), np.empty_like(local)
        for number, parent in enumerate(self.parents):
            if parent < 0:
                at[:, number], turned[:, number] = root, local[:, number]
            else:
                at[:, number] = at[:, parent] + turned[:, parent] @ self.origins[number]
                turned[:, number] = turned[:, parent] @ local[:, number]
        return at, turned


@dataclass(frozen=True)
class BodyMotion:
    """The motion of one person in F frames."""

    body: Body  # Sizes
    root: np.ndarray  # (F, 3) mid point of the hips, m, world
    local: np.ndarray  # (F, S, 3, 3) rotation of each segment to the axes of its parent; of the pelvis to the world
    cov: np.ndarray  # (F, S, 3, 3) covariance of a small rotation of each segment in its own axes, rad^2
    root_cov: np.ndarray  # (F, 3, 3) m^2

    @property
    def xyz(self) -> np.ndarray:
        """(F, J, 3) landmarks, m, world."""
        at, turned = self.body.place(self.root, self.local)
        on = list(self.body.on)
        return at[:, on] + (turned[:, on] @ self.body.landmarks[..., None])[..., 0]


ADVICE = "dmae complete places people's joints that were never seen; npz, trc, c3d and movement hold what is known"
"""What to do with a person whose body is not known."""


class NoBody(ValueError):
    """A person of whom too little is ever known for a body; the message names the person and the joints."""


def can_move(skeleton: Skeleton) -> bool:
    """Return whether a skeleton is a person's: with hips and shoulders."""
    return {f"{side}_{joint}" for side in "lr" for joint in ("hip", "shoulder")} <= set(skeleton.joints)


def body_motion(poses: Poses3D, person: int, body: Body | None = None) -> BodyMotion:
    """Return the motion of one person by inverse kinematics.

    Segments whose joints are never known stay neutral. Absent joints have no weight.

    Args:
        poses: Any poses of a skeleton with hips and shoulders.
        body: Its sizes, as of another recording of the person with this skeleton; by default measured from the poses.

    Raises:
        ValueError: the skeleton has no hips or shoulders.
        NoBody: the person's are never known.
    """
    skeleton = poses.skeleton
    if not can_move(skeleton):
        raise ValueError(f"joint angles need hips and shoulders, and {skeleton.name} has none")
    xyz = poses.xyz[:, person].astype(np.float64)
    template = _template(skeleton)
    given = list(skeleton.index(*template.joints))
    points, precision = xyz[:, given], _precision(poses, person, given)
    start = _starting_frames(points, template, person)
    if body is None:
        measured = np.where(poses.measured[:, person][:, given, None], points, np.nan)
        body = _scaled(template, np.where(np.isnan(measured).all(0), points, measured))
        some = evenly_spaced(len(points), _FITTED)
        for _ in range(_REFINED):
            motion = _solve(body, points[some], precision[some], (start[0][some], start[1][some]))
            body = _level(_refined(motion, points[some]), motion, points[some])
    return _solve(body, points, precision, start)


def _template(skeleton: Skeleton) -> Body:
    """Return a body of stature 1 with the joints of a skeleton that are landmarks."""
    names, parents, origins, prior = [], [], [], []
    for segment, side in [(each, "") for each in _MIDDLE] + [(each, side) for side in "rl" for each in _SIDES]:
        sided = f"{side}_{segment.parent}"
        parents.append(names.index(sided if sided in names else segment.parent) if segment.parent else -1)
        names.append(f"{side}_{segment.name}" if side else segment.name)
        origins.append(_mirrored(segment.origin, side))
        prior.append(np.radians(segment.prior))
    places = {segment.joint: (segment.name, (0, 0, 0)) for segment in _SIDES} | _LANDMARKS
    if skeleton.name in _ON_SKULL:
        places["neck"] = ("head", (0.006, 0.022, 0))
    joints, on, landmarks = [], [], []
    for joint in skeleton.joints:
        side, part = (joint[0], joint[2:]) if joint[:2] in ("l_", "r_") else ("", joint)
        if part in places:
            carrier, place = places[part]
            joints.append(joint)
            on.append(names.index(f"{side}_{carrier}" if f"{side}_{carrier}" in names else carrier))
            landmarks.append(_mirrored(place, side))
    lean, thighs = np.radians(_STANDING)
    return Body(tuple(names), tuple(parents), np.array(origins, float), np.array(prior), tuple(joints), tuple(on),
                np.array(landmarks, float), _HIP * (skeleton.name not in _LOW_HIPS),
                _LUMBAR_SHARE * thighs - (1 - _LUMBAR_SHARE) * lean,
                np.radians(np.hypot(_LUMBAR_SD[0], _STANDING_SD)))  # fmt: skip


def _mirrored(place: tuple[float, float, float], side: str) -> tuple[float, float, float]:
    return (place[0], place[1], -place[2]) if side == "l" else place


def _scaled(body: Body, xyz: np.ndarray) -> Body:
    """Return the body with bones of median length over frames (F, J, 3) and both sides; the rest in proportion."""
    place = {joint: xyz[:, number] for number, joint in enumerate(body.joints)}

    def length(*pairs: tuple[str, str]) -> float:
        each = [np.linalg.norm(place[a] - place[b], axis=-1) for a, b in pairs if a in place and b in place]
        found = np.concatenate(each) if each else np.empty(0)
        return float(np.median(found[~np.isnan(found)])) if np.isfinite(found).any() else np.nan

    origins, number = body.origins.copy(), {name: i for i, name in enumerate(body.segments)}
    bones = {"forearm": ("shoulder", "elbow"), "hand": ("elbow", "wrist"), "shank": ("hip", "knee"),
             "foot": ("knee", "ankle")}  # fmt: skip
    factors = {name: length(*[(f"{s}_{a}", f"{s}_{b}") for s in "lr"]) / abs(origins[number[f"r_{name}"], 1])
               for name, (a, b) in bones.items()}  # fmt: skip
    factors["thigh"] = length(("l_hip", "r_hip")) / (2 * origins[number["r_thigh"], 2])
    wide = origins[number["r_clavicle"], 2] + origins[number["r_upper_arm"], 2]
    factors["upper_arm"] = length(("l_shoulder", "r_shoulder")) / (2 * wide)
    hips, shoulders = ((place[f"l_{part}"] + place[f"r_{part}"]) / 2 for part in ("hip", "shoulder"))
    tall = origins[number["torso"], 1] + origins[number["r_clavicle"], 1]
    place |= {"hips": hips, "shoulders": shoulders}
    factors["torso"] = length(("hips", "shoulders")) / tall
    known = [factor for factor in factors.values() if np.isfinite(factor)]
    stature = float(np.median(known))
    factors = {name: factor if np.isfinite(factor) else stature for name, factor in factors.items()}
    factors |= {"head": factors["torso"], "clavicle": factors["torso"]}
    for name, i in number.items():
        origins[i] *= factors.get(name.removeprefix("l_").removeprefix("r_"), stature)
    for side in "lr":
        origins[number[f"{side}_clavicle"], 2] *= factors["upper_arm"] / factors["torso"]
    torso = np.array([body.segments[on] == "torso" for on in body.on])
    landmarks = body.landmarks * np.where(torso, factors["torso"], stature)[:, None]
    return replace(body, origins=origins, landmarks=landmarks, hip=stature * body.hip)


def _refined(motion: BodyMotion, xyz: np.ndarray) -> Body:
    """Return the body with landmarks at the median place of joints (F, J, 3) in their segment, alike on both sides.

    Landmarks of head, hands and feet keep their mean direction, as a rotation of them would be one of the segment.
    Limbs keep the lengths that were measured.
    """
    body = motion.body
    at, turned = body.place(motion.root, motion.local)
    on, at_origin = np.array(body.on), ~body.landmarks.any(-1)
    # Joints between two segments keep their place on the upper one.
    joining = at_origin & (on > 0)
    holder = np.where(joining, np.array(body.parents)[on], on)
    names = np.array([body.segments[segment].removeprefix("l_").removeprefix("r_") for segment in holder])
    # Places on pelvis, head, hands and feet are relative to the measured joint at the origin, if there is one.
    base = at.copy()
    for joint in np.flatnonzero(at_origin):
        base[:, on[joint]] = xyz[:, joint]
    base = np.where(np.isin(names, ("torso", "clavicle"))[:, None], at[:, holder], base[:, holder])
    local = (turned[:, holder].swapaxes(-1, -2) @ (xyz - base)[..., None])[..., 0]
    place = np.where(joining[:, None], body.origins[on], body.landmarks)
    usual = _usual_places(local, body.joints, place)
    ends = np.isin(names, ("head", "hand", "foot"))
    for segment in set(holder[ends].tolist()):
        inside = ends & (holder == segment)
        if inside.sum() == 1:
            usual[inside] = place[inside] * np.linalg.norm(usual[inside]) / np.linalg.norm(place[inside])
        else:
            usual[inside] = Rotation.align_vectors(place[inside], usual[inside])[0].apply(usual[inside])
    moved = ends | np.isin(names, ("pelvis", "torso", "clavicle"))
    origins, landmarks = body.origins.copy(), body.landmarks.copy()
    origins[on[moved & joining]] = usual[moved & joining]
    landmarks[moved & ~joining] = usual[moved & ~joining]
    return replace(body, origins=origins, landmarks=landmarks)


def _usual_places(local: np.ndarray, joints: tuple[str, ...], otherwise: np.ndarray) -> np.ndarray:
    """Return the median place (J, 3) of joints in their segment, alike on both sides, from places (F, J, 3).

    Joints that are known too seldom are `otherwise` (J, 3).
    """
    order = {joint: number for number, joint in enumerate(joints)}
    twin = [order.get({"l_": "r_", "r_": "l_"}.get(joint[:2], "") + joint[2:], n) for joint, n in order.items()]
    mirrored = local[:, twin] * (1, 1, -1)
    mirrored[:, [n for n, other in enumerate(twin) if n == other]] = np.nan
    both = np.concatenate([local, mirrored])
    known = ~np.isnan(both).any(-1)
    usual = otherwise.copy()
    for joint in np.flatnonzero(known.sum(0) >= _ENOUGH):
        usual[joint] = np.median(both[known[:, joint], joint], 0)
    return usual


def _level(body: Body, motion: BodyMotion, xyz: np.ndarray) -> Body:
    """Return the body whose pelvis is level in frames of joints (F, J, 3) in which the person stands upright.

    Without such frames the mean of people applies, with a larger standard deviation.
    """
    lean, thighs = leans(motion)
    needed = [n for n, joint in enumerate(body.joints) if joint[2:] in ("hip", "knee", "shoulder")]
    upright = is_upright(lean, thighs) & ~np.isnan(xyz[:, needed]).any((1, 2))
    if upright.sum() < _ENOUGH:
        return body
    lean, thighs = np.median(lean[upright]), np.median(thighs[upright].mean(-1))
    return replace(
        body,
        standing=np.radians(_LUMBAR_SHARE * thighs - (1 - _LUMBAR_SHARE) * lean),
        lumbar_sd=np.radians(_LUMBAR_SD[0]),
    )


def leans(motion: BodyMotion) -> tuple[np.ndarray, np.ndarray]:
    """Return the lean of the trunk (F,), from hips to shoulders, and the flexion of both thighs (F, 2), degrees.

    They are angles from the vertical in the plane in which the person faces, positive to the front.
    """
    body = motion.body
    at, turned = body.place(motion.root, motion.local)
    segment = [body.segments.index(f"{side}_{name}") for name in ("upper_arm", "thigh") for side in "rl"]
    right = turned[:, 0, :, 2] * (1, 1, 0)
    ahead = np.cross((0, 0, 1), right) / np.maximum(np.linalg.norm(right, axis=-1, keepdims=True), 1e-9)

    def forward(up: np.ndarray) -> np.ndarray:
        return np.degrees(np.arctan2((up * ahead).sum(-1), up[..., 2]))

    trunk = at[:, segment[:2]].mean(1) - at[:, 0]
    return forward(trunk), np.stack([-forward(turned[:, thigh, :, 1]) for thigh in segment[2:]], -1)


def is_upright(lean: np.ndarray, thighs: np.ndarray) -> np.ndarray:
    """Return (F,) True where a person stands upright, given `leans`."""
    low, high = _UPRIGHT_THIGHS
    return (np.abs(lean) < _UPRIGHT_TRUNK) & ((thighs > low) & (thighs < high)).all(-1)


def _precision(poses: Poses3D, person: int, given: list[int]) -> np.ndarray:
    """Return the square roots (F, J, 3, 3) of the inverse covariances of joints, 1/m; zero where absent."""
    cov = poses.cov[:, person][:, given].astype(np.float64)
    source = poses.source[:, person][:, given]
    unknown = np.any(np.isnan(cov), (-1, -2))
    default = np.zeros(source.shape)
    for kind, error in _UNKNOWN_ERROR.items():
        default[source == kind] = error**2
    cov = np.where(unknown[..., None, None], default[..., None, None] * np.eye(3), cov) + _MODEL_ERROR**2 * np.eye(3)
    root = np.linalg.inv(np.linalg.cholesky(cov))
    return np.where((source == Source.ABSENT)[..., None, None], 0, root)


def _starting_frames(xyz: np.ndarray, body: Body, person: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mid points of the hips (F, 3) and axes of the pelvis (F, 3, 3), nearest in time; NoBody if they are never
    known."""
    at = {joint: xyz[:, body.joints.index(joint)] for joint in ("l_hip", "r_hip", "l_shoulder", "r_shoulder")}
    hips, shoulders = (at["l_hip"] + at["r_hip"]) / 2, (at["l_shoulder"] + at["r_shoulder"]) / 2
    if "mid_hip" in body.joints:
        hips = np.where(np.isnan(hips), xyz[:, body.joints.index("mid_hip")], hips)
    hip, shoulder = at["r_hip"] - at["l_hip"], at["r_shoulder"] - at["l_shoulder"]
    right = np.where(np.isnan(hip), shoulder, hip)
    up = shoulders - hips
    if np.isnan(right).any(-1).all() or np.isnan(up).any(-1).all():
        never = ", ".join(joint for joint, path in at.items() if np.isnan(path).any(-1).all())
        raise NoBody(
            f"{person_name(person)}: {'never known: ' + never if never else 'never known in the same frame'}; "
            "without hips and shoulders there is no body"
        )
    root, right, up = (hold(part[:, None])[:, 0] for part in (hips, right, up))
    return root, _axes(up, right)


def _axes(up: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return axes (F, 3, 3): y along `up` (F, 3), z near `right` (F, 3)."""
    y = up / np.maximum(np.linalg.norm(up, axis=-1, keepdims=True), 1e-9)
    x = np.cross(y, right)
    # `right` along `up` determines no axes; any across do.
    across = np.cross(y, np.eye(3)[np.abs(y).argmin(-1)])
    x = np.where(np.linalg.norm(x, axis=-1, keepdims=True) < 1e-6, across, x)
    x /= np.maximum(np.linalg.norm(x, axis=-1, keepdims=True), 1e-9)
    return np.stack([x, y, np.cross(x, y)], -1)


def _start(body: Body, xyz: np.ndarray, root: np.ndarray, pelvis: np.ndarray) -> np.ndarray:
    """Return rotations (F, S, 3, 3) near the solution: limbs point along their bones and bend in their plane."""
    local = np.tile(np.eye(3), (len(xyz), len(body.segments), 1, 1))
    local[:, 0] = pelvis
    place = {joint: xyz[:, number] for number, joint in enumerate(body.joints)}
    segment = {name: number for number, name in enumerate(body.segments)}
    for side in "rl":
        for upper, lower, ends, bends in (("thigh", "shank", ("hip", "knee", "ankle"), -1),
                                          ("upper_arm", "forearm", ("shoulder", "elbow", "wrist"), 1)):  # fmt: skip
            a, b, c = (place.get(f"{side}_{end}", np.full_like(root, np.nan)) for end in ends)
            first, second = a - b, c - b
            lengths = np.maximum(np.linalg.norm(first, axis=-1) * np.linalg.norm(second, axis=-1), 1e-9)
            plane = bends * np.cross(second, first) / lengths[:, None]
            right = np.nan_to_num(plane) + 0.2 * pelvis[..., 2]
            axes = _axes(first, right)
            known = ~np.isnan(first).any(-1)
            above = segment[f"{side}_{upper}"]
            local[known, above] = (pelvis.swapaxes(-1, -2) @ axes)[known]
            cosine = -(first * second).sum(-1) / lengths
            angle = np.nan_to_num(bends * np.arccos(np.clip(cosine, -1, 1)))
            turn = np.zeros((len(xyz), 3))
            turn[:, 2] = angle
            local[:, segment[f"{side}_{lower}"]] = Rotation.from_rotvec(turn).as_matrix()
    return local


def _solve(body: Body, xyz: np.ndarray, precision: np.ndarray, start: tuple[np.ndarray, np.ndarray]) -> BodyMotion:
    """Return the motion that fits joints best.

    Args:
        xyz: (F, J, 3) m, NaN where absent.
        precision: (F, J, 3, 3) 1/m, square roots of inverse covariances; zero where absent.
        start: Mid point of the hips (F, 3) and axes of the pelvis (F, 3, 3).
    """
    frames, count = len(xyz), len(body.segments)
    unknown = _Unknowns.of(body)
    root, local = np.empty((frames, 3)), np.empty((frames, count, 3, 3))
    cov, root_cov = np.empty((frames, count, 3, 3)), np.empty((frames, 3, 3))
    cov[:] = [np.diag(sd**2) for sd in body.prior]
    for first in range(0, frames, _FRAMES):
        part = slice(first, first + _FRAMES)
        begin = (start[0][part], _start(body, xyz[part], start[0][part], start[1][part]))
        root[part], local[part], full = _solve_part(body, unknown, xyz[part], precision[part], *begin)
        root_cov[part] = full[:, :3, :3]
        for segment, own in unknown.columns.items():
            cov[part, segment] = full[:, own, own]
    return BodyMotion(body, root, local, cov, root_cov)


@dataclass(frozen=True)
class _Unknowns:
    """The N unknowns of a frame: a shift of the whole body, and small rotations of segments in their own axes."""

    size: int  # N
    columns: dict[int, slice]  # Of the rotation of each segment that turns, parents first; the shift has columns 0 to 2
    # joint, above: (n,) each joint with each segment that turns it: the one that it is on, and those above
    joint: np.ndarray
    above: np.ndarray
    axes: np.ndarray  # (n, 3) columns of the rotation of `above`

    @classmethod
    def of(cls, body: Body) -> "_Unknowns":
        """Return the unknowns of a body. A segment turns only where a landmark shows it."""
        levers = {on for on, place in zip(body.on, body.landmarks, strict=True) if place.any()}
        levers |= {body.parents[on] for on in body.on}
        moving = sorted({above for segment in levers for above in _upwards(body.parents, segment)})
        columns = {segment: slice(3 + 3 * number, 6 + 3 * number) for number, segment in enumerate(moving)}
        turning = [(joint, above) for joint, on in enumerate(body.on) for above in _upwards(body.parents, on)]
        joint, above = np.array([pair for pair in turning if pair[1] in columns]).T
        axes = np.array([columns[segment].start for segment in above])[:, None] + np.arange(3)
        return cls(3 + 3 * len(moving), columns, joint, above, axes)


def _upwards(parents: tuple[int, ...], segment: int) -> Iterator[int]:
    while segment >= 0:
        yield segment
        segment = parents[segment]


def _solve_part(
    body: Body, unknown: _Unknowns, xyz: np.ndarray, precision: np.ndarray, root: np.ndarray, local: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return root (F, 3), rotations (F, S, 3, 3) and the covariance (F, N, N) of the unknowns."""
    moving = list(unknown.columns)
    for step in range(_STEPS + 1):
        H, gradient = _landmark_equations(body, unknown, xyz, precision, root, local, robust=step > 2)
        _add_prior(body, unknown, local, H, gradient)
        change = np.linalg.solve(H, gradient[..., None])[..., 0]
        if step == _STEPS or np.abs(change).max(initial=0) < _CONVERGED:
            break
        turn = change[:, 3:].reshape(-1, 3)
        turn *= np.minimum(1, _MOST_STEP / np.maximum(np.linalg.norm(turn, axis=-1, keepdims=True), 1e-9))
        root = root + change[:, :3]
        local[:, moving] = local[:, moving] @ Rotation.from_rotvec(turn).as_matrix().reshape(len(xyz), -1, 3, 3)
    return root, local, np.linalg.inv(H)


def _landmark_equations(
    body: Body,
    unknown: _Unknowns,
    xyz: np.ndarray,
    precision: np.ndarray,
    root: np.ndarray,
    local: np.ndarray,
    robust: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the normal matrix (F, N, N) and the gradient (F, N) of the distances from landmarks to joints.

    With `robust`, joints that are far off count less (Huber).
    """
    frames, on = len(xyz), list(body.on)
    at, turned = body.place(root, local)
    points = at[:, on] + (turned[:, on] @ body.landmarks[..., None])[..., 0]
    J = np.zeros((frames, len(on), 3, unknown.size))
    J[..., :3] = np.eye(3)
    # A rotation about an axis moves a landmark by the cross product with its lever. `np.cross` is slow for few frames.
    x, y, z = np.moveaxis(turned[:, unknown.above], 2, 0)
    a, b, c = np.moveaxis(points[:, unknown.joint] - at[:, unknown.above], 2, 0)[..., None]
    moved = np.stack([y * c - z * b, z * a - x * c, x * b - y * a], 2)
    J[:, unknown.joint[:, None, None], np.arange(3)[:, None], unknown.axes[:, None]] = moved
    residual = (precision @ (np.nan_to_num(xyz) - points)[..., None])[..., 0]
    distance = np.linalg.norm(residual, axis=-1)
    weight = np.sqrt(np.minimum(1, _HUBER / np.maximum(distance, 1e-9))) if robust else np.ones_like(distance)
    J = ((weight[..., None, None] * precision) @ J).reshape(frames, -1, unknown.size)
    residual = (weight[..., None] * residual).reshape(frames, -1)
    return J.swapaxes(-1, -2) @ J, (J.swapaxes(-1, -2) @ residual[..., None])[..., 0]


def _add_prior(body: Body, unknown: _Unknowns, local: np.ndarray, H: np.ndarray, gradient: np.ndarray) -> None:
    """Add to normal equations what is known of a body without its joints: rotations near neutral, and the pelvis' share
    of the angle between trunk and thighs."""
    frames, (_, *moving) = len(local), unknown.columns  # the pelvis turns freely
    torso, hips = body.segments.index("torso"), [body.segments.index(f"{side}_thigh") for side in "rl"]
    weight = 1 / body.prior**2
    weight[torso, 2] = 0  # the coupling of lumbar spine and hips takes its place
    # The line from hips to shoulders leans by less than the torso turns, because it turns above the hips.
    share = {torso: (1 - _LUMBAR_SHARE) * _trunk_share(body)}
    share |= dict.fromkeys(hips, _LUMBAR_SHARE / 2)
    # A body that is not seen at all in a frame stays where it was.
    H[:, range(unknown.size), range(unknown.size)] += 1e-3
    flexion, folded, row = np.zeros(frames), np.zeros(frames), np.zeros((frames, unknown.size))
    turns = Rotation.from_matrix(local[:, moving].reshape(-1, 3, 3)).as_rotvec().reshape(frames, -1, 3)
    by_turns = _inverse_right_jacobian(turns)
    for number, segment in enumerate(moving):
        turn, by_turn, own = turns[:, number], by_turns[:, number], unknown.columns[segment]
        weighted = by_turn.swapaxes(-1, -2) * weight[segment]
        H[:, own, own] += weighted @ by_turn
        gradient[:, own] -= (weighted @ turn[..., None])[..., 0]
        if segment in share:
            flexion += share[segment] * turn[:, 2]
            folded += turn[:, 2] * (-1 if segment == torso else 0.5)
            row[:, own] = share[segment] * by_turn[:, 2]
    bent = (flexion - body.standing)[:, None]
    variance = body.lumbar_sd**2 + (_LUMBAR_SD[1] * folded[:, None]) ** 2
    H += row[:, :, None] * (row / variance)[:, None]
    gradient -= row * bent / variance


def _trunk_share(body: Body) -> float:
    """Return by how much the line from hips to shoulders leans as the torso turns in the pelvis."""
    low = body.origins[body.segments.index("torso"), 1]
    high = body.origins[body.segments.index("r_clavicle"), 1]
    return float(high / (low + high))


def _inverse_right_jacobian(turns: np.ndarray) -> np.ndarray:
    """Return d log(R exp(d)) / d d for rotation vectors (..., 3): (..., 3, 3) (Sola et al. 2018, eq. 144)."""
    angle = np.maximum(np.linalg.norm(turns, axis=-1), 1e-6)
    K = np.zeros((*turns.shape, 3))
    K[..., [2, 0, 1], [1, 2, 0]], K[..., [1, 2, 0], [2, 0, 1]] = turns, -turns
    # (1 + cos) / (2 angle sin) = 1 / (2 angle tan(angle / 2)); the series avoids 0 - 0.
    small = angle < 1e-2
    factor = np.where(small, 1 / 12, 1 / angle**2 - 1 / (2 * angle * np.tan(np.minimum(angle, 3.1) / 2)))
    return np.eye(3) + K / 2 + factor[..., None, None] * (K @ K)


# Joint angles


class Angle(NamedTuple):
    """A joint angle."""

    name: str  # Name in OpenSim
    segment: str  # Segment that turns in its parent
    axis: int  # 0 flexion, about z; 1 adduction, about x; 2 rotation, about y
    sign: int = 1  # Sign of the Cardan angle


def _angles() -> tuple[Angle, ...]:
    found = [Angle(f"pelvis_{name}", "pelvis", axis) for axis, name in enumerate(("tilt", "list", "rotation"))]
    for side, sign in (("r", 1), ("l", -1)):
        found += [
            Angle(f"hip_flexion_{side}", f"{side}_thigh", 0),
            Angle(f"hip_adduction_{side}", f"{side}_thigh", 1, sign),
            Angle(f"hip_rotation_{side}", f"{side}_thigh", 2, sign),
            Angle(f"knee_angle_{side}", f"{side}_shank", 0, -1),
            Angle(f"ankle_angle_{side}", f"{side}_foot", 0),
            Angle(f"subtalar_angle_{side}", f"{side}_foot", 1, sign),
        ]
    found += [Angle(f"L5_S1_{name}", "torso", axis) for axis, name in
              enumerate(("Flex_Ext", "Lat_Bending", "axial_rotation"))]  # fmt: skip
    found += [Angle(f"neck_{name}", "head", axis) for axis, name in enumerate(("flexion", "bending", "rotation"))]
    for side, sign in (("r", 1), ("l", -1)):
        found += [
            Angle(f"arm_flex_{side}", f"{side}_upper_arm", 0),
            Angle(f"arm_add_{side}", f"{side}_upper_arm", 1, sign),
            Angle(f"arm_rot_{side}", f"{side}_upper_arm", 2, sign),
            Angle(f"elbow_flex_{side}", f"{side}_forearm", 0),
        ]
    return tuple(found)


ANGLES = _angles()
"""All angles, in the order of OpenSim's coordinates."""


def cardan(local: np.ndarray) -> np.ndarray:
    """Return Cardan angles (..., 3) of rotations (..., 3, 3) about z, x and y, in this order, rad."""
    x = np.arcsin(np.clip(local[..., 2, 1], -1, 1))
    return np.stack(
        [np.arctan2(-local[..., 0, 1], local[..., 1, 1]), x, np.arctan2(-local[..., 2, 0], local[..., 2, 2])], -1
    )


def joint_angles(motion: BodyMotion) -> tuple[np.ndarray, np.ndarray]:
    """Return `ANGLES` (F, A) and their standard deviations (F, A), degrees; NaN where the joints do not determine them.

    Angles continue from frame to frame without jumps of a full turn. `motion` has F frames.
    """
    values, spread, known = estimated_angles(motion, ISB.T)
    values = np.where(known, values, np.nan)
    for column in values.T:
        there = ~np.isnan(column)
        column[there] = np.unwrap(column[there], period=360)
    return values, np.where(known, spread, np.nan)


def estimated_angles(motion: BodyMotion, up: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return `ANGLES` and their standard deviations (F, A), degrees, and (F, A) where the joints determine them.

    Where they do not, the angles belong to a body at rest. Values are between -180 and 180. `up` is the rotation from
    our world to a world with y up, in which the pelvis has its angles.
    """
    names = {name: number for number, name in enumerate(motion.body.segments)}
    rotations, shape = _about_hip_joints(motion), (len(motion.root), len(ANGLES))
    values, spread, known = np.empty(shape), np.empty(shape), np.empty(shape, bool)
    done: dict[str, tuple[np.ndarray, np.ndarray]] = {}
    for column, angle in enumerate(ANGLES):
        number = names[angle.segment]
        if angle.segment not in done:
            local = up @ rotations[:, number] if number == 0 else rotations[:, number]
            turned = cardan(local)
            done[angle.segment] = turned, _spread(turned, motion.cov[:, number])
        turned, sd = done[angle.segment]
        prior = np.degrees(motion.body.prior[number, (2, 0, 1)[angle.axis]])
        values[:, column] = angle.sign * np.degrees(turned[:, angle.axis])
        spread[:, column] = np.degrees(sd[:, angle.axis])
        known[:, column] = spread[:, column] < np.minimum(_DETERMINED * prior, _LARGEST_SD)
    return values, spread, known


def _about_hip_joints(motion: BodyMotion) -> np.ndarray:
    """Return the rotations (F, S, 3, 3) of segments whose thighs turn about the hip joints instead of the landmarks."""
    body, local = motion.body, motion.local.copy()
    for side, sign in (("r", 1), ("l", -1)):
        thigh, shank = (body.segments.index(f"{side}_{name}") for name in ("thigh", "shank"))
        knee = local[:, thigh] @ body.origins[shank]
        bone = knee + body.hip * (1, 1, sign)
        axis = np.cross(knee, bone) / np.sum(knee * knee, -1, keepdims=True)
        turn = Rotation.from_rotvec(axis).as_matrix()
        local[:, shank] = (turn @ local[:, thigh]).swapaxes(-1, -2) @ local[:, thigh] @ local[:, shank]
        local[:, thigh] = turn @ local[:, thigh]
    return local


def _spread(turned: np.ndarray, cov: np.ndarray) -> np.ndarray:
    """Return standard deviations (F, 3), rad, of Cardan angles (F, 3) with covariances of small rotations (F, 3, 3)."""
    x, y = turned[:, 1], turned[:, 2]
    # Columns: the axes about which each angle turns, in the axes of the segment.
    axes = np.zeros((len(turned), 3, 3))
    axes[:, :, 0] = np.stack([-np.cos(x) * np.sin(y), np.sin(x), np.cos(x) * np.cos(y)], -1)
    axes[:, :, 1] = np.stack([np.cos(y), np.zeros_like(y), np.sin(y)], -1)
    axes[:, 1, 2] = 1
    singular = np.abs(np.cos(x)) < 0.05
    axes[singular] = np.eye(3)
    inverse = np.linalg.inv(axes)
    found = np.sqrt(np.einsum("fij,fjk,fik->fi", inverse, cov, inverse))
    found[singular] = np.inf
    return found


def defining_joints(body: Body, segment: str) -> list[str]:
    """Return the landmarks that show how a segment turns in its parent: on both, and where their children begin.

    A child that begins at no landmark, as the clavicles do, passes on the ends of its own: the shoulders.
    """
    begins = set(np.array(body.on)[~np.any(body.landmarks, -1)].tolist())

    def ends(number: int) -> set[int]:
        children = [child for child, parent in enumerate(body.parents) if parent == number]
        return {end for child in children for end in ([child] if child in begins else ends(child))}

    number = body.segments.index(segment)
    both = {number, body.parents[number]}
    at_ends = set().union(*(ends(each) for each in both if each >= 0))
    at_origin = ~np.any(body.landmarks, -1)
    return [
        joint
        for joint, on, end in zip(body.joints, body.on, at_origin, strict=True)
        if on in both or (end and on in at_ends)
    ]
