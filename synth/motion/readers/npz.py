"""SMPL poses in npz files, as in the AMASS database, read without a body model."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.files.arrays import read_arrays
from synth.motion.geometry import UPRIGHT, aligned
from synth.motion.motion import Motion
from synth.motion.readers import ReadOptions, reader
from synth.motion.readers.recording import SkeletonRecording, fill_gaps
from synth.motion.readers.takes import true_fps
from synth.motion.retargeting import check_rate, retarget

_COLUMNS = {66: "22 joints", 72: "SMPL", 156: "SMPL-H", 165: "SMPL-X"}
_RATES = ("mocap_framerate", "mocap_frame_rate", "framerate", "frame_rate", "fps")
_MOST_TURNED = 20.0
"""Greatest angle, rad. Larger angles are in another unit: even a spinning person stays within a few turns."""
_FARTHEST = 30.0
"""Greatest distance of a person from the origin, m; larger numbers are in another unit."""
_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inches": 0.0254}


@reader("npz")
def read_motion(path: Path, options: ReadOptions) -> Motion:
    """AMASS-style npz of SMPL, SMPL-H or SMPL-X poses; no body model needed.

    It uses the arrays `poses`, (F, 66, 72, 156 or 165) rotations of SMPL's joints as axis times angle; `trans`, (F, 3)
    m, z up; and the frame rate, `mocap_framerate` or its names in SMPL-X's files. `betas` gives the size of the person
    only together with the body model. The size is found from the feet instead: they do not slide if the mean body has
    the right size. Gaps (NaN) of up to 0.25 s are interpolated; the name of the motion lists them.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file is no npz file, contains pickled objects, lacks arrays, has arrays of other shapes,
            contradicts itself or has no values for most of the time; or as `synth.motion.retargeting.retarget`.
    """
    if options.mapping:
        raise ValueError(f"{path}: motion.mapping names joints, but npz files have them by number, not by name")
    content = read_arrays(path, "an npz file of arrays", ("poses", "trans"), (*_RATES, "mocap_time_length"))
    poses, places = _shaped(content, path)
    rate = _rate(content, len(poses), options.fps, path)
    poses, places, notes = _fill(poses, places, rate, path)
    turn = UPRIGHT["y"].T @ UPRIGHT[options.up or "z"]
    local = Rotation.from_rotvec(poses.reshape(-1, 3)).as_matrix().reshape(len(poses), BODY, 3, 3)
    hands = np.broadcast_to(np.eye(3), (len(poses), len(JOINTS) - BODY, 3, 3))
    recording = SkeletonRecording(
        path=path,
        fps=rate,
        joints=JOINTS,
        parents=PARENTS,
        offsets=OFFSETS,
        root=np.zeros((len(poses), 3)),
        rotations=np.concatenate([local, hands], axis=1),
    ).turned(turn)
    feet = recording.forward()[0][:, [JOINTS.index("left_foot"), JOINTS.index("right_foot")]]
    name, metres = _unit_of(places @ turn.T, feet, options.unit, path)
    places = places * metres
    size = _size(places @ turn.T, feet, rate)
    whole = replace(
        recording,
        offsets=OFFSETS * size,
        root=(places + OFFSETS[0] * size) @ turn.T,
        notes=(f"size {size:.2f}", *((f"trans in {name}",) if metres != 1 else ()), *notes),
    )
    return retarget(whole, up="y" if options.up else None)


def _shaped(content: dict[str, np.ndarray], path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Return axis-angle vectors of the body (F, 22, 3) and positions (F, 3); some values may not be finite."""
    for name in ("poses", "trans"):
        if not (np.issubdtype(content[name].dtype, np.number) and np.isrealobj(content[name])):
            raise ValueError(f"{path}: expected numbers in {name}, found {content[name].dtype}")
    poses, places = (np.asarray(content[name], np.float64) for name in ("poses", "trans"))
    columns = int(np.prod(poses.shape[1:])) if poses.ndim in (2, 3) else 0
    if columns not in _COLUMNS or places.shape != (len(poses), 3) or not len(poses):
        raise ValueError(
            f"{path}: expected poses of (F, {', '.join(f'{count} for {model}' for count, model in _COLUMNS.items())}) "
            f"and trans of (F, 3), found {poses.shape} and {places.shape}"
        )
    poses = poses.reshape(len(poses), -1, 3)[:, :BODY]
    angle = np.abs(np.where(np.isfinite(poses), poses, 0)).max()
    if angle > _MOST_TURNED:
        raise ValueError(f"{path}: expected poses as axis times angle in radians, found an angle of {angle:.4g}")
    # A position that is too far away in any unit counts as missing.
    return poses, np.where(np.abs(places) < 1e6, places, np.nan)


