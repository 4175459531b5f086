"""Turn a recorded skeleton into a motion: level the floor, repair jumps, retarget to the canonical segments."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import median_filter
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from synth.motion.feet import sole_points
from synth.motion.geometry import UPRIGHT, about, aligned, slerp
from synth.motion.motion import Motion
from synth.motion.readers import ReadOptions, take_name
from synth.motion.readers.dialects import OWN, Dialect, at_rest, known_joints, recognise, renamed
from synth.motion.readers.recording import SkeletonRecording, runs
from synth.motion.readers.takes import true_fps
from synth.people.body import ANKLE_HEIGHT, LEG_LENGTH, SEGMENTS, Body, segment_origins

_STANDING_SPEED = 0.15
"""Greatest speed of the ankle of a standing foot, m/s."""
_STANDING_TIME = 0.1
"""Least time for which a foot stands to show where the floor is, s."""
_LEVEL = 0.12
"""Greatest height of standing feet over the lowest standing feet that the tilt and noise of a floor explain, m; feet
above this height stand on something else."""
_LOWEST = 0.05
"""Least share of the standing feet that form the lowest level, and at least two feet; fewer are recording errors."""


def level_floor(ankles: np.ndarray, fps: float, ankle_height: float) -> tuple[np.ndarray, float]:
    """Fit the floor of a recording from ankles (F, 2, 3), m, z roughly up: a rotation (3, 3) that levels it, and the
    height to subtract afterwards, m.

    By errors of calibration, recorded floors are up to 7 cm away from zero height and tilt by up to 2 cm per metre. The
    floor is fitted robustly as the plane at `ankle_height` below the standing ankles: in place for at least 0.1 s and
    at most 5 cm above the lower ankle. Only the lowest level counts: higher feet are on steps, platforms or bars. A
    prior of one degree limits the tilt, which a person who stays on one spot does not show.
    """
    speed = np.linalg.norm(np.gradient(ankles, 1 / fps, axis=0), axis=2) if len(ankles) > 1 else np.zeros((1, 2))
    standing = (speed < _STANDING_SPEED) & (ankles[..., 2] < ankles[..., 2].min(1, keepdims=True) + 0.05)
    medians = []
    for foot in range(2):
        for first, last in runs(standing[:, foot]):
            if last - first >= _STANDING_TIME * fps:
                medians.append(np.median(ankles[first:last, foot], axis=0))
    if not medians:
        return np.eye(3), float(np.percentile(ankles[..., 2].min(1), 5)) - ankle_height
    spots = np.array(medians)
    # The lowest level is the lowest that enough ankles share; the lowest ankle alone if no two share one.
    ordered = np.sort(spots[:, 2])
    enough = min(max(2, _LOWEST * len(ordered)), len(ordered))
    shared = np.searchsorted(ordered, ordered + _LEVEL, side="right") - np.arange(len(ordered)) >= enough
    lowest = ordered[shared.argmax()] if shared.any() else ordered[0]
    spots = spots[(spots[:, 2] >= lowest) & (spots[:, 2] <= lowest + _LEVEL)]
    centre = spots.mean(0)

    def residuals(plane: np.ndarray) -> np.ndarray:
        misses = spots[:, 2] - plane[0] - (spots - centre)[:, :2] @ plane[1:]
        # Each residual is in units of its expected size: 1 cm or 1 degree.
        return np.concatenate([misses / 0.01, plane[1:] / np.radians(1)])

    height, *slope = least_squares(residuals, (np.median(spots[:, 2]), 0, 0), loss="soft_l1").x
    level = Rotation.align_vectors([(0, 0, 1)], [(-slope[0], -slope[1], 1)])[0].as_matrix()
    return level, float((level @ (*centre[:2], height))[2]) - ankle_height


def flatten_soles(feet: np.ndarray, heights: np.ndarray, ankle_height: float) -> np.ndarray:
    """Return feet (F, 3, 3) turned about their length so that soles near the floor lie flat; `heights` (F,) of ankles.

    The ankles of CMU's skeletons cannot tilt sideways, so soles lean with the shins, by 35 degrees in a wide stance. A
    sole is fully levelled if its ankle is at most 2 cm above the height of a standing ankle. The correction fades out
    up to 12 cm.
    """
    lean = np.arctan2(feet[:, 2, 1], feet[:, 2, 2])
    # The sideways lean is undefined for a foot that stands on its toes.
    share = np.hypot(feet[:, 2, 1], feet[:, 2, 2]) * np.clip((ankle_height + 0.12 - heights) / 0.10, 0, 1)
    return feet @ about("x", -share * np.clip(lean, -np.radians(35), np.radians(35)))


# Repair: bridge or cut frames in which joints jump, and halve rates that contradict gravity

_JUMP, _ACCELERATION = 0.15, 400.0
"""A joint jumps if its step from one frame to the next differs from the median of the steps around it by more than
this distance, m, and by more than this acceleration explains, m/s^2; feet reach about 300 in kicks."""
_LONGEST = 0.25
"""Longest fault that is bridged, s, as for gaps of recordings."""
_FASTEST_BRIDGED = 8.0
"""Greatest mean speed of a joint over a bridge, m/s; people do not move faster."""
_FROZEN = 1e-6
"""Greatest change between frozen frames, m or per element of a rotation matrix; camera noise is larger."""
_SHORTEST = 1.0
"""Least length of the part of a take that is left after cutting, s."""
_JOINTS = [
    SEGMENTS.index(name) for name in ("pelvis", "head", *(f"{s}_{n}" for s in "lr" for n in ("hand", "shin", "foot")))
]
_GRAVITY = 9.81
"""m/s^2."""
_STATED = (119.0, 121.0)
"""Range around 120 frames/s, the rate that conversions often state, even if the true rate is another."""
_FLIGHT = 0.2
"""Least length of a flight at the stated rate, s."""
_CLEAR = 0.06
"""Height of the soles above which feet are off the floor, m."""
_HALF = (2.8, 5.7)
"""Range of accelerations of a fall, in units of gravity, that shows that the true rate is half the stated rate: the
stated rate makes them four times as large. At true rates they were 0.8 to 1.2 in flights, and below 0.2 for people on
platforms and bars."""
_ODD = 0.1
"""Greatest standard deviation of a flight from a parabola, as a share of the height that it spans."""


def repair(motion: Motion, path: Path) -> Motion:
    """Return a take without frames in which joints jump.

    A fault is one jump, or several jumps less than 0.25 s apart, together with the adjacent frozen frames. A fault of
    up to 0.25 s is bridged by slerp and straight lines, if people can move that fast. Other faults are cut out, and the
    longest stretch between them is returned. The name lists the changes; `first` is the new first frame. A single step
    at no more than 8 m/s is not changed.

    Raises ValueError if a take of more than one second has less than one second left.
    """
    if len(motion) < 3:
        return motion
    body = Body(1.70)
    joints = segment_origins(body, motion.root * body.hip_height / motion.hip_height, motion.rotations)[:, _JOINTS]
    faults = _faults(motion, joints)
    if not faults:
        return motion
    root, rotations = motion.root.copy(), motion.rotations.copy()
    cuts, bridged = [], 0
    for before, after in faults:
        inside = slice(before + 1, after)
        speed = np.linalg.norm(joints[after] - joints[before], axis=1).max() * motion.fps / (after - before)
        if after - before - 1 > _LONGEST * motion.fps or speed > _FASTEST_BRIDGED:
            cuts.append((before, after))
        elif after - before > 1:
            share = np.arange(1, after - before) / (after - before)
            root[inside] = root[before] + share[:, None] * (root[after] - root[before])
            rotations[inside] = slerp(rotations[before], rotations[after], share)
            bridged += after - before - 1
    starts, ends = [0, *(after for _, after in cuts)], [*(before + 1 for before, _ in cuts), len(motion)]
    first, end = max(zip(starts, ends, strict=True), key=lambda run: run[1] - run[0])
    if end - first < min(_SHORTEST * motion.fps, len(motion)):
        raise ValueError(
            f"{path}: joints jump {len(cuts)} times, first from frame {cuts[0][0] + 1} to {cuts[0][1] + 1}, so that at "
            f"most {(end - first) / motion.fps:.2g} s are valid; expected at least {_SHORTEST:g} s, repair the take"
        )
    if not (bridged or cuts):
        return motion
    notes = [f"{bridged} frames bridged"] if bridged else []
    if end - first < len(motion):
        notes.append(f"frames {first + 1}-{end} of {len(motion)}")
    name = f"{motion.name}, {', '.join(notes)}"
    return replace(motion, name=name, root=root[first:end], rotations=rotations[first:end], first=motion.first + first)


def _faults(motion: Motion, joints: np.ndarray) -> list[tuple[int, int]]:
    """Return the last frame before and the first frame after each fault; `joints` is (F, K, 3) m."""
    steps = np.diff(joints, axis=0)
    odd = np.linalg.norm(steps - median_filter(steps, (5, 1, 1), mode="nearest"), axis=2).max(1)
    jumps = np.flatnonzero(odd > max(_JUMP, _ACCELERATION / motion.fps**2))
    frozen = (np.abs(np.diff(motion.root, axis=0)).max(1) < _FROZEN) & (
        np.abs(np.diff(motion.rotations, axis=0)).max((1, 2, 3)) < _FROZEN
    )
    faults: list[tuple[int, int]] = []
    for jump in jumps:
        before, after = int(jump), int(jump) + 1
        while before > 0 and frozen[before - 1]:
            before -= 1
        while after < len(frozen) and frozen[after]:
            after += 1
        if faults and before - faults[-1][1] < _LONGEST * motion.fps:
            before, end = faults.pop()
            after = max(after, end)
        faults.append((before, after))
    return faults


def correct_rate(motion: Motion) -> Motion:
    """Return a motion at half its rate if the stated rate is 120 and people in the air would fall too fast at it."""
    if not _STATED[0] < motion.fps < _STATED[1]:
        return motion
    falls = _falls(motion)
    if not falls or not _HALF[0] < np.median(falls) < _HALF[1]:
        return motion
    note = f"at {motion.fps / 2:.4g}, as it falls with {np.median(falls):.2g} g at {motion.fps:.4g}"
    return replace(motion, fps=motion.fps / 2, name=f"{motion.name}, {note}")


def _falls(motion: Motion) -> list[float]:
    """Return the downward acceleration of the body (segment origins weighted by mass) in each flight, in g."""
    body = Body(1.70)
    root = motion.root * body.hip_height / motion.hip_height
    origins = segment_origins(body, root, motion.rotations)
    height = (origins[..., 2] @ body.masses) / body.masses.sum()
    above = sole_points(body, root, motion.rotations)[..., 2].min((1, 2)) > _CLEAR
    found = []
    for first, end in runs(above):
        if end - first < _FLIGHT * motion.fps:
            continue
        time = np.arange(end - first) / motion.fps
        parabola = np.polynomial.Polynomial.fit(time, height[first:end], 2).convert().coef
        left = height[first:end] - np.polynomial.polynomial.polyval(time, parabola)
        if left.std() < _ODD * np.ptp(height[first:end]):
            found.append(-2 * parabola[2] / _GRAVITY)
    return found


# Retargeting

# Files have x to the left, y up and z forward. The canonical axes are x forward, y left and z up.
_CANONICAL_FROM_FILE = UPRIGHT["y"]
_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "CMU units": 0.0254 / 0.45, "inches": 0.0254}
"""Metres per unit. Lengths in CMU's Acclaim files are inches times 0.45, as stated in their `:units`."""
_LEGS = (0.55, 1.15)
"""Least and greatest length of thigh and shin together, m, from a ten-year-old to a tall adult; only one unit fits."""
ANKLE_OF_LEG = ANKLE_HEIGHT / LEG_LENGTH
"""Height of the ankle, as a fraction of leg length."""
_FORWARD = np.array((1.0, 0, 0))
_RATES = (5.0, 1000.0)
"""Least and greatest frame rate of recordings, frames per second."""
_FASTEST = 12.5
"""Greatest speed of a runner, m/s: in Usain Bolt's record of 2009 the fastest 10 m took 0.81 s."""
_LIMBS = {"upper_arm": "forearm", "forearm": "wrist", "hand": "knuckle", "thigh": "shin", "shin": "foot"}
"""For each limb segment, the joint at its end."""


