"""Small BVH and AMC files of known content."""

from pathlib import Path

# Joint, parent, offset in metres from it: x to the left, y up, z forward.
_DAZ = """hip -            0 1 0
abdomen hip       0 0.2 0
chest abdomen     0 0.1 0
neck chest        0 0.2 0
head neck         0 0.1 0
{s}Collar chest   {x}0.03 0.18 0
{s}Shldr {s}Collar {x}0.15 0 0
{s}ForeArm {s}Shldr {x}0.28 0 0
{s}Hand {s}ForeArm {x}0.25 0 0
{s}Mid1 {s}Hand   {x}0.09 0 0
{s}Thigh hip      {x}0.09 -0.05 0
{s}Shin {s}Thigh  0 -0.42 0
{s}Foot {s}Shin   0 -0.41 0"""


def bvh(path: Path, poses: list[dict[str, tuple[float, float, float]]], scale: float = 1.0, fps: float = 60.0) -> Path:
    """Write a BVH file with the joint names of cgspeed for Daz.

    Args:
        path: The file.
        poses: For each frame, the angles z, x, y of the joints that turn, degrees; `root` is the position of the root
            without its offset, m.
        scale: Units per metre.
        fps: Frames per second.
    """
    middle, sides = _DAZ.splitlines()[:5], _DAZ.splitlines()[5:]
    rows = [
        row.format(s=s, x=x).split() for s, x in (("", ""), ("l", ""), ("r", "-")) for row in (sides if s else middle)
    ]
    text, order = ["HIERARCHY"], []

    def write(joint: str, parent: str, *offset: str) -> None:
        order.append(joint)
        channels = "Zrotation Xrotation Yrotation"
        text.extend([f"{'ROOT' if parent == '-' else 'JOINT'} {joint}", "{"])
        text.append("OFFSET " + " ".join(str(float(value) * scale) for value in offset))
        text.append(
            f"CHANNELS 6 Xposition Yposition Zposition {channels}" if parent == "-" else f"CHANNELS 3 {channels}"
        )
        children = [row for row in rows if row[1] == joint]
        for row in children:
            write(*row)
        if not children:
            text.extend(["End Site", "{", "OFFSET 0 0 0", "}"])
        text.append("}")

    write(*rows[0])
    text.extend(["MOTION", f"Frames: {len(poses)}", f"Frame Time: {1 / fps:.8f}"])
    for pose in poses:
        values = [value * scale for value in pose.get("root", (0, 0, 0))]
        values += [angle for joint in order for angle in pose.get(joint, (0, 0, 0))]
        text.append(" ".join(f"{value:.6f}" for value in values))
    path.write_text("\n".join(text) + "\n")
    return path


_ACCLAIM = """root lowerback 0 1 0 2
lowerback thorax 0 1 0 2
thorax head 0 1 0 2
thorax {s}humerus {x}1 0 0 5
{s}humerus {s}radius {x}1 0 0 3
{s}radius {s}wrist {x}1 0 0 1.5
{s}wrist {s}hand {x}1 0 0 1
{s}hand {s}fingers {x}1 0 0 1
root {s}femur {x}0.34202 -0.939693 0 7.5
{s}femur {s}tibia {x}0.34202 -0.939693 0 7
{s}tibia {s}foot 0 0 1 2"""


def amc(path: Path, frames: list[dict[str, tuple[float, ...]]]) -> Path:
    """Write an AMC file `<subject>_<trial>.amc`, and its ASF beside it.

    Args:
        path: The AMC file.
        frames: For each frame, the angles about x, y and z of the bones that turn, degrees; six values of `root`.
    """
    rows = []
    for parent, bone, *direction, length in _rows(_ACCLAIM):
        rows.append((parent, bone, " ".join(direction), length))
    text = [
        ":version 1.10",
        ":units",
        "  length 0.45",
        "  angle deg",
        ":root",
        "  order TX TY TZ RX RY RZ",
        "  axis XYZ",
    ]
    text += ["  position 0 0 0", "  orientation 0 0 0", ":bonedata"]
    for number, (_, bone, direction, length) in enumerate(rows):
        axis = (
            {"l": "0 0 20", "r": "0 0 -20"}.get(bone[0], "0 0 0") if bone[1:] in ("femur", "tibia", "foot") else "0 0 0"
        )
        text += ["begin", f"id {number + 1}", f"name {bone}", f"direction {direction}", f"length {length}"]
        text += [f"axis {axis} XYZ", "dof rx ry rz", "limits (-90 90)", "(-90 90)", "(-90 90)", "end"]
    text += [":hierarchy", "begin", *(f"{parent} {bone}" for parent, bone, *_ in rows), "end"]
    path.with_name(path.stem.split("_")[0] + ".asf").write_text("\n".join(text) + "\n")
    text = ["#!OML:ASF", ":FULLY-SPECIFIED", ":DEGREES"]
    for number, frame in enumerate(frames):
        text += [str(number + 1), "root " + " ".join(map(str, frame.get("root", (0, 17, 0, 0, 0, 0))))]
        text += [f"{bone} " + " ".join(map(str, frame.get(bone, (0, 0, 0)))) for _, bone, *_ in rows]
    path.write_text("\n".join(text) + "\n")
    return path


def _rows(table: str) -> list[list[str]]:
    """Return the words of each line, once for each side where it has a placeholder."""
    both = (("l", ""), ("r", "-"))
    return [row.format(s=s, x=x).split() for row in table.splitlines() for s, x in (both if "{s}" in row else both[:1])]
