"""Make the pack of `dmae regress` (`dmae.regression.pack`): from seeds, except the crowd, which is a simulated clip.

    synth generate out=runs/crowd seed=11 clips=1 scene.persons=[6,6] scene.seconds=6 scene.props=[2,2]
    python docs/tools/regression_pack.py runs/crowd/000000

writes a new pack and prints its checksum for `_SHA256` of `dmae.regression.pack`.
"""

import hashlib
import io
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.data.clip import Clip
from dmae.data.conversion import convert
from dmae.data.store import load_clip
from dmae.files.contents import write_atomic
from dmae.regression.pack import FILE, Case

_SIZE = (1280, 1024)
_CENTRE = ((_SIZE[0] - 1) / 2, (_SIZE[1] - 1) / 2)
_ROOM = np.array([[-1.2, -1.2, 0], [1.2, 1.2, 2]])
_GROSS = (50, 300)  # px; the smallest and the largest gross error
_GROSS_ON_PERSON = 0.07
"""m; a larger error of a detection of the crowd, measured at the person's depth, is gross. 94 % are smaller."""
_FAR = (500_000, 5_400_000, 300)  # m; UTM coordinates of the origin of a room in Bavaria
_CROWD_FRAMES = slice(0, None, 12)
_CROWD_JOINTS = (
    "nose", "neck", "r_shoulder", "r_elbow", "r_wrist", "l_shoulder", "l_elbow", "l_wrist",
    "r_hip", "r_knee", "r_ankle", "l_hip", "l_knee", "l_ankle",
)  # fmt: skip


def seeded_cases() -> list[Case]:
    """Return the pack without the crowd."""
    return [*_exact_cases(), *_input_cases(), *_noisy_cases(), *_gross_cases()]


def _exact_cases() -> list[Case]:
    rng = np.random.default_rng(1)
    rig = _ring(5, rng=rng)
    points = _room(rig, 150, rng=rng)
    off_centre = _ring(5, rng=rng)
    off_centre.K[:, (0, 1), (0, 1)] *= rng.uniform(0.85, 1.15, (5, 2))
    off_centre.K[:, :2, 2] += rng.uniform(80, 160, (5, 2)) * rng.choice((-1, 1), (5, 2))
    far = _ring(5, rng=rng)
    far_points = _room(far, 150, rng=rng) + _FAR
    far.cam_from_world[:, :3, 3] -= far.cam_from_world[:, :3, :3] @ np.array(_FAR, float)
    walk = _walk()
    absent = _project("absent", rig, _room(rig, 200, rng=rng))
    absent.xy[rng.random((200, 5)) < 0.6] = np.nan
    absent.confidence[np.isnan(absent.xy[..., 0])] = np.nan
    absent.usable[:] = np.isfinite(absent.confidence)
    return [
        _project("clean", rig, points),
        _project("off-centre", off_centre, _room(off_centre, 150, rng=rng)),
        _distorted("distorted-5", (-0.28, 0.11, 0.002, -0.0015, -0.02), rng=rng),
        _distorted("distorted-8", (0.35, 0.12, -0.0012, 0.0018, 0.01, 0.62, 0.22, 0.03), rng=rng),
        _project("far-world", far, far_points),
        _project("moving", rig, walk),
        absent,
        _behind(rng=rng),
    ]


def _input_cases() -> list[Case]:
    """Return exact cases with unusual input: low or missing confidences, skewed pixels, points outside the images."""
    rng = np.random.default_rng(4)
    rig = _ring(5, rng=rng)
    unsure = _project("unsure", rig, _room(rig, 150, rng=rng))
    unsure.confidence[:] = rng.uniform(0.1, 0.45, unsure.confidence.shape)
    skewed = _ring(5, rng=rng)
    skewed.K[:, 0, 1] = rng.uniform(20, 60, 5) * rng.choice((-1, 1), 5)
    return [unsure, _unrated(rig, rng=rng), _project("skewed", skewed, _room(skewed, 150, rng=rng)), _outside(rng=rng)]