def retarget_take(recording: SkeletonRecording, options: ReadOptions) -> Motion:
    """Retarget a recording with the rate, the joint names, the unit and the axes of the user's options.

    If the options have no rate, the stated rate is corrected: from known facts about the take, or from the speed of
    falls in it.
    """
    recording = replace(
        recording,
        fps=options.fps or true_fps(take_name(recording.path), recording.fps),
        joints=renamed(recording.joints, options.mapping, known_joints(), recording.path),
    )
    motion = retarget(recording, unit=options.unit, up=options.up)
    return motion if options.fps else correct_rate(motion)


def retarget(recording: SkeletonRecording, *, unit: float | None = None, up: str | None = None) -> Motion:
    """Retarget a recorded skeleton's motion to the canonical segments, on a level floor.

    Each segment turns with the joint that drives it, R(t) = W G(t) G_rest^-1 A. G is the orientation of the joint, and
    G_rest is its orientation in the T-pose. A rotates the canonical axes to the recorded limb in the T-pose (along the
    bone, which may be splayed or bent). W rotates the file's axes to the canonical axes. In the canonical pose the
    rotations are the identity, whatever the rest pose of the file. The x axis of an upper arm points in the direction
    in which the elbow bends, so that elbows are hinges about z and knees are hinges about y. A forearm turns about its
    length together with the hand.

    Some files begin with a synthetic T-pose. It is left out, together with the frames that blend it into the motion.

    Raises ValueError for an unlikely frame rate, joints of no known skeleton, bones without length, legs that fit no
    unit, no frames after the T-pose, or as `put_on_floor`.

    Args:
        recording: With an unrotated root, x is left, y up and z forward, except if its joints are mapped.
        unit: Metres per unit of the recording, if its leg length does not determine the unit; see `unit_of`.
        up: Axis of its world that points up, `x`, `y` or `z`, if its skeleton does not determine the axis.
    """
    check_rate(recording.fps, recording.path)
    dialect, joint = recognise(recording)
    axes = np.eye(3)
    if dialect is OWN:
        recording, dialect, axes = at_rest(recording, joint)
    if up:
        turn = Rotation.align_vectors([(0, 1, 0)], [axes[:, "xyz".index(up)]])[0]
        recording = recording.turned(turn.as_matrix())
    positions, orientations = recording.forward()
    lengths = _limb_lengths(recording, positions, joint)
    leg = sum(lengths[f"{side}_{part}"] for side in "lr" for part in ("thigh", "shin")) / 2
    name, metres = unit_of(leg, recording.path, unit)
    rotations = _segments(dialect, joint, positions, orientations)
    # In a T-pose arms point sideways and legs down, relative to the pelvis, to within 25 degrees.
    first = rotations[0, 0].T @ rotations[0]
    arms, legs = ([SEGMENTS.index(f"{side}_{part}") for side in "lr" for part in parts]
                  for parts in (("upper_arm", "forearm"), ("thigh", "shin")))  # fmt: skip
    in_t_pose = min(*first[arms, 1, 1], *first[legs, 2, 2]) > np.cos(np.radians(25))
    start = dialect.blend if in_t_pose else 0
    if len(recording) <= start:
        raise ValueError(f"{recording.path}: expected frames after the T-pose it begins with, found none")
    positions = positions[start:] @ _CANONICAL_FROM_FILE.T * metres
    hips, ankles = (positions[:, [joint[f"l_{part}"], joint[f"r_{part}"]]] for part in ("thigh", "foot"))
    about = ", ".join((dialect.name, name, f"{recording.fps:.4g} fps", *recording.notes))
    motion = Motion(
        name=f"{take_name(recording.path)} ({about})",
        fps=recording.fps,
        root=hips.mean(1),
        rotations=rotations[start:],
        hip_height=(1 + ANKLE_OF_LEG) * leg * metres,
    )
    return put_on_floor(motion, ankles, recording.path, lies=up is not None)


