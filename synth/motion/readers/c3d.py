"""Read C3D files of optical markers: https://www.c3d.org/docs/C3D_User_Guide.pdf."""

import math
import struct
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dmae.files.contents import read_bytes
from synth.motion.motion import Motion
from synth.motion.readers import ReadOptions, reader
from synth.motion.readers.cmu import true_fps
from synth.motion.readers.gaps import fill_gaps
from synth.motion.readers.joint_names import renamed
from synth.motion.readers.markers import MARKERS, SYNONYMS, segments
from synth.motion.retargeting import ANKLE_OF_LEG, check_rate, put_on_floor, unit_of
from synth.motion.rotations import UPRIGHT
from synth.people.segments import SEGMENTS

_BLOCK = 512
_DEC = 85
_BYTE_ORDERS = {84: "<", _DEC: "<", 86: ">"}
"""Byte order by the processor that a file names: Intel, DEC, MIPS."""
_FARTHEST = 1e6
"""Greatest distance of a marker from the origin, in any unit."""
_OPTIONAL = {"LMT5", "RMT5"}
"""Markers that a file may lack."""


@dataclass(frozen=True)
class MarkerRecording:
    """Optical markers over F frames, as stored in a file.

    Attributes:
        places: Positions (F, 3) by label, in the file's unit and axes; NaN where a marker was not seen.
        fps: Frames per second.
        unit: Name of the unit, as the file states it.
        up: Axis that points up according to the file, `x`, `y` or `z`; z if the file does not state it.
    """

    places: dict[str, np.ndarray]
    fps: float
    unit: str
    up: str


@reader("c3d", markers=True)
def read_motion(path: Path, options: ReadOptions) -> Motion:
    """C3D with the markers of CMU's set of 41, or with motion.mapping of others.

    Joints are found from the markers; see `synth.motion.readers.markers`.

    Marker gaps of up to 0.25 s are interpolated. Then the longest stretch with all markers is used. The name of the
    motion lists both.

    Args:
        path: The file.
        options: The user's corrections of the file.

    Raises:
        FileNotFoundError: there is no such file.
        ValueError: the file is no C3D file, is shorter than it states, lacks markers, loses them for most of the time,
            or contradicts itself; or as `synth.motion.retargeting.put_on_floor`.
    """
    points = read_points(path, options.fps)
    places = _marker_positions(points.places, options.mapping, path)
    filled, notes = fill_gaps(np.stack(list(places.values()), axis=1), list(places), points.fps, path)
    turn = UPRIGHT[options.up or points.up]
    marker = dict(zip(places, (filled @ turn.T).swapaxes(0, 1), strict=True))
    with np.errstate(invalid="ignore", divide="ignore"):
        hips, ankles, rotations, leg = segments(marker, path)
    if not np.isfinite(rotations).all():
        frame, segment = np.argwhere(~np.isfinite(rotations).all((2, 3)))[0]
        raise ValueError(
            f"{path}: expected markers that show how {SEGMENTS[segment]} lies, found some of them at one place or in "
            f"line in frame {frame + 1} of those with all markers"
        )
    name, metres = unit_of(leg, path, options.unit)
    if options.unit is None and name != points.unit:
        notes = (*notes, f"stated in {points.unit!r}")
    motion = Motion(
        name=f"{path.stem} ({', '.join(('markers', name, f'{points.fps:.4g} fps', *notes))})",
        fps=points.fps,
        root=hips.mean(1) * metres,
        rotations=rotations,
        hip_height=(1 + ANKLE_OF_LEG) * leg * metres,
    )
    return put_on_floor(motion, ankles * metres, path, lies=options.up is not None)


