"""C3D files of optical markers: https://www.c3d.org/docs/C3D_User_Guide.pdf.

Body segments are found from the markers on the skin. ezc3d is not used: it reads a file that is cut off as a shorter
one, and a wrong number of points in the header as the right one.
"""

import math
import struct
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from dmae.files.contents import read_bytes
from synth.motion.geometry import UPRIGHT, about, aligned
from synth.motion.motion import Motion
from synth.motion.readers import ReadOptions, reader
from synth.motion.readers.dialects import renamed
from synth.motion.readers.recording import fill_gaps
from synth.motion.readers.takes import true_fps
from synth.motion.retargeting import ANKLE_OF_LEG, check_rate, put_on_floor, unit_of
from synth.people.body import SEGMENTS

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
    """Optical markers over F frames, as stored in a file."""

    # Positions (F, 3) by label, in the file's unit and axes; NaN where a marker was not seen
    places: dict[str, np.ndarray]
    fps: float  # Frames per second
    unit: str  # Name of the unit, as the file states it
    up: str  # Axis that points up according to the file, `x`, `y` or `z`; z if the file does not state it


@reader("c3d", markers=True)
def read_motion(path: Path, options: ReadOptions) -> Motion:
    """C3D with the markers of CMU's set of 41, or with motion.mapping of others.

    Marker gaps of up to 0.25 s are interpolated. Then the longest stretch with all markers is used. The name of the
    motion lists both.

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
        found = _segments(marker, path)
    if not np.isfinite(found.rotations).all():
        frame, segment = np.argwhere(~np.isfinite(found.rotations).all((2, 3)))[0]
        raise ValueError(
            f"{path}: expected markers that show how {SEGMENTS[segment]} lies, found some of them at one place or in "
            f"line in frame {frame + 1} of those with all markers"
        )
    name, metres = unit_of(found.leg, path, options.unit)
    if options.unit is None and name != points.unit:
        notes = (*notes, f"stated in {points.unit!r}")
    motion = Motion(
        name=f"{path.stem} ({', '.join(('markers', name, f'{points.fps:.4g} fps', *notes))})",
        fps=points.fps,
        root=found.hips.mean(1) * metres,
        rotations=found.rotations,
        hip_height=(1 + ANKLE_OF_LEG) * found.leg * metres,
    )
    return put_on_floor(motion, found.ankles * metres, path, lies=options.up is not None)


def read_points(path: Path, fps: float | None = None) -> MarkerRecording:
    """Read the markers of a file; a frame rate that is given replaces the stated rate. Raises as `read_motion`."""
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
    labels = labels[: places.shape[1]]
    twice = sorted(label for label, count in Counter(labels).items() if count > 1 and not label.startswith("*"))
    if twice:
        raise ValueError(f"{path}: expected labels of markers that differ, found more than one of {', '.join(twice)}")
    return MarkerRecording(
        places={label: places[:, i] for i, label in enumerate(labels)},
        fps=rate,
        unit={"in": "inches"}.get(units, units or "no unit"),
        up=screen[-1:] if screen[-1:] in UPRIGHT else "z",
    )


def _one(parameters: dict[str, np.ndarray], name: str, default: Any) -> Any:
    """Return the first value of a parameter, or the default if there is none of its type."""
    values = parameters.get(name, np.empty(0))
    return values.flat[0].item() if values.size and isinstance(values.flat[0].item(), type(default)) else default


def _parameters(data: bytes, at: int, processor: int) -> dict[str, np.ndarray]:
    """Return the values of all parameters by `GROUP:NAME`; ValueError, IndexError or struct.error if damaged."""
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
    numbers = _numbers(data[(start - 1) * _BLOCK : needed], width, processor).reshape(frames, columns)
    values = numbers[:, : 4 * count].reshape(frames, count, 4)
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


_SIDED = ("FWT", "BWT", "SHO", "ELB", "WRA", "WRB", "FIN", "KNE", "ANK", "HEE", "TOE", "MT5", "FHD", "BHD")
MARKERS = ("C7", "T10", "CLAV", "STRN", *(side + name for side in "LR" for name in _SIDED))
"""The markers from which joints are found, of the 41 markers of CMU's database."""
SYNONYMS = {f"{side}{theirs}": f"{side}{ours}" for side in "LR" for theirs, ours in (("ASI", "FWT"), ("PSI", "BWT"))}
"""Names of markers at the same places in Vicon's Plug-in Gait set."""

