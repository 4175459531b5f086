"""C3D files of a synthetic person with known joints, and variants of such files by older machines."""

import struct
from pathlib import Path

import numpy as np

# In a T-pose, m: x forward, y left, z up; left side only.
_MARKERS = """C7 -0.08 0 1.50
T10 -0.10 0 1.25
CLAV 0.06 0 1.44
STRN 0.08 0 1.21
{s}FHD 0.09 0.07 1.72
{s}BHD -0.09 0.07 1.616
{s}FWT 0.10 0.13 1.02
{s}BWT -0.10 0.06 1.02
{s}SHO -0.02 0.18 1.48
{s}ELB -0.01 0.47 1.486
{s}WRA 0.03 0.72 1.484
{s}WRB -0.03 0.72 1.484
{s}FIN 0.00 0.813 1.48
{s}KNE 0.00 0.16 0.50
{s}ANK 0.00 0.135 0.08
{s}HEE -0.08 0.09 0.04
{s}TOE 0.14 0.09 0.04
{s}MT5 0.08 0.15 0.03"""


def t_pose() -> dict[str, np.ndarray]:
    """Return the position (3,) of each marker in a T-pose, m."""
    markers = {}
    for row in _MARKERS.splitlines():
        for s, sign in (("L", 1), ("R", -1)) if "{s}" in row else (("", 1),):
            name, *place = row.format(s=s).split()
            markers[name] = np.array(place, float) * (1, sign, 1)
    return markers


def c3d(
    path: Path,
    markers: dict[str, np.ndarray],
    *,
    scale: float = 1000.0,
    fps: float = 100.0,
    units: str = "mm",
    up: str = "+Z",
    frames: int = 60,
) -> Path:
    """Write a C3D file.

    Args:
        path: The file.
        markers: By label, positions (3,) or (frames, 3), m; NaN where not seen.
        scale: Units per metre.
        fps: Frames per second.
        units: Unit that the file states.
        up: Axis that points up according to the file.
        frames: Number of frames.
    """
    import ezc3d

    content = ezc3d.c3d()
    point = content["parameters"]["POINT"]
    point["RATE"]["value"] = [fps]
    point["UNITS"]["value"] = [units]
    point["LABELS"]["value"] = list(markers)
    content.add_parameter("POINT", "Y_SCREEN", [up])
    places = np.stack([np.broadcast_to(place, (frames, 3)) for place in markers.values()], axis=1) * scale
    points = np.concatenate([places, np.ones((frames, len(markers), 1))], axis=2)
    content["data"]["points"] = points.transpose(2, 1, 0)
    content.write(str(path))
    return path


def as_dec(path: Path) -> Path:
    """Convert a file to that of a DEC machine: processor 85, floats with swapped words and exponents 2 greater."""
    data = bytearray(path.read_bytes())

    def convert(at: int, count: int) -> None:
        for i in range(at, at + 4 * count, 4):
            (value,) = struct.unpack_from("<f", data, i)
            swapped = struct.pack("<f", value * 4)
            data[i : i + 4] = swapped[2:] + swapped[:2]

    first, points, frames = data[0], struct.unpack_from("<H", data, 2)[0], 0
    low, high, start = *struct.unpack_from("<2H", data, 6), struct.unpack_from("<H", data, 16)[0]
    frames = high - low + 1
    convert(12, 1)
    convert(20, 1)
    at = (first - 1) * 512
    data[at + 3] = 85
    at += 4
    while data[at]:
        name = abs(struct.unpack_from("b", data, at)[0])
        group = struct.unpack_from("b", data, at + 1)[0]
        (step,) = struct.unpack_from("<H", data, at + 2 + name)
        if group > 0:
            kind, dims = struct.unpack_from("bB", data, at + 4 + name)
            if kind == 4:
                convert(at + 6 + name + dims, int(np.prod(list(data[at + 6 + name : at + 6 + name + dims]))))
        if not step:
            break
        at += 2 + name + step
    convert((start - 1) * 512, frames * points * 4)
    path.write_bytes(data)
    return path


def as_integers(path: Path, scale: float) -> Path:
    """Convert the points of a file to 16-bit integers, in multiples of `scale` units, as in most older files."""
    data = bytearray(path.read_bytes())
    points, _, low, high = struct.unpack_from("<4H", data, 2)
    at = (struct.unpack_from("<H", data, 16)[0] - 1) * 512
    values = np.frombuffer(bytes(data[at:]), "<f4", (high - low + 1) * points * 4).reshape(-1, 4).astype(float)
    values[:, :3] /= scale
    struct.pack_into("<f", data, 12, scale)
    path.write_bytes(bytes(data[:at]) + np.nan_to_num(values).round().astype("<i2").tobytes())
    return path