def read_points(path: Path, fps: float | None = None) -> MarkerRecording:
    """Read the markers of a file.

    This reader exists because ezc3d accepts truncated files and crashes on files with wrong headers.

    Args:
        path: The file.
        fps: Frame rate that replaces the stated rate.

    Raises:
        FileNotFoundError, ValueError: as `read_motion`, except for names of markers.
    """
    data = read_bytes(path)
    first = (data[0] - 1) * _BLOCK if data else 0
    processor = data[first + 3] if len(data) >= _BLOCK and 0 < first < len(data) - 4 else 0
    if processor not in _BYTE_ORDERS or data[1] != 0x50:
        raise ValueError(f"{path}: expected a C3D file (second byte 0x50, processor 84 to 86), found none")
    try:
        parameters = _parameters(data, first + 4, processor)
    except (struct.error, IndexError, ValueError) as error:
        raise ValueError(f"{path}: expected groups of parameters that say where the next begins: {error}") from error
    point = {key[6:]: value for key, value in parameters.items() if key.startswith("POINT:")}
    labels = [
        str(label).strip() for key, found in point.items() if key.startswith("LABELS") for label in np.ravel(found)
    ]
    places, rate = _places(data, processor, parameters, path)
    used = _one(point, "USED", float(len(labels)))
    if not used == places.shape[1] <= len(labels):
        raise ValueError(
            f"{path}: expected as many points in the header, in POINT:USED and in POINT:LABELS, found "
            f"{places.shape[1]}, {used:g} and {len(labels)}"
        )
    stated = _one(point, "RATE", rate)
    if fps is None and not (stated > 0 and abs(rate - stated) < 0.01 * stated):
        raise ValueError(
            f"{path}: expected one frame rate, found {rate:g} in the header and {stated:g} in POINT:RATE; "
            "give motion.fps=<the right one>"
        )
    rate = fps or true_fps(path.stem, stated)
    check_rate(rate, path)
    units, screen = (_one(point, name, "").strip().lower() for name in ("UNITS", "Y_SCREEN"))
    return MarkerRecording(
        places=_by_label(labels[: places.shape[1]], places, path),
        fps=rate,
        unit={"in": "inches"}.get(units, units or "no unit"),
        up=screen[-1:] if screen[-1:] in UPRIGHT else "z",
    )


def _one(parameters: dict[str, np.ndarray], name: str, default: float | str) -> float | str:
    """Return the first value of a parameter, or the default if there is none of its type."""
    values = parameters.get(name, np.empty(0))
    return values.flat[0].item() if values.size and isinstance(values.flat[0].item(), type(default)) else default


def _parameters(data: bytes, at: int, processor: int) -> dict[str, np.ndarray]:
    """Return the values of all parameters by `GROUP:NAME`; text as strings.

    Raises:
        ValueError, IndexError, struct.error: the parameters do not fit the data.
    """
    groups: dict[int, str] = {}
    found: dict[tuple[int, str], np.ndarray] = {}
    while data[at]:
        length, group = struct.unpack_from("2b", data, at)
        start = at + 2 + abs(length)
        name = data[at + 2 : start].decode("latin-1").upper()
        (step,) = struct.unpack_from(f"{_BYTE_ORDERS[processor]}H", data, start)
        if group < 0:
            groups[-group] = name
        elif group > 0:
            kind, dimensions = struct.unpack_from("bB", data, start + 2)
            sizes = tuple(data[start + 4 : start + 4 + dimensions])
            count, values = math.prod(sizes), start + 4 + dimensions
            raw = data[values : values + count * abs(kind)]
            if kind not in (-1, 1, 2, 4) or len(sizes) != dimensions or len(raw) != count * abs(kind):
                raise ValueError(f"{name!r} holds {sizes} values of type {kind}, more than there is")
            if kind == -1:
                width = sizes[0] if sizes else 1
                texts = [raw[i : i + width].decode("latin-1") for i in range(0, count, width or 1)]
                found[group, name] = np.array(texts)
            else:
                found[group, name] = _numbers(raw, kind, processor)
        if not group or not step:
            break
        at = start + step
    return {f"{groups.get(group, group)}:{name}": value for (group, name), value in found.items()}