def put_on_floor(motion: Motion, ankles: np.ndarray, path: Path, *, lies: bool = False) -> Motion:
    """Put a motion on a level floor at z = 0, lay soles near the floor flat on it, and repair frames that jump.

    The ankles (F, 2, 3), m, in the world of the motion, determine the floor height: they stand as high above it as the
    ankles of an adult with the same leg length. The feet of the file are not used. `lies`: people are known to lie.

    Raises ValueError if the motion is too fast for a person, or the body lies along an axis, as with axes in another
    order; or as `repair`.
    """
    _check_axes(motion, path, lies)
    _check_speed(motion, path)
    ankle_height = motion.hip_height * ANKLE_OF_LEG / (1 + ANKLE_OF_LEG)
    turn, height = level_floor(ankles, motion.fps, ankle_height)
    rotations = turn @ motion.rotations
    for foot, ankle in zip(("l_foot", "r_foot"), (ankles @ turn.T).swapaxes(0, 1), strict=True):
        segment = SEGMENTS.index(foot)
        rotations[:, segment] = flatten_soles(rotations[:, segment], ankle[:, 2] - height, ankle_height)
    return repair(replace(motion, root=motion.root @ turn.T - (0, 0, height), rotations=rotations), path)


def check_rate(fps: float, path: Path) -> None:
    """Raise ValueError if a frame rate is implausible for recordings of people."""
    if not _RATES[0] <= fps <= _RATES[1]:
        raise ValueError(
            f"{path}: expected {_RATES[0]:g} to {_RATES[1]:g} frames a second, found {fps:.4g}; give motion.fps=<rate>"
        )


