"""Retarget a recorded skeleton to the canonical segments, on a level floor."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from synth.motion.floor import flatten_soles, level_floor
from synth.motion.motion import Motion
from synth.motion.readers import ReadOptions, take_name
from synth.motion.readers.dialects import OWN, Dialect, at_rest, known_joints, recognise, renamed
from synth.motion.readers.recording import SkeletonRecording
from synth.motion.readers.takes import true_fps
from synth.motion.rotations import UPRIGHT, aligned
from synth.motion.soundness import correct_rate, repair
from synth.people.body import ANKLE_HEIGHT, LEG_LENGTH
from synth.people.segments import SEGMENTS

# Files have x to the left, y up and z forward. The canonical axes are x forward, y left and z up.
_CANONICAL_FROM_FILE = UPRIGHT["y"]
_UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "CMU units": 0.0254 / 0.45, "inches": 0.0254}
"""Metres per unit. Lengths in CMU's Acclaim files are inches times 0.45, as stated in their `:units`."""
_LEGS = (0.55, 1.15)
"""Least and greatest length of thigh and shin together, m, from a ten-year-old to a tall adult; only one unit fits."""
ANKLE_OF_LEG = ANKLE_HEIGHT / LEG_LENGTH
"""Height of the ankle as a fraction of the length of the leg."""
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

    Raises:
        ValueError: as `retarget` and `synth.motion.readers.dialects.renamed`.
    """
    recording = replace(
        recording,
        fps=options.fps or true_fps(take_name(recording.path), recording.fps),
        joints=renamed(recording.joints, options.mapping, known_joints(), recording.path),
    )
    motion = retarget(recording, unit=options.unit, up=options.up)
    return motion if options.fps else correct_rate(motion)


def retarget(
    recording: SkeletonRecording, *, unit: float | None = None, up: str | None = None, from_motion: bool = False
) -> Motion:
    """Retarget a recorded skeleton's motion to the canonical segments, on a level floor.

    Each segment turns with the joint that drives it, R(t) = W G(t) G_rest^-1 A. G is the orientation of the joint, and
    G_rest is its orientation in the T-pose. A rotates the canonical axes to the recorded limb in the T-pose (along the
    bone, which may be splayed or bent). W rotates the file's axes to the canonical axes. In the canonical pose the
    rotations are the identity, whatever the rest pose of the file. The x axis of an upper arm points in the direction
    in which the elbow bends, so that elbows are hinges about z and knees are hinges about y. A forearm turns about its
    length together with the hand.

    Some files begin with a synthetic T-pose. It is left out, together with the frames that blend it into the motion.

    Args:
        recording: With an unrotated root, x is left, y up and z forward, except if its joints are mapped.
        unit: Metres per unit of the recording, if its leg length does not determine the unit; see `unit_of`.
        up: Axis of its world that points up, `x`, `y` or `z`, if its skeleton does not determine the axis.
        from_motion: Whether the recording was made from a `Motion`, so that floor, soles and forearms need no repair.

    Raises:
        ValueError: an unlikely frame rate, joints of no known skeleton, bones without length, legs that fit no unit, no
            frames after the T-pose, or as `put_on_floor`.
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
    rotations = _segments(dialect, joint, positions, orientations, from_motion)
    start = dialect.blend if _is_t_pose(rotations[0]) else 0
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
    return motion if from_motion else put_on_floor(motion, ankles, recording.path, lies=up is not None)


def put_on_floor(motion: Motion, ankles: np.ndarray, path: Path, *, lies: bool = False) -> Motion:
    """Put a motion on a level floor at z = 0, lay soles near the floor flat on it, and repair frames that jump.

    The ankles determine the floor height: they stand as high above it as the ankles of an adult with the same leg
    length. The feet of the file are not used.

    Args:
        motion: Motion with z up and any floor.
        ankles: (F, 2, 3) of left and right foot in the same world, m.
        path: File that it was read from, for messages.
        lies: Whether a body that is not upright is known to belong to a lying person.

    Raises:
        ValueError: the motion is too fast for a person, or the body lies along an axis, as with axes in another order;
            or as `synth.motion.soundness.repair`.
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
    """Return the name of the unit of length and its size in metres.

    Args:
        leg: Length of thigh and shin together, mean of both legs, in the file's unit.
        path: The file, for messages.
        unit: Metres per unit; None to find the unit from `leg`.

    Raises:
        ValueError: no unit gives `leg` the length of a human leg, and `unit` is None.
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


def _segments(
    dialect: Dialect, joint: dict[str, int], positions: np.ndarray, orientations: np.ndarray, from_motion: bool
) -> np.ndarray:
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
            turns_with = f"{side}_hand" if part == "forearm" and not from_motion else segment
            forward = since_rest[turns_with] @ _FORWARD
            if part == "upper_arm":
                forearm = positions[:, joint[f"{side}_wrist"]] - positions[:, joint[f"{side}_forearm"]]
                bends = _elbow_angle(dialect, since_rest[segment], forearm @ _CANONICAL_FROM_FILE.T)
                forward = since_rest[segment] @ (np.cos(bends), 0, np.sin(bends))
            axis = (0, 0, -1) if part in ("thigh", "shin") else (0, outward, 0)
            rotations[:, SEGMENTS.index(segment)] = aligned(along, forward, axis)
    return rotations


def _elbow_angle(dialect: Dialect, arm: np.ndarray, forearm: np.ndarray) -> float:
    """Return the angle above the forward direction at which an elbow bends in the T-pose, rad.

    Args:
        dialect: Its elbow angle is used; if it has none, the median over the frames with a bent elbow.
        arm: (F, 3, 3) rotations of the upper arm since the T-pose.
        forearm: (F, 3) vectors along the forearm, in canonical axes.
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


def _is_t_pose(rotations: np.ndarray) -> bool:
    """Return whether arms point sideways and legs down, relative to the pelvis, to within 25 degrees; (16, 3, 3)."""
    turned = rotations[0].T @ rotations
    arms = turned[[SEGMENTS.index(f"{side}_{part}") for side in "lr" for part in ("upper_arm", "forearm")], 1, 1]
    legs = turned[[SEGMENTS.index(f"{side}_{part}") for side in "lr" for part in ("thigh", "shin")], 2, 2]
    return bool(min(*arms, *legs) > np.cos(np.radians(25)))