def _places(data: bytes, processor: int, parameters: dict[str, np.ndarray], path: Path) -> tuple[np.ndarray, float]:
    """Return positions (F, points, 3), NaN where a point was not seen, and the frame rate of the header."""
    count, analog, first, last = (int(value) & 0xFFFF for value in _numbers(data[2:10], 2, processor))
    start = int(_numbers(data[16:18], 2, processor)[0]) & 0xFFFF
    scale, rate = (float(_numbers(data[at : at + 4], 4, processor)[0]) for at in (12, 20))
    frames = last - first + 1
    ends = [parameters.get(f"TRIAL:ACTUAL_{end}_FIELD", np.empty(0)) for end in ("START", "END")]
    if last == 0xFFFF and all(len(end) == 2 for end in ends):
        # A frame number beyond the header's 16 bits is stored here, low word first.
        begun, ended = (int(low) % 65536 + 65536 * (int(high) % 65536) for low, high in ends)
        frames = ended - begun + 1
    if not (count and frames > 0 and start > 1 and np.isfinite([scale, rate]).all() and scale):
        raise ValueError(f"{path}: expected frames of points, the header states {count} points in {frames} frames")
    width, columns = (4 if scale < 0 else 2), 4 * count + analog
    needed = (start - 1) * _BLOCK + frames * columns * width
    if len(data) < needed:
        raise ValueError(
            f"{path}: expected {frames} frames of {count} points, {needed} bytes, as the header states; "
            f"found {len(data)} bytes: the file is cut off, or its header wrong"
        )
    values = _numbers(data[(start - 1) * _BLOCK : needed], width, processor).reshape(frames, columns)
    values = values[:, : 4 * count].reshape(frames, count, 4)
    places = values[..., :3] * (scale if scale > 0 else 1.0)
    # A negative fourth number marks a point that was not seen; some writers put it at the origin instead.
    seen = (values[..., 3] >= 0) & (places != 0).any(2) & (np.abs(places) < _FARTHEST).all(2)
    return np.where(seen[..., None], places, np.nan), rate


def _numbers(raw: bytes, width: int, processor: int) -> np.ndarray:
    """Return integers of 1 or 2 bytes or floats of 4, in a processor's representation, as float64."""
    kind, scale = {1: "i1", 2: "i2", 4: "f4"}[width], 1.0
    if width == 4 and processor == _DEC:
        # Words are swapped, and exponents are greater by two.
        raw, scale = np.frombuffer(raw, "<u2").reshape(-1, 2)[:, ::-1].tobytes(), 0.25
    # Bytes may encode a signalling NaN.
    with np.errstate(invalid="ignore"):
        return np.frombuffer(raw, _BYTE_ORDERS[processor] + kind).astype(np.float64) * scale


def _by_label(labels: list[str], places: np.ndarray, path: Path) -> dict[str, np.ndarray]:
    twice = sorted(label for label, count in Counter(labels).items() if count > 1 and not label.startswith("*"))
    if twice:
        raise ValueError(f"{path}: expected labels of markers that differ, found more than one of {', '.join(twice)}")
    return {label: places[:, i] for i, label in enumerate(labels)}


def _marker_positions(places: dict[str, np.ndarray], mapping: dict[str, str], path: Path) -> dict[str, np.ndarray]:
    """Return the positions (F, 3) of `MARKERS` by name. A label may begin with the name of a person and a colon."""
    names = renamed(tuple(places), mapping, {*MARKERS, *SYNONYMS}, path)
    bare = [name.rpartition(":")[2].upper() for name in names]
    ours: dict[str, list[str]] = {}
    for label, name in zip(places, bare, strict=True):
        ours.setdefault(SYNONYMS.get(name, name), []).append(label)
    several = {name: labels for name, labels in ours.items() if name in MARKERS and len(labels) > 1}
    if several:
        name, labels = next(iter(several.items()))
        raise ValueError(
            f"{path}: expected the markers of one person, found {len(labels)} of {name}: {', '.join(labels)}. Say "
            "which to take in motion.mapping=<a YAML file of lines `their name: ours`>, and call others anything else"
        )
    lacking = [name for name in MARKERS if name not in ours and name not in _OPTIONAL]
    if lacking:
        raise ValueError(
            f"{path}: expected the markers of CMU's set, found {', '.join(places)}; lacking are {', '.join(lacking)}. "
            "If others lie there, say so in motion.mapping=<a YAML file of lines `their name: ours`>"
        )
    return {name: places[ours[name][0]] for name in MARKERS if name in ours}