def unit_of(leg: float, path: Path, unit: float | None) -> tuple[str, float]:
    """Return the name of the unit of length and its size in metres, from the mean length of thigh and shin together.

    Raises ValueError if no unit gives `leg` the length of a human leg, and `unit` is None.
    """
    if unit:
        return f"units of {unit:.4g} m", unit
    for name, metres in _UNITS.items():
        if _LEGS[0] < leg * metres < _LEGS[1]:
            return name, metres
    raise ValueError(
        f"{path}: expected thigh and shin of {_LEGS[0]} to {_LEGS[1]} m together, found {leg:.4g} units, "
        f"which is not the length of a human leg in any of {', '.join(_UNITS)}; if it is correct, give "
        "motion.unit=<metres per unit>"
    )


def _limb_lengths(recording: SkeletonRecording, positions: np.ndarray, joint: dict[str, int]) -> dict[str, float]:
    """Return the length of each limb segment, in the file's unit. Raise ValueError if one has no length."""
    lengths = {}
    for start, end in ((f"{side}_{part}", f"{side}_{end}") for side in "lr" for part, end in _LIMBS.items()):
        if end not in joint:
            continue
        lengths[start] = float(np.median(np.linalg.norm(positions[:, joint[end]] - positions[:, joint[start]], axis=1)))
    short = [part for part, length in lengths.items() if not length > 0.02 * max(lengths.values())]
    if short:
        raise ValueError(
            f"{recording.path}: expected bones of some length, found none between "
            + ", ".join(f"{recording.joints[joint[part]]!r} and where {part} ends" for part in short)
        )
    return lengths


