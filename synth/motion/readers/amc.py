"""Read Acclaim skeletons (ASF) and motions (AMC), as in the CMU motion capture database."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from synth.motion.motion import Motion
from synth.motion.readers import ReadOptions, reader, take_name
from synth.motion.readers.recording import (
    SkeletonRecording,
    check_size,
    find_text,
    malformed,
    number_table,
    numbers,
    read_lines,
)
from synth.motion.retargeting import retarget_take

_FPS = 120.0
"""Frame rate of AMC files, which do not state it: the cameras at CMU ran at 120 Hz."""


@dataclass
class Bone:
    """A bone of an Acclaim skeleton; it starts where its parent ends."""

    parent: str  # Name of the parent bone; empty for the root
    end: np.ndarray  # (3,) from the bone's start to its end in the rest pose, in the file's unit
    axis: Rotation  # Rest orientation C of the frame in which the angles of the bone are given
    order: str  # Axes in the order in which they turn, `xyz` for Rz Ry Rx
    dof: tuple[str, ...] = ()  # Channels among tx ty tz rx ry rz, in the order in which an AMC file lists them


@reader("amc", text=True)
def read_motion(path: Path, options: ReadOptions) -> Motion:
    """Acclaim AMC, <subject>_<trial>.amc; the skeleton <subject>.asf is in the same folder."""
    return retarget_take(read_amc(path), options)


def read_amc(path: Path) -> SkeletonRecording:
    """Read the file `<subject>_<trial>.amc` with the skeleton `<subject>.asf` in its folder.

    The local rotation of a bone is C Rz Ry Rx C^-1, with its axis C in the rest pose (Lander, "Working with motion
    capture file formats", Game Developer, January 1998). Joints have the names of their bones and are at the start of
    these.

    Raises:
        FileNotFoundError: there is no such file, or no skeleton in its folder.
        ValueError: a file is malformed; the message gives the line, what was expected and what was found.
    """
    lines = read_lines(path)
    wanted = path.with_name(take_name(path).rpartition("_")[0] + ".asf")
    skeleton = find_text(wanted)
    if skeleton is None:
        there = sorted(other.name for other in path.parent.glob("*.asf*"))
        raise FileNotFoundError(f"{path}: expected its skeleton at {wanted}, found {there or 'no .asf file'}")
    bones = read_asf(skeleton)
    values = _parse_frames(path, lines, bones)
    names = tuple(bones)
    root = np.tile(bones["root"].end, (len(values["root"]), 1))
    check_size(path, lines, len(root), len(names))
    rotations = np.broadcast_to(np.eye(3), (len(root), len(names), 3, 3)).copy()
    for joint, (name, bone) in enumerate(bones.items()):
        angles = np.zeros((len(root), 3))
        for channel, column in zip(bone.dof, values[name].T, strict=True):
            if channel[0] == "t":
                root[:, "xyz".index(channel[1])] += column
            else:
                angles[:, bone.order.index(channel[1])] = column
        turned = Rotation.from_euler(bone.order, angles, degrees=True)
        rotations[:, joint] = (bone.axis * turned * bone.axis.inv()).as_matrix()
    # The root's `end` is its position, so that its children start at the root itself.
    ends = {name: bone.end if name != "root" else np.zeros(3) for name, bone in bones.items()}
    return SkeletonRecording(
        path=path,
        fps=_FPS,
        joints=names,
        parents=(-1, *(names.index(bones[name].parent) for name in names[1:])),
        offsets=np.array([np.zeros(3), *(ends[bones[name].parent] for name in names[1:])]),
        root=root,
        rotations=rotations,
    )


def read_asf(path: Path) -> dict[str, Bone]:
    """Return the bones of an ASF file by name, parents before children. The first is `root`; its `end` is its position.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file is malformed; the message gives the line, what was expected and what was found.
    """
    lines = read_lines(path)
    section, fields = "", {}
    blocks: dict[str, dict] = {"root": {}}
    parents: dict[str, str] = {}
    for number, line in enumerate(lines):
        words = line.split("#")[0].split()
        if not words or words[0].startswith("("):
            continue
        if words[0].startswith(":"):
            section = words[0]
        elif section == ":units" and words[0] == "angle" and words[1:] != ["deg"]:
            raise malformed(path, number, "angles in deg", line)
        elif section == ":root":
            blocks["root"][words[0]] = (number, words[1:])
        elif section == ":bonedata" and words == ["begin"]:
            fields = {}
        elif section == ":bonedata" and words == ["end"]:
            if "name" not in fields:
                raise malformed(path, number, "a bone's name before its end", line)
            blocks[" ".join(fields["name"][1])] = fields
        elif section == ":bonedata":
            fields[words[0]] = (number, words[1:])
        elif section == ":hierarchy" and words not in (["begin"], ["end"]):
            # A parent must be in the tree already; a child must not be.
            wrong = [name for name in words if name not in blocks] or [name for name in words[1:] if name in parents]
            if wrong or (words[0] != "root" and words[0] not in parents):
                raise malformed(path, number, "a bone in the tree, then bones outside it, all of :bonedata", line)
            parents.update(dict.fromkeys(words[1:], words[0]))
    if not parents:
        raise ValueError(f"{path}: expected :root, :bonedata and :hierarchy, found no bones in a tree")
    return {name: _bone(path, name, parents.get(name, ""), blocks[name]) for name in ("root", *parents)}


def _bone(path: Path, name: str, parent: str, fields: dict) -> Bone:
    wanted = ("order", "axis", "position", "orientation") if name == "root" else ("direction", "length", "axis")
    missing = [field for field in wanted if field not in fields]
    if missing:
        raise ValueError(f"{path}: bone {name!r}: expected {', '.join(wanted)}, found no {', '.join(missing)}")

    def read(field: str, count: int) -> np.ndarray:
        number, words = fields[field]
        return np.array(numbers(path, number, words[:count], count))

    if name == "root":
        end, angles, dof = read("position", 3), read("orientation", 3), fields["order"]
    else:
        end, angles, dof = read("direction", 3) * read("length", 1), read("axis", 3), fields.get("dof", (0, []))
    order = fields["axis"][1][-1].lower()
    if sorted(order) != ["x", "y", "z"]:
        raise malformed(path, fields["axis"][0], "an axis order such as XYZ", order)
    channels = tuple(channel.lower() for channel in dof[1])
    allowed = ("tx", "ty", "tz", "rx", "ry", "rz")[0 if name == "root" else 3 :]
    if not set(channels) <= set(allowed) or len(set(channels)) != len(channels):
        raise malformed(path, dof[0], f"channels among {' '.join(allowed)}", " ".join(dof[1]))
    return Bone(parent, end, Rotation.from_euler(order, angles, degrees=True), order, channels)


def _parse_frames(path: Path, lines: list[str], bones: dict[str, Bone]) -> dict[str, np.ndarray]:
    """Return the values (F, channels) of each bone; none for bones without channels."""
    for number, line in enumerate(lines):
        if line.strip().upper() == ":RADIANS":
            raise malformed(path, number, "angles in :DEGREES", line)
    filled = [i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#:"]
    words = [lines[i].split() for i in filled]
    moving = sorted(name for name, bone in bones.items() if bone.dof)
    # The first frame sets the order in which all others must list the bones.
    order = [row[0] for row in words[1 : 1 + len(moving)]]
    if sorted(order) != moving or not words[0][0].isdecimal():
        found = ", ".join(row[0] for row in words[: 1 + len(moving)]) or "nothing"
        raise ValueError(
            f"{path}: expected frames of a number and a line for each of {', '.join(moving)}; the first holds {found}"
        )
    period = 1 + len(order)
    for i, (at, row) in enumerate(zip(filled, words, strict=True)):
        frame, bone = divmod(i, period)
        name = order[bone - 1] if bone else str(int(words[0][0]) + frame)
        if row[0] != name:
            raise malformed(path, at, f"{name!r}", lines[at])
    if len(words) % period:
        raise malformed(path, len(lines) - 1, f"{period - 1} bones a frame until the file ends", lines[-1])
    values = {name: np.empty((len(words) // period, 0)) for name in bones}
    for bone, name in enumerate(order, 1):
        rows = [row[1:] for row in words[bone::period]]
        values[name] = number_table(path, filled[bone::period], rows, len(bones[name].dof))
    return values