def _unrated(rig: CameraRig, *, rng: np.random.Generator) -> Case:
    """Return a case in which three of five views see another point, consistently and without a confidence."""
    points = _room(rig, 150, rng=rng)
    case, other = _project("unrated", rig, points), _project("", rig, rng.permutation(points))
    point = np.arange(150)[:, None]
    order = rng.permuted(np.tile(np.arange(5), (150, 1)), axis=1)
    without, alone = order[:, :3], order[:30, 3]
    case.confidence[:] = rng.uniform(0.3, 0.7, case.confidence.shape)
    case.xy[point, without] = other.xy[point, without]
    case.confidence[point, without] = np.nan
    # A fifth of the points keep only a single view.
    case.confidence[np.arange(30), alone] = np.nan
    case.usable[:] = np.isfinite(case.confidence)
    return case


def _outside(*, rng: np.random.Generator) -> Case:
    """Return a case of points up to 150 px outside the images of most views. Detectors also predict joints there."""
    rig = _ring(5, focal=2000, rng=rng)
    found = np.empty((0, 3))
    while len(found) < 150:
        offered = rng.uniform(*_ROOM * 1.2, (4000, 3))
        xy, depth = rig.project(offered)
        beyond = np.maximum(-0.5 - xy, xy - rig.size + 0.5).max(-1)
        fits = ((beyond < 150) & (depth > 1)).all(-1) & ((beyond > 10).sum(-1) >= 4)
        found = np.concatenate([found, offered[fits]])
    return _project("outside", rig, found[:150])


def _noisy_cases() -> list[Case]:
    rng = np.random.default_rng(2)
    found = []
    ring = _ring(5, rng=rng)
    for views in (2, 3, 4, 6, 8, 12):
        # Two views on a circle would face each other.
        rig = ring[:2] if views == 2 else _ring(views, rng=rng)
        found.append(_project(f"views-{views}", rig, _room(rig, 250, rng=rng), 1.0, rng=rng))
    found.append(_project("noisy", ring, _room(ring, 250, rng=rng), 3.0, rng=rng))
    row = _wall(0.3, 0.0, rng=rng)
    found.append(_project("short-baseline", row, _room(row, 250, rng=rng), 0.5, rng=rng))
    return found


def _gross_cases() -> list[Case]:
    rng = np.random.default_rng(3)
    found = []
    for name, views, wrong in (("outliers-1-of-5", 5, 1), ("outliers-2-of-8", 8, 2), ("doubted", 4, 1)):
        rig = _ring(views, rng=rng)
        case = _project(name, rig, _room(rig, 250, rng=rng), 1.0, rng=rng)
        order = rng.permuted(np.tile(np.arange(views), (250, 1)), axis=1)[:, :wrong]
        point = np.arange(250)[:, None]
        case.xy[point, order] += _any_direction((250, wrong), rng=rng) * rng.uniform(*_GROSS, (250, wrong, 1))
        case.usable[point, order] = False
        if name == "doubted":
            case.confidence[:] = np.where(case.usable, rng.uniform(0.8, 0.95, (250, 4)), 0.05)
        found.append(case)
    return found