def _segments(dialect: Dialect, joint: dict[str, int], positions: np.ndarray, orientations: np.ndarray) -> np.ndarray:
    """Return the orientations (F, 16, 3, 3) of the canonical segments, before the floor is levelled."""
    # W G(t) G_rest^-1 W^-1: the rotation since the T-pose, in canonical axes.
    since_rest = {
        part: _CANONICAL_FROM_FILE @ orientations[:, joint[part]] @ dialect.rest_of(part).T @ _CANONICAL_FROM_FILE.T
        for part in SEGMENTS
    }
    rotations = np.stack(list(since_rest.values()), axis=1)
    for side, outward in (("l", 1.0), ("r", -1.0)):
        for part, end in _LIMBS.items():
            segment = f"{side}_{part}"
            if f"{side}_{end}" not in joint:
                continue
            along = (positions[:, joint[f"{side}_{end}"]] - positions[:, joint[segment]]) @ _CANONICAL_FROM_FILE.T
            turns_with = f"{side}_hand" if part == "forearm" else segment
            forward = since_rest[turns_with] @ _FORWARD
            if part == "upper_arm":
                forearm = positions[:, joint[f"{side}_wrist"]] - positions[:, joint[f"{side}_forearm"]]
                bends = _elbow_angle(dialect, since_rest[segment], forearm @ _CANONICAL_FROM_FILE.T)
                forward = since_rest[segment] @ (np.cos(bends), 0, np.sin(bends))
            axis = (0, 0, -1) if part in ("thigh", "shin") else (0, outward, 0)
            rotations[:, SEGMENTS.index(segment)] = aligned(along, forward, axis)
    return rotations


