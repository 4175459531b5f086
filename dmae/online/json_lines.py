"""Frames and poses as lines of JSON, so that other programs can send detections and receive people.

Each line that comes in is a frame, an object. Its `cameras` holds the detections by camera name:

    {"cameras": {"left": [[[812.5, 340.1, 0.93], null, ...]], "right": []}}

a list of detections, each a list of J joints, each [x, y, confidence] in px or null. A camera that is not named was
dropped in this frame. The first line that goes out describes the others:

    {"skeleton": "body25", "joints": ["nose", ...], "cameras": ["left", "right"], "fps": 25, "delay_frames": 14}

Each later one is a finished frame, in order:

    {"frame": 0, "missing": [], "people": [{"id": 3, "xyz": [[0.1, 1.2, 1.7], null, ...], "source": ["measured", ...],
     "error_mm": [12.1, null, ...]}]}

`missing` are the cameras that were dropped, `id` is the same for a person in all frames, `xyz` is in m in the world,
null where a joint is absent, and `error_mm` is the standard error, null where it is unknown. A line that is not such a
frame is answered with {"frame": 7, "error": "..."} as soon as it is read, and counts as a frame in which no camera saw
anyone, so that frames keep their times.
"""

import json
from collections.abc import Iterable, Iterator

import numpy as np

from dmae.data.clip import Detections2D, Source
from dmae.data.json_values import rounded
from dmae.data.skeleton import Skeleton
from dmae.files.checks import MOST_PIXELS, MOST_SCORE, check_numbers, numbers_of
from dmae.online.capture import OnlineCapture
from dmae.online.completion import FinishedFrame

LONGEST = 4_000_000
"""Characters of a line."""
_MOST_DETECTIONS = 1000  # Of one camera in one frame
_NAMES = [kind.name.lower() for kind in Source]


def answer_lines(
    lines: Iterable[str], capture: OnlineCapture, cameras: tuple[str, ...], skeleton: Skeleton, fps: float
) -> Iterator[str]:
    """Yield the lines that answer lines of frames: first a description, then finished frames and errors.

    Args:
        lines: Frames of one recording, in the order of time. Empty lines are skipped.
        capture: Made for these cameras and this skeleton; nothing was pushed to it yet.
        cameras: Names of the V cameras.
    """
    about = {"skeleton": skeleton.name, "joints": skeleton.joints, "cameras": cameras, "fps": fps}
    yield json.dumps(about | {"delay_frames": capture.delay})
    missing: dict[int, list[str]] = {}
    number = 0
    for line in lines:
        if not line.strip():
            continue
        try:
            detections, missing[number] = read_frame(line, cameras, skeleton)
        except ValueError as error:
            yield json.dumps({"frame": number, "error": str(error)})
            detections, missing[number] = _stack([[] for _ in cameras], skeleton), list(cameras)
        number += 1
        for frame in capture.push(detections):
            yield frame_line(frame, missing.pop(frame.number))
    for frame in capture.flush():
        yield frame_line(frame, missing.pop(frame.number))


def read_frame(line: str, cameras: tuple[str, ...], skeleton: Skeleton) -> tuple[Detections2D, list[str]]:
    """Return the detections of a line, (1, V, D, J, ...), and the names of the cameras that it does not name.

    Raises ValueError if the line is no frame of these cameras and joints; the message says where and what was expected.
    """
    if len(line) > LONGEST:
        raise ValueError(f"a line of {len(line)} characters; expected at most {LONGEST}")
    try:
        content = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"expected a frame as JSON, {error}") from None
    views = content.get("cameras") if isinstance(content, dict) else None
    if not isinstance(views, dict):
        raise ValueError('expected {"cameras": {name: detections, ...}}, ' + _short(content))
    unknown = sorted(set(views) - set(cameras))
    if unknown:
        raise ValueError(f"no cameras {unknown} in the calibration; there are {list(cameras)}")
    found = [_detections(views.get(name, []), name, skeleton) for name in cameras]
    return _stack(found, skeleton), [name for name in cameras if name not in views]


def frame_line(frame: FinishedFrame, missing: list[str]) -> str:
    """Return the line of a finished frame.

    Args:
        frame: P people.
        missing: Names of the cameras that were dropped.
    """
    poses = frame.poses
    error = 1000 * np.sqrt(np.trace(poses.cov[0].astype(np.float64), axis1=-2, axis2=-1) / 3)
    people = [
        {
            "id": int(person),
            "xyz": [None if np.isnan(joint[0]) else joint.round(4).tolist() for joint in xyz.astype(np.float64)],
            "source": [_NAMES[kind] for kind in source],
            "error_mm": [rounded(value, 1) for value in errors],
        }
        for person, xyz, source, errors in zip(frame.people, poses.xyz[0], poses.source[0], error, strict=True)
    ]
    return json.dumps({"frame": frame.number, "missing": missing, "people": people})


def _detections(found: object, camera: str, skeleton: Skeleton) -> list[np.ndarray]:
    """Return the detections (J, 3) of one camera, NaN where a joint is absent."""
    if not isinstance(found, list) or len(found) > _MOST_DETECTIONS:
        raise ValueError(
            f"camera {camera!r}: expected a list of at most {_MOST_DETECTIONS} detections, {_short(found)}"
        )
    return [
        _detection(joints, f"camera {camera!r}, detection {number}", skeleton) for number, joints in enumerate(found)
    ]


def _detection(joints: object, where: str, skeleton: Skeleton) -> np.ndarray:
    if not isinstance(joints, list) or len(joints) != len(skeleton):
        count = f"found {len(joints)} of them" if isinstance(joints, list) else _short(joints)
        raise ValueError(f"{where}: expected a list of the {len(skeleton)} joints of {skeleton.name}, {count}")
    rows = numbers_of([[np.nan] * 3 if joint is None else joint for joint in joints])
    if rows.shape != (len(skeleton), 3):
        raise ValueError(f"{where}: expected each joint as [x, y, confidence] or null, {_short(joints)}")
    rows[~np.isfinite(rows).all(-1) | (rows[:, 2] <= 0)] = np.nan
    check_numbers(f"{where}: x and y, px", rows[:, :2], MOST_PIXELS)
    check_numbers(f"{where}: confidence", rows[:, 2], MOST_SCORE)
    return rows


def _stack(views: list[list[np.ndarray]], skeleton: Skeleton) -> Detections2D:
    rows = np.full((1, len(views), max(map(len, views), default=0), len(skeleton), 3), np.nan)
    for view, detections in enumerate(views):
        for number, joints in enumerate(detections):
            rows[0, view, number] = joints
    return Detections2D(skeleton, rows[..., :2], rows[..., 2])


def _short(content: object) -> str:
    text = json.dumps(content)
    return f"found {text[:60]}{'...' if len(text) > 60 else ''}"