# Joint centres relative to a marker, as fractions of a nearby length: along x, outward, and along z of axes that
# markers define; and rotations from these axes to the segment's own axes. Measured on CMU's subject 2, for which there
# are markers and the Acclaim skeleton that CMU solved from them: takes 02_01 and 02_05, mean of both sides.
_HIP = (0.125, 0.343, -0.410)
_SHOULDER = (0.062, 0.074, -0.124)
_ELBOW = (0.049, -0.065, -0.146)
_WRIST = (0.038, 0.088, -0.159)
_KNEE = (0.021, -0.172, -0.003)
_ANKLE = (-0.025, -0.110, -0.009)
_HEAD_PITCH, _HAND_PITCH, _FOOT_ROLL = np.radians((30.0, -27.0, 10.0))
_SPINE_SHARE = 0.63
"""Share of the turn from pelvis to chest that the lumbar spine makes."""
_HINGE_DOUBT = 0.4
"""Weight of the prior on the hinge axis of an elbow or a knee, as the sine of the bend at which both count the same."""


class _Segments(NamedTuple):
    """Where markers place the body, in their unit and axes with z up."""

    hips: np.ndarray  # (F, 2, 3) left and right
    ankles: np.ndarray  # (F, 2, 3) left and right
    rotations: np.ndarray  # (F, 16, 3, 3) of `SEGMENTS`
    leg: float  # Length of thigh and shin together, the mean of both sides


def _segments(marker: dict[str, np.ndarray], path: Path) -> _Segments:
    """Return the segments of a body from markers (F, 3).

    Joint centres are at fixed positions relative to the markers, in proportion to the body. Limbs point from joint to
    joint. The hinge axis of an elbow or knee is orthogonal to the plane in which the limb bends. If the limb hardly
    bends, the line between the two markers of the wrist, or the pelvis, determines the axis. The markers of the fifth
    metatarsals may be missing.

    Raises ValueError if two markers coincide that must be at different positions.
    """
    _check_apart(marker, path)
    pelvis, skull = _across(marker, "FWT", "BWT"), _across(marker, "FHD", "BHD")
    front, back = _middle(marker, "CLAV", "STRN"), _middle(marker, "C7", "T10")
    ribs = aligned(_middle(marker, "C7", "CLAV") - _middle(marker, "T10", "STRN"), front - back, (0, 0, 1))
    bend = Rotation.from_matrix(pelvis.swapaxes(1, 2) @ ribs).as_rotvec()
    turns = {
        "pelvis": pelvis,
        "spine": pelvis @ Rotation.from_rotvec(_SPINE_SHARE * bend).as_matrix(),
        "chest": ribs,
        "head": skull @ about("y", _HEAD_PITCH),
    }
    hips, ankles, legs = [], [], []
    for side, outward in (("l", 1.0), ("r", -1.0)):
        turns |= _arm(marker, side, outward, ribs)
        of_leg, hip, knee, ankle = _leg(marker, side, outward, pelvis)
        turns |= of_leg
        hips.append(hip)
        ankles.append(ankle)
        legs.append(_distance(hip, knee) + _distance(knee, ankle))
    rotations = np.stack([turns[name] for name in SEGMENTS], axis=1)
    return _Segments(np.stack(hips, axis=1), np.stack(ankles, axis=1), rotations, sum(legs) / 2)