def crowd_cases(clip: Clip) -> list[Case]:
    """Return two cases of some frames and joints of a simulated clip: with its five views, and with three of them.

    Detections are sorted by person. If a person has several in a view, the one with most joints is used.
    """
    clip = clip.select(_CROWD_FRAMES)
    joints = clip.detections.skeleton.index(*_CROWD_JOINTS)
    truth = convert(clip.truth, clip.detections.skeleton).xyz[:, :, joints].astype(np.float64)
    # (F, V, D, P), then (F, V, P, 1): a detection without joints counts more than none.
    of_person = clip.detection_labels.person[..., None] == np.arange(truth.shape[1])
    fullness = np.where(of_person, 1 + clip.detections.observed.sum(-1)[..., None], 0)
    fullest, there = fullness.argmax(2)[..., None], fullness.max(2)[..., None] > 0
    score = np.where(there, np.take_along_axis(clip.detections.score, fullest, 2)[..., joints], np.nan)
    xy = np.take_along_axis(clip.detections.xy, fullest[..., None], 2)[..., joints, :]
    xy = np.where(there[..., None], xy, np.nan)
    true_xy, depth = clip.rig.project(truth)
    with np.errstate(invalid="ignore"):
        off = np.linalg.norm(xy - true_xy, axis=-1)
        usable = off * depth / clip.rig.K[:, 0, 0][:, None, None] < _GROSS_ON_PERSON

    def flat(array):
        """Return an array (F, V, P, J, ...) as (n, V, ...), ordered by frame, then person, then joint."""
        return np.moveaxis(array, 1, 3).reshape(-1, array.shape[1], *array.shape[4:])

    whole = Case(
        "crowd-5",
        *_calibration(clip.rig),
        flat(xy),
        flat(score),
        truth.reshape(-1, 3),
        flat(usable),
        float(1.4826 * np.median(np.abs(xy - true_xy)[usable])),
    )
    three = [0, 2, 4]
    less = clip.rig[three]
    part = Case(
        "crowd-3",
        *_calibration(less),
        whole.xy[:, three],
        whole.confidence[:, three],
        whole.xyz,
        whole.usable[:, three],
        whole.sigma,
    )
    return [whole, part]


def _calibration(rig: CameraRig) -> tuple[np.ndarray, ...]:
    return rig.K, rig.dist, rig.cam_from_world, rig.size


def _project(name: str, rig: CameraRig, points: np.ndarray, sigma: float = 0.0, rng=None) -> Case:
    """Project points (n, 3) into all views of a rig, with noise of `sigma` px."""
    xy = rig.project(points)[0]
    if sigma:
        xy = xy + rng.normal(0, sigma, xy.shape)
    n, views = xy.shape[:2]
    return Case(name, *_calibration(rig), xy, np.full((n, views), 0.9), points, np.ones((n, views), bool), sigma)


def _distorted(name: str, coefficients: tuple[float, ...], *, rng: np.random.Generator) -> Case:
    """Return a case of wide lenses that move the corners of the image by many pixels."""
    rig = _ring(5, focal=720, rng=rng)
    dist = np.array(coefficients) * rng.uniform(0.8, 1.2, (5, 1))
    rig = CameraRig(rig.names, rig.K, dist, rig.cam_from_world, rig.size)
    return _project(name, rig, _room(rig, 150, 1.6, rng=rng))


def _behind(*, rng: np.random.Generator) -> Case:
    """Return a case where half the points are real; the lines of sight of the others meet behind all cameras."""
    rig = _wall(1.2, 0.12, rng=rng)
    front, back = _room(rig, 75, rng=rng), np.empty((0, 3))
    R, centre = rig.cam_from_world[1, :3, :3], rig.centers[1]
    while len(back) < 75:
        depth = rng.uniform(-7, -2, (500, 1))
        offered = np.concatenate([rng.uniform(-0.6, 0.6, (500, 2)) * depth, depth], -1) @ R + centre
        homogeneous = np.einsum("vij,nj->nvi", rig.projections, np.c_[offered, np.ones(500)])
        inside = rig.inside((homogeneous[..., :2] / homogeneous[..., 2:])[:, :, None])[..., 0]
        back = np.concatenate([back, offered[(inside & (homogeneous[..., 2] < -0.5)).all(-1)]])[:75]
    case = _project("behind", rig, np.concatenate([front, back]))
    homogeneous = np.einsum("vij,nj->nvi", rig.projections, np.c_[back, np.ones(75)])
    case.xy[75:] = homogeneous[..., :2] / homogeneous[..., 2:]
    case.xyz[75:] = np.nan
    return case


def _walk() -> np.ndarray:
    """Return (300, 3) m: 20 frames, at 25/s, of 15 joints that cross the room at 1.5 m/s with swinging limbs."""
    frame, joint = np.arange(20)[:, None], np.arange(15)
    swing = 0.2 * np.sin(2 * np.pi * (frame / 20 + joint / 5))
    x, y = -0.6 + 0.06 * frame + swing, 0.25 * np.cos(2.4 * joint) + 0.3 * swing
    return np.stack(np.broadcast_arrays(x, y, 0.1 + 0.11 * joint), -1).reshape(-1, 3)


