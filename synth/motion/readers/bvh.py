"""Read BVH files of any dialect, with channels in any order. Units and axes are not converted.

The format is Biovision's: Meredith and Maddock, "Motion capture file formats explained" (2001).
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from synth.motion.motion import Motion
from synth.motion.readers import ReadOptions, reader
from synth.motion.readers.recording import SkeletonRecording, check_size, malformed, number_table, numbers, read_lines
from synth.motion.retargeting import retarget_take

_CHANNELS = ("Xposition", "Yposition", "Zposition", "Xrotation", "Yrotation", "Zrotation")


@dataclass
class _Hierarchy:
    """The joints of a file, in its order; all lists have one entry per joint."""

    joints: list[str] = field(default_factory=list)
    parents: list[int] = field(default_factory=list)
    offsets: list[list[float]] = field(default_factory=list)
    channels: list[list[str]] = field(default_factory=list)


@reader("bvh", text=True)
def read_motion(path: Path, options: ReadOptions) -> Motion:
    """Biovision BVH of any known skeleton, or with motion.mapping of any other."""
    return retarget_take(read_bvh(path), options)


def read_bvh(path: Path) -> SkeletonRecording:
    """Read all frames of a BVH file, in the unit and the axes of the file.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file is malformed; the message gives the line, what was expected and what was found.
    """
    lines = read_lines(path)
    hierarchy, motion_line = _parse_hierarchy(path, lines)
    frames, frame_time, first = _parse_motion_header(path, lines, motion_line)
    filled = [i for i in range(first, len(lines)) if lines[i].strip()]
    if len(filled) != frames:
        raise malformed(path, len(lines) - 1, f"{frames} frames, as the header states", f"{len(filled)} frames")
    values = number_table(path, filled, [lines[i].split() for i in filled], sum(map(len, hierarchy.channels)))
    check_size(path, lines, frames, len(hierarchy.joints))
    places, rotations = _decode(hierarchy, values)
    offsets, root = _rigid(path, hierarchy, places, rotations[:, 0])
    joints, parents = tuple(hierarchy.joints), tuple(hierarchy.parents)
    return SkeletonRecording(path, 1 / frame_time, joints, parents, offsets, root, rotations)


def _parse_hierarchy(path: Path, lines: list[str]) -> tuple[_Hierarchy, int]:
    """Return the joints, including end sites, and the number of the line MOTION."""
    if lines[0].split() != ["HIERARCHY"]:
        raise malformed(path, 0, "HIERARCHY", lines[0])
    tree = _Hierarchy()
    stack: list[int] = []
    for number, line in enumerate(lines[1:], 1):
        match line.split():
            case []:
                pass
            case ["ROOT" | "JOINT" | "End" as kind, *name] if name:
                if (kind == "ROOT") != (not tree.joints) or (kind != "ROOT" and not stack):
                    raise malformed(path, number, "one ROOT, and all other joints within its braces", line)
                tree.parents.append(stack[-1] if stack else -1)
                tree.joints.append(" ".join(name) if kind != "End" else tree.joints[stack[-1]] + ".end")
                tree.offsets.append([0.0, 0.0, 0.0])
                tree.channels.append([])
            case ["{"] if tree.joints:
                stack.append(len(tree.joints) - 1)
            case ["}"] if stack:
                stack.pop()
            case ["OFFSET", *words] if stack:
                tree.offsets[stack[-1]] = numbers(path, number, words, 3)
            case ["CHANNELS", count, *names] if stack:
                if count != str(len(names)) or not set(names) <= set(_CHANNELS) or len(set(names)) != len(names):
                    raise malformed(path, number, f"a count and that many of {', '.join(_CHANNELS)}", line)
                tree.channels[stack[-1]] = names
            case ["MOTION"] if tree.joints and not stack:
                return tree, number
            case _:
                raise malformed(path, number, "a joint, OFFSET, CHANNELS, or MOTION after the last brace", line)
    raise malformed(path, len(lines) - 1, "MOTION before the file ends", lines[-1])


def _parse_motion_header(path: Path, lines: list[str], motion_line: int) -> tuple[int, float, int]:
    """Return the number of frames, the frame time, s, and the number of the first line of frames."""
    filled = [i for i in range(motion_line + 1, len(lines)) if lines[i].strip()][:2]
    match [lines[i].replace(":", ": ").split() for i in filled]:
        case [["Frames:", count], ["Frame", "Time:", time]]:
            (frames,) = numbers(path, filled[0], [count], 1)
            (frame_time,) = numbers(path, filled[1], [time], 1)
            if frames >= 1 and frames == int(frames) and frame_time > 0:
                return int(frames), frame_time, filled[1] + 1
    found = " / ".join(lines[i].strip() for i in filled)
    raise malformed(path, motion_line, "'Frames: <count>' and 'Frame Time: <seconds>' after MOTION", found)


def _decode(tree: _Hierarchy, values: np.ndarray) -> tuple[dict[int, np.ndarray], np.ndarray]:
    """Return the places (F, 3) of the root and of joints with position channels, and local rotations (F, J, 3, 3)."""
    # Some programs write the position of the body in one frame as the offset, and include it in the channels as well.
    offset, channels = tree.offsets[0], tree.channels[0]
    columns = [channels.index(f"{axis}position") for axis in "XYZ" if f"{axis}position" in channels]
    repeats = len(columns) == 3 and all(offset) and np.isclose(values[:, columns], offset, rtol=1e-4).all(1).any()
    places = {0: np.tile(np.zeros(3) if repeats else np.array(offset), (len(values), 1))}
    rotations = np.broadcast_to(np.eye(3), (len(values), len(tree.joints), 3, 3)).copy()
    # Joints with the same order of axes are converted together.
    same_order: dict[str, list[tuple[int, list[int]]]] = {}
    column = 0
    for joint, channels in enumerate(tree.channels):
        angles = []
        for channel in channels:
            axis = "XYZ".index(channel[0])
            if channel.endswith("position") and joint:
                # As MotionBuilder, Xsens and others write it, in place of the offset.
                place = places.setdefault(joint, np.tile(tree.offsets[joint], (len(values), 1)))
                place[:, axis] = values[:, column]
            elif channel.endswith("position"):
                places[0][:, axis] += values[:, column]
            else:
                angles.append(column)
            column += 1
        order = "".join(channel[0] for channel in channels if channel.endswith("rotation"))
        same_order.setdefault(order, []).append((joint, angles))
    same_order.pop("", None)
    for order, turned in same_order.items():
        turns = values[:, [columns for _, columns in turned]].reshape(-1, len(order))
        # Intrinsic rotations: each channel turns about an axis that the preceding channels have turned.
        matrices = Rotation.from_euler(order, turns, degrees=True).as_matrix()
        rotations[:, [joint for joint, _ in turned]] = matrices.reshape(len(values), len(turned), 3, 3)
    # Positions that are zero throughout add nothing to the offset; some programs write such channels for all joints.
    return {joint: place for joint, place in places.items() if not joint or place.any()}, rotations


_STRETCH = (
    0.02  # Of the size of the skeleton; a joint that moves this far in its parent's frame is no error of rounding
)


def _rigid(
    path: Path, tree: _Hierarchy, places: dict[int, np.ndarray], turned: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return offsets (J, 3) that are the same in all frames, and places of the root (F, 3).

    Joints with position channels hardly move in their parent's frame. One does where the root is a node on the floor
    and the hips, its only child, move above it: the root is put at the hips.

    Args:
        places: See `_decode`.
        turned: (F, 3, 3) orientation of the root.

    Raises:
        ValueError: another joint moves.
    """
    offsets, root = np.array(tree.offsets), places.pop(0)
    for joint, place in places.items():
        offsets[joint] = np.median(place, 0)
    most = _STRETCH * np.linalg.norm(offsets[1:], axis=1).sum()
    for joint, place in places.items():
        moved = np.linalg.norm(place - offsets[joint], axis=1)
        if tree.parents[joint] == 0 and tree.parents.count(0) == 1:
            root, offsets[joint] = root + (turned @ place[..., None])[..., 0], 0
        elif moved.max() > most:
            frame = int(moved.argmax())
            raise ValueError(
                f"{path}: expected bones of constant lengths, found {tree.joints[joint]!r} {moved[frame]:.3g} from its "
                f"usual place beside {tree.joints[tree.parents[joint]]!r} in frame {frame + 1}"
            )
    return offsets, root