def _arm(marker: dict[str, np.ndarray], side: str, outward: float, ribs: np.ndarray) -> dict[str, np.ndarray]:
    """Return the orientations (F, 3, 3) of the segments of an arm. `outward` is 1 on the left, where y points."""
    sho, elb, wra, wrb, fin = (marker[side.upper() + name] for name in ("SHO", "ELB", "WRA", "WRB", "FIN"))
    mirrored, out = np.array((1, outward, 1)), (0, outward, 0)
    bar, lower = wra - wrb, (wra + wrb) / 2 - elb
    length, forearm = _distance(sho, elb), _distance(elb, (wra + wrb) / 2)
    shoulder = sho + ribs @ (mirrored * _SHOULDER * length)
    wrist = elb + lower + aligned(lower, bar, out) @ (mirrored * _WRIST * forearm)
    elbow = elb
    # The first estimate of the joint centre gives an approximate hinge axis. The axis gives a better centre.
    for _ in range(2):
        upper, lower = elbow - shoulder, wrist - elbow
        prior = outward * np.cross(_unit(bar), _unit(lower))
        hinge = outward * np.cross(_unit(lower), _unit(upper)) + _HINGE_DOUBT * prior
        elbow = elb + aligned(elb - sho, np.cross(outward * (elb - sho), hinge), out) @ (mirrored * _ELBOW * length)
    upper = elbow - shoulder
    return {
        f"{side}_upper_arm": aligned(upper, np.cross(outward * upper, hinge), out),
        f"{side}_forearm": aligned(wrist - elbow, bar, out),
        f"{side}_hand": aligned(fin - wrist, bar, out) @ about("x", outward * _HAND_PITCH),
    }


def _leg(
    marker: dict[str, np.ndarray], side: str, outward: float, pelvis: np.ndarray
) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray]:
    """Return the orientations (F, 3, 3) of the segments of a leg, and its hip, knee and ankle (F, 3)."""
    kne, ank, hee, toe = (marker[side.upper() + name] for name in ("KNE", "ANK", "HEE", "TOE"))
    mirrored, down = np.array((1, outward, 1)), (0, 0, -1)
    waist = _distance(marker["LFWT"], marker["RFWT"])
    hip = _middle(marker, "LFWT", "RFWT", "LBWT", "RBWT") + pelvis @ (mirrored * _HIP * waist)
    shank, length = ank - kne, _distance(kne, ank)
    little = marker.get(f"{side.upper()}MT5")
    sole = np.cross(toe - hee, outward * (little - toe) if little is not None else pelvis[..., 1])
    foot = aligned(sole, toe - hee, (0, 0, 1))
    ankle = ank + foot @ (mirrored * _ANKLE * length)
    knee = kne
    for _ in range(2):
        hinge = np.cross(_unit(knee - hip), _unit(ankle - knee)) + _HINGE_DOUBT * pelvis[..., 1]
        knee = kne + aligned(shank, np.cross(shank, hinge), down) @ (mirrored * _KNEE * length)
    turns = {
        f"{side}_thigh": aligned(knee - hip, np.cross(knee - hip, hinge), down),
        f"{side}_shin": aligned(ankle - knee, np.cross(ankle - knee, hinge), down),
        f"{side}_foot": foot if little is None else foot @ about("x", outward * _FOOT_ROLL),
    }
    return turns, hip, knee, ankle


def _middle(marker: dict[str, np.ndarray], *names: str) -> np.ndarray:
    return np.mean([marker[name] for name in names], axis=0)


def _across(marker: dict[str, np.ndarray], front: str, back: str) -> np.ndarray:
    """Return axes from four markers around the body: y exactly left, and x as close to forward as possible."""
    left = _middle(marker, f"L{front}", f"L{back}") - _middle(marker, f"R{front}", f"R{back}")
    forward = _middle(marker, f"L{front}", f"R{front}") - _middle(marker, f"L{back}", f"R{back}")
    return aligned(left, forward, (0, 1, 0))


def _check_apart(marker: dict[str, np.ndarray], path: Path) -> None:
    """Raise ValueError if markers that define a direction or a distance coincide."""
    around = [("CLAV", "C7"), ("STRN", "T10"), ("C7", "T10"), ("LFWT", "RFWT"), ("LFHD", "RFHD")]
    pairs = ("FWT BWT", "FHD BHD", "SHO ELB", "ELB WRA", "WRA WRB", "WRA FIN", "FWT KNE", "KNE ANK", "HEE TOE")
    around += [(side + one, side + other) for side in "LR" for one, other in map(str.split, pairs)]
    least = 0.02 * (_distance(marker["LSHO"], marker["LANK"]) + _distance(marker["RSHO"], marker["RANK"])) / 2
    together = [f"{one} and {other}" for one, other in around if not _distance(marker[one], marker[other]) > least]
    if together:
        raise ValueError(f"{path}: expected markers apart that lie at the same place: {', '.join(together)}")


def _distance(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.median(np.linalg.norm(one - other, axis=1)))


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