def _any_direction(shape: tuple[int, ...], *, rng: np.random.Generator) -> np.ndarray:
    """Return random unit vectors (*shape, 2)."""
    angle = rng.uniform(0, 2 * np.pi, shape)
    return np.stack([np.cos(angle), np.sin(angle)], -1)


def _room(rig: CameraRig, count: int, scale: float = 1.0, *, rng: np.random.Generator) -> np.ndarray:
    """Return (count, 3) points, m, uniform in the part of the room that every camera sees."""
    found = np.empty((0, 3))
    while len(found) < count:
        offered = rng.uniform(*_ROOM * scale, (4 * count, 3))
        found = np.concatenate([found, offered[rig.inside(rig.project(offered)[0][:, :, None])[..., 0].all(-1)]])
    return found[:count]


def _ring(views: int, focal: float = 1100.0, *, rng: np.random.Generator) -> CameraRig:
    """Return centred pinholes with square pixels on a circle of about 4.5 m, 0.8 to 2.8 m high, rolled up to 25 deg."""
    angle = 2 * np.pi * (np.arange(views) + rng.uniform(-0.15, 0.15, views)) / views
    radius = rng.uniform(4, 5, views)
    centres = np.stack([radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0.8, 2.8, views)], -1)
    return _looking(centres, rng.normal(0, 0.1, (views, 3)) + (0, 0, 1), focal, rng.uniform(-0.45, 0.45, views))


def _wall(apart: float, toe_in: float, *, rng: np.random.Generator) -> CameraRig:
    """Return three cameras side by side on a wall 4.5 m from the middle of the room, `apart` metres from each other."""
    side = apart * np.arange(-1, 2)
    centres = np.stack([np.full(3, -4.5), side, 1.4 + rng.uniform(-0.05, 0.05, 3)], -1)
    aims = centres + np.stack([np.ones(3), -toe_in * np.arange(-1, 2), np.full(3, -0.05)], -1)
    return _looking(centres, aims, 1100.0, rng.uniform(-0.1, 0.1, 3))


def _looking(centres: np.ndarray, aims: np.ndarray, focal: float, roll: np.ndarray) -> CameraRig:
    """Return pinhole cameras at centres (V, 3) that look at aims (V, 3), m, rolled about their axes, rad."""
    views = len(centres)
    forward = (aims - centres) / np.linalg.norm(aims - centres, axis=-1, keepdims=True)
    right = np.cross(forward, (0, 0, 1.0))
    right /= np.linalg.norm(right, axis=-1, keepdims=True)
    R = Rotation.from_rotvec(roll[:, None] * (0, 0, 1)).as_matrix() @ np.stack(
        [right, np.cross(forward, right), forward], 1
    )
    cam_from_world = np.tile(np.eye(4), (views, 1, 1))
    cam_from_world[:, :3, :3], cam_from_world[:, :3, 3] = R, -(R @ centres[..., None])[..., 0]
    K = np.tile([[focal, 0, _CENTRE[0]], [0, focal, _CENTRE[1]], [0, 0, 1]], (views, 1, 1))
    return CameraRig(tuple(range(views)), K, np.zeros((views, 5)), cam_from_world, np.tile(_SIZE, (views, 1)))


def write_pack(pack: list[Case]) -> str:
    """Replace the file of the pack, and return the checksum to write into `dmae.regression.pack`."""
    arrays = {f"{case.name}/{field.name}": getattr(case, field.name) for case in pack for field in fields(Case)[1:]}
    for key in arrays:
        if key.endswith(("/xy", "/confidence")):
            arrays[key] = arrays[key].astype(np.float32)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    write_atomic(FILE, buffer.getvalue())
    return hashlib.sha256(buffer.getvalue()).hexdigest()


if __name__ == "__main__":
    print(write_pack([*seeded_cases(), *crowd_cases(load_clip(Path(sys.argv[1])))]))