def _rate(content: dict[str, np.ndarray], frames: int, fps: float | None, path: Path) -> float:
    if fps:
        return fps
    stated = {name: content[name] for name in (*_RATES, "mocap_time_length") if name in content}
    try:
        values = {name: float(value.item()) for name, value in stated.items()}
    except (ValueError, TypeError):
        raise ValueError(f"{path}: expected one number each as {', '.join(stated)}") from None
    seconds = values.pop("mocap_time_length", None)
    rates = set(values.values())
    if len(rates) != 1 or not 0 < min(rates) < np.inf:
        found = ", ".join(f"{name} {value:g}" for name, value in values.items()) or "none"
        raise ValueError(f"{path}: expected one frame rate as {_RATES[0]}, found {found}; give motion.fps=<rate>")
    rate = true_fps(path.stem, rates.pop())
    check_rate(rate, path)
    if seconds is not None and abs(frames / rate - seconds) > max(0.05 * seconds, 2 / rate):
        raise ValueError(
            f"{path}: {frames} frames at {rate:g} a second last {frames / rate:.4g} s, but mocap_time_length says "
            f"{seconds:.4g} s; give motion.fps=<the right rate>"
        )
    return rate


def _fill(
    poses: np.ndarray, places: np.ndarray, fps: float, path: Path
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Return poses and positions without NaN, and notes on how they were filled."""
    if np.isfinite(poses).all() and np.isfinite(places).all():
        return poses, places, ()
    lost = ~np.isfinite(poses).all(2)
    matrices = Rotation.from_rotvec(np.where(lost[..., None], 0, poses).reshape(-1, 3)).as_matrix()
    # Columns of rotation matrices can be interpolated; axis-angle vectors jump by full turns.
    columns = np.where(lost[..., None], np.nan, matrices[..., :2].reshape(len(poses), BODY, 6))
    values = np.concatenate([columns, np.tile(places, 2)[:, None]], axis=1)
    values, notes = fill_gaps(values, [*JOINTS[:BODY], "trans"], fps, path)
    first, second = np.moveaxis(values[:, :BODY].reshape(-1, 3, 2), 2, 0)
    # Orthogonalise, keeping the second column.
    turned = aligned(second, first, (0, 1, 0))
    return Rotation.from_matrix(turned).as_rotvec().reshape(-1, BODY, 3), values[:, BODY, :3], notes


def _unit_of(places: np.ndarray, feet: np.ndarray, unit: float | None, path: Path) -> tuple[str, float]:
    """Return name and size, m, of the unit of `trans`, in which hips are as high above the floor as above the feet.

    `places` are (F, 3) as stated, `feet` (F, 2, 3) relative to the pelvis, m, y up.
    """
    if unit:
        return f"units of {unit:.4g} m", unit
    high, legs = np.percentile(places[:, 1], 90), np.percentile(-feet[..., 1].min(1), 90)
    for name, metres in _UNITS.items():
        if 0.63 < high * metres / legs < 1.58:
            return name, metres
    if np.abs(places).max() > _FARTHEST:
        raise ValueError(
            f"{path}: expected hips some {legs:.2g} m high in trans, found {high:.4g}, which fits none of "
            f"{', '.join(_UNITS)}; give motion.unit=<metres a unit>, or motion.up=<axis> if it is not z that is up"
        )
    return "m", 1.0


def _size(places: np.ndarray, feet: np.ndarray, fps: float) -> float:
    """Return the size of the person relative to the template, 0.8 to 1.25, with which the lower foot stands still.

    Velocities v of the hips, and r of the ball of a foot relative to them on the template, satisfy v + s r = 0 for the
    right size s: least squares over frames in which the hips move faster than 0.4 m/s. Frames without a standing foot
    have a low weight (Cauchy, 0.1 m/s), every tenth of a second is one measurement, and the prior is 1 +- 6 %.
    """
    lower = feet[:-1, :, 1].argmin(1)
    hips = np.diff(places, axis=0) * fps
    foot = np.diff(feet, axis=0)[np.arange(len(hips)), lower] * fps
    walks = np.linalg.norm(hips, axis=1) > 0.4
    hips, foot = hips[walks], foot[walks]
    size = 1.0
    for _ in range(10):
        weight = 1 / (1 + ((hips + size * foot) ** 2).sum(1) / 0.1**2) / (0.1 * fps * 0.1**2)
        pull = (weight[:, None] * foot**2).sum() + 0.06**-2
        size = (0.06**-2 - (weight[:, None] * foot * hips).sum()) / pull
    return float(np.clip(size, 0.8, 1.25))


# Joint, parent, and rest position in the parent, m: x left, y up, z forward. The mean body of SMPL (Loper et al., ACM
# Transactions on Graphics 34, 2015), as published with simulated humanoids; SMPL-H and SMPL-X share order and pose.
_TEMPLATE = """pelvis - -0.0018 -0.2233 0.0282
left_hip pelvis 0.0695 -0.0914 -0.0068
right_hip pelvis -0.0677 -0.0905 -0.0043
spine1 pelvis -0.0025 0.1090 -0.0267
left_knee left_hip 0.0343 -0.3752 -0.0045
right_knee right_hip -0.0383 -0.3826 -0.0089
spine2 spine1 0.0055 0.1352 0.0011
left_ankle left_knee -0.0136 -0.3980 -0.0437
right_ankle right_knee 0.0158 -0.3984 -0.0423
spine3 spine2 0.0015 0.0529 0.0254
left_foot left_ankle 0.0264 -0.0558 0.1193
right_foot right_ankle -0.0254 -0.0481 0.1233
neck spine3 -0.0028 0.2139 -0.0429
left_collar spine3 0.0788 0.1217 -0.0341
right_collar spine3 -0.0818 0.1188 -0.0386
head neck 0.0052 0.0650 0.0513
left_shoulder left_collar 0.0910 0.0305 -0.0089
right_shoulder right_collar -0.0960 0.0326 -0.0091
left_elbow left_shoulder 0.2596 -0.0128 -0.0275
right_elbow right_shoulder -0.2537 -0.0133 -0.0214
left_wrist left_elbow 0.2492 0.0090 -0.0012
right_wrist right_elbow -0.2553 0.0078 -0.0056
left_hand left_wrist 0.0840 -0.0082 -0.0149
right_hand right_wrist -0.0846 -0.0061 -0.0103"""
_ROWS = [row.split() for row in _TEMPLATE.splitlines()]
JOINTS = tuple(row[0] for row in _ROWS)
"""Joints in SMPL's order. The last two are at the knuckles, where SMPL-H and SMPL-X have fingers."""
PARENTS = (-1, *(JOINTS.index(row[1]) for row in _ROWS[1:]))
OFFSETS = np.array([row[2:] for row in _ROWS], np.float64)
"""(24, 3) position of each joint in its parent, m; for the pelvis, relative to the point that `trans` moves."""
BODY = 22
"""Number of joints before the joints of the hands."""