def _elbow_angle(dialect: Dialect, arm: np.ndarray, forearm: np.ndarray) -> float:
    """Return the angle above forward at which an elbow bends in the T-pose, rad: the dialect's, or the median over
    frames.

    `arm` (F, 3, 3) turns since the T-pose, `forearm` (F, 3) in canonical axes.
    """
    if dialect.elbow is not None:
        return np.radians(dialect.elbow)
    forward, _, up = (arm.swapaxes(-1, -2) @ forearm[..., None])[..., 0].T
    bent = np.hypot(forward, up) > 0.3 * np.linalg.norm(forearm, axis=1)
    return float(np.median(np.arctan2(up, forward)[bent])) if bent.any() else 0.0


def _check_speed(motion: Motion, path: Path) -> None:
    """Raise ValueError if the hips move faster than a runner over a tenth of a second."""
    step = min(max(1, round(0.1 * motion.fps)), len(motion) - 1)
    if step < 1:
        return
    speed = np.linalg.norm(motion.root[step:] - motion.root[:-step], axis=1) * motion.fps / step
    fastest = int(speed.argmax())
    if not speed[fastest] < _FASTEST:
        raise ValueError(
            f"{path}: expected people at no more than {_FASTEST} m/s, found {speed[fastest]:.3g} m/s in frames "
            f"{fastest + 1} to {fastest + step + 1} (mean {speed.mean():.3g}) at {motion.fps:.4g} a second: rate or "
            "unit are wrong, see motion.fps and motion.unit, or the take is broken there"
        )


def _check_axes(motion: Motion, path: Path, lies: bool) -> None:
    """Raise ValueError if the body is rarely upright but mostly along another axis, unless it is known to lie."""
    chest = motion.rotations[:, SEGMENTS.index("chest"), :, 2]
    along = (np.abs(chest) > np.cos(np.radians(40))).mean(0)
    if not lies and (chest[:, 2] > 0.3).mean() < 0.2 and along.max() > 0.8:
        axis = "-+"[int(np.median(chest[:, along.argmax()]) > 0)] + "xyz"[along.argmax()]
        raise ValueError(
            f"{path}: expected a body upright, found its chest along {axis} (x forward, y left, z up as it was read) "
            f"in {100 * along.max():.0f} % of the frames: give motion.up=<the axis that points up in the file>, "
            "or, where people do lie, the axis that was assumed"
        )
