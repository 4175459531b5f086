"""What readers of recordings share: people by camera and frame, and how cameras and calibration are matched.

A reader returns `NumberedDetections`. `dmae.formats.reading` adds the calibration and makes a clip.
"""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from dmae.data.cameras import CameraRig, camera_label
from dmae.data.clip import Clip, Detections2D, Poses3D
from dmae.data.skeleton import Skeleton
from dmae.files.checks import MOST_PIXELS, check_numbers, numbers_of
from dmae.files.structured import read_json
from dmae.progress import progress

_OPTIONS = "data.calibration=... or data.detections=..., or choose cameras by data.cameras=[...]"


def match_cameras(
    names: Sequence[str], rig: CameraRig, path: Path, what: str = "detections", options: str = _OPTIONS
) -> tuple[list[int], str | None]:
    """Return the index in the rig of each camera of a recording, and a note if not by name, or if some are left out.

    Cameras are matched by name, ignoring case and punctuation; or else by the last number in the name; or else, if
    names have no numbers, by order. The rig may contain further cameras only if the cameras match by name. Messages use
    `path`, `what` the cameras have ("detections" for example), and the `options` by which to give other files.

    Raises ValueError if the cameras do not match; the message lists both.
    """
    found, calibrated = [plain(name) for name in names], {plain(name): view for view, name in enumerate(rig.names)}
    both = f"{what} of {', '.join(names)} and calibration of {', '.join(rig.names)}"
    if len(set(found)) < len(names) or len(calibrated) < len(rig):
        raise ValueError(f"{path}: expected different cameras, found {both}")
    lacking = [name for name, bare in zip(names, found, strict=True) if bare not in calibrated]
    if not lacking:
        spare = [rig.names[view] for bare, view in calibrated.items() if bare not in found]
        those = "1 calibrated camera has" if len(spare) == 1 else f"{len(spare)} calibrated cameras have"
        are = "is" if len(spare) == 1 else "are"
        note = f"{those} no {what} and {are} left out: {', '.join(spare[:5])}"
        return [calibrated[bare] for bare in found], note if spare else None
    if len(lacking) < len(names) or len(names) != len(rig):
        raise ValueError(
            f"{path}: expected a calibration of each camera that has {what}, found {both}: {', '.join(lacking)} "
            f"{'has' if len(lacking) == 1 else 'have'} none; give the cameras the same names, or name other files by "
            f"{options}"
        )
    order: Callable[[str], Any] = natural
    how = "in order of their names"
    numbers: list[list[Any]] = [[_number(name) for name in part] for part in (names, rig.names)]
    if all(None not in part and len(set(part)) == len(part) for part in numbers):
        steps = {a - b for a, b in zip(*map(sorted, numbers), strict=True)}
        if len(steps) > 1:
            raise ValueError(f"{path}: expected cameras with the same numbers, found {both}")
        order, how = _number, "by number" if steps == {0} else "in order of their numbers"
    match = dict(zip(sorted(names, key=order), sorted(rig.names, key=order), strict=True))
    pairs = ", ".join(f"{name} = {match[name]}" for name in names)
    return [rig.names.index(match[name]) for name in names], (
        f"cameras of {what} and calibration are matched {how}: {pairs}"
    )


def plain(name: str) -> str:
    """Return the letters and digits of a name, of any script, in lower case."""
    return re.sub(r"[\W_]", "", name.lower())


def _number(name: str) -> int | None:
    digits = re.findall(r"\d+", name)
    return int(digits[-1]) if digits else None


def natural(name: str) -> list:
    """Return a sort key by which cam2 comes before cam10."""
    return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", name)]


def offsets_of_all(option: str, offsets: Sequence[int | str] | None, names: Sequence[str]) -> list[int] | None:
    """Return by how many frames each named camera started late, from numbers or entries `name:frames`, or None.

    Case and punctuation of names do not matter. Raises ValueError with the name of the option if an entry is malformed,
    or its camera is unknown or named twice.
    """
    if offsets is None or all(isinstance(each, int) for each in offsets):
        return None if offsets is None else [int(each) for each in offsets]
    found, known = {}, {plain(name): name for name in names}
    for each in offsets:
        given, _, frames = str(each).rpartition(":")
        name = given if given in names else known.get(plain(given))
        if name is None or name in found or not re.fullmatch(r"[+-]?\d{1,9}", frames):
            raise ValueError(
                f"{option}={list(offsets)}: expected a number for each camera, or entries as {names[0]}:3 of some "
                f"of {', '.join(names)}, each once; found {each!r}"
            )
        found[name] = int(frames)
    return [found.get(name, 0) for name in names]


def by_name(items: Iterable) -> list:
    """Return files, folders or cameras in the order of their names: cam2 comes before cam10."""
    return sorted(items, key=lambda item: natural(item.name))


def camera_files(path: Path, pattern: str) -> list[Path]:
    """Return the files of a folder that match a pattern, one for each camera, by name; or the path, if it is a file.

    Raises FileNotFoundError if there are none.
    """
    files = [path] if path.is_file() else by_name(path.glob(pattern))
    if not files:
        raise FileNotFoundError(
            f"{path}: expected {pattern.replace('*', '<camera>')}, found none; name their folder by data.detections=..."
        )
    return files


def frame_number(path: Path, stem: str) -> int:
    """Return the last number in the name of a file; ValueError if it has none."""
    number = _number(stem)
    if number is None:
        raise ValueError(f"{path}: expected a file name that ends in the frame number")
    return number


def json_frames(path: Path, cameras: Mapping[str, Iterable[Path]], unreadable: dict[str, list[str]]) -> Iterator[tuple]:
    """Yield camera, frame number, path and content of JSON files that hold a frame each, by camera.

    A file that is not valid JSON, for example because it is cut short, is left out, and its error is added to
    `unreadable`. Raises ValueError, with the path of the recording, if a frame occurs twice or no file can be read.
    """
    numbered: dict[tuple[str, int], Path] = {}
    for camera, files in cameras.items():
        for file in files:
            number = frame_number(file, file.stem)
            if (first := numbered.setdefault((camera, number), file)) != file:
                raise ValueError(f"{file}: expected frame {number} once, found it in {first.name} too")
    for (camera, number), file in progress(numbered.items(), "reading frames"):
        try:
            content = read_json(file)
        except ValueError as error:
            unreadable.setdefault(camera, []).append(str(error))
            continue
        yield camera, number, file, content
    if sum(map(len, unreadable.values())) == len(numbered):
        raise ValueError(f"{path}: not one file could be read; {next(iter(unreadable.values()))[0]}")


def listed_frames(
    file: Path, content: object, numbers: Sequence[str], people: Callable[[str, object], list]
) -> Iterator[tuple[int, str, list]]:
    """Yield number, place for messages, and `people(place, frame)` of each frame in a file that is a list of frames.

    A frame is numbered by one of the keys `numbers`, or else by its position. Raises ValueError if the content is no
    list, or a number is none or occurs twice.
    """
    if not isinstance(content, list):
        raise ValueError(f"{file}: expected a list of frames, found {content!r:.60}")
    found = set()
    for position, frame in enumerate(content):
        place, number = f"{file}: [{position}]", position
        if isinstance(frame, dict):
            number = next((frame[name] for name in numbers if name in frame), position)
        number = int(number) if isinstance(number, str) and number.isdecimal() and len(number) < 12 else number
        if not isinstance(number, int | np.integer) or isinstance(number, bool) or number in found:
            raise ValueError(f"{place}: expected a frame number, each once, found {number!r:.20}")
        found.add(number)
        yield int(number), place, people(place, frame)


def listed(file: Path, content: object, key: str) -> list:
    """Return the list in an object of JSON; ValueError, with the file, if there is none."""
    found = content.get(key) if isinstance(content, dict) else None
    if not isinstance(found, list):
        raise ValueError(f"{file}: expected an object with a list of {key}, found {content!r:.60}")
    return found


FRAME_KEYS = ("instances", "predictions", "people", "instance_info")
"""Keys of an object under which MMPose, RTMPose and their users list the people of a frame."""


def people_of_frame(place: str, frame: object) -> list:
    """Return the people of a frame as MMPose and RTMPose write it: a list, or an object with one of `FRAME_KEYS`."""
    people = frame
    if isinstance(frame, dict):
        people = next((frame[name] for name in FRAME_KEYS if name in frame), None)
    # The result of MMPose's inferencer is a list of images, each of which is a list of people.
    if isinstance(people, list) and len(people) == 1 and isinstance(people[0], list):
        people = people[0]
    if not isinstance(people, list):
        raise ValueError(f"{place}: expected a list of people, or one as instances, found {frame!r:.60}")
    return people


class People:
    """The people that a reader finds, by camera and frame number, all with the same joints.

    Joints without a positive confidence are absent, and joints at 0, 0, where Ultralytics puts those it doubts and
    keeps their confidence. People without joints are left out.

    Args:
        cameras: Cameras that have detections, maybe of nobody; others are added with their frames.
        skeleton: Skeleton of the people; by default they have as many joints as the first.
    """

    def __init__(self, cameras: Iterable[str] = (), skeleton: Skeleton | None = None):
        self.views: dict[str, dict[int, list[np.ndarray]]] = {camera: {} for camera in cameras}
        self.sizes: dict[str, tuple[int, int]] = {}  # By camera, image width and height, px, if files state them
        self.unreadable: dict[str, list[str]] = {}  # By camera, error messages of the files that could not be read
        self.joints: int | None = None  # Number of joints of each person; None before the first
        self._like = ""  # Where the number of joints comes from, for messages
        if skeleton is not None:
            self.joints, self._like = len(skeleton), f"of {skeleton.name}"
        # Number of joints with a negative or null confidence, and place of the first
        self._odd, self._first_odd = 0, ""

    def frame(self, camera: str, number: int) -> list[np.ndarray]:
        """Add a frame, maybe of nobody. Return its people, (J, 3) each: x, y in px and confidence; NaN where absent."""
        return self.views.setdefault(camera, {}).setdefault(number, [])

    def image(self, camera: str, place: str, about: dict) -> None:
        """Keep the `width` and `height` of an image, if it has both, as the size of its camera's images.

        Raises ValueError, with the place, if they are no whole numbers, or earlier ones of the camera are others.
        """
        if not {"width", "height"} <= set(about):
            return
        size = about["width"], about["height"]
        if not all(isinstance(length, int | float) and length > 0 and length % 1 == 0 for length in size):
            raise ValueError(f"{place}: expected positive whole width and height, found {size}")
        if (first := self.sizes.setdefault(camera, size)) != size:
            raise ValueError(f"{place}: expected images of {first} px as before of camera {camera!r}, found {size}")

    def add(self, camera: str, number: int, place: str, keypoints: object, scores: object = None) -> None:
        """Add a person to a frame.

        Raises ValueError if these are other values, impossible ones, or of another number of joints.

        Args:
            place: File and field of the keypoints, for messages.
            keypoints: x, y in px and confidence of each joint, in rows or one after the other.
            scores: Confidences, if they are apart.
        """
        rows = numbers_of(keypoints)
        rows = rows.reshape(-1, 3) if rows.ndim == 1 and rows.size % 3 == 0 else rows
        if scores is not None and rows.ndim == 2 and rows.shape[1] >= 2:
            apart = numbers_of(scores).reshape(-1, 1)
            if len(apart) != len(rows):
                raise ValueError(f"{place}: expected a confidence of each of {len(rows)} joints, found {scores!r:.60}")
            rows = np.concatenate([rows[:, :2], apart], -1)
        if rows.ndim != 2 or rows.shape[1] != 3:
            raise ValueError(
                f"{place}: expected x, y, confidence of each joint (1 if the detector states none), found "
                f"{keypoints!r:.60}"
            )
        check_numbers(place, rows, MOST_PIXELS)
        if not len(rows):
            return
        if self.joints is None:
            self.joints, self._like = len(rows), f"in {place}"
        if len(rows) != self.joints:
            raise ValueError(
                f"{place}: expected people of {self.joints} joints as {self._like}, found {len(rows)}; give "
                "data.skeleton=..., or keep recordings apart"
            )
        confidence = rows[:, 2]
        odd = np.isfinite(rows[:, :2]).all(-1) & ((confidence < 0) | np.isnan(confidence))
        if odd.any():
            self._odd, self._first_odd = self._odd + int(odd.sum()), self._first_odd or place
        rows = np.where((confidence > 0)[:, None] & rows[:, :2].any(1, keepdims=True), rows, np.nan)
        if not np.isnan(rows).all():
            self.frame(camera, number).append(rows)

    def __iter__(self) -> Iterator[np.ndarray]:
        """Yield the people of all frames, (J, 3) each."""
        return (person for view in self.views.values() for found in view.values() for person in found)

    def all(self) -> np.ndarray:
        """Return the people of all frames, (N, J, 3)."""
        people = list(self)
        return np.array(people).reshape(len(people), self.joints or 0, 3)

    def detections(self, skeleton: Skeleton, notes: tuple[str, ...] = (), **known) -> "NumberedDetections":
        """Return the people on a skeleton of J joints or fewer, the first ones; `known` are further fields of these."""
        kept, empty = len(skeleton), np.empty((0, len(skeleton), 3))
        views = {
            camera: {number: np.array(found)[:, :kept] if found else empty for number, found in view.items()}
            for camera, view in self.views.items()
        }
        if self.joints is not None and kept < self.joints:
            notes += (f"each person has {self.joints} points; the first {kept} are read, as {skeleton.name}",)
        if self._odd:
            joints, are = ("1 joint has", "is") if self._odd == 1 else (f"{self._odd} joints have", "are")
            what = f"a negative or null confidence and {are} treated as absent"
            notes += (f"{joints} {what}, first in {self._first_odd}",)
        return NumberedDetections(skeleton, views, unreadable=self.unreadable, notes=notes, sizes=self.sizes, **known)


_MAX_SPAN = 20
"""Largest number of frames between the first and last number of a recording, per frame with a file.

If it is larger, the numbers in the names of files are probably not frame numbers.
"""

_MAX_CELLS, _MAX_CELLS_EACH = 250_000, 50
"""Largest number of people times frames in an array: the first number, or the second number per detected person."""


@dataclass(frozen=True)
class NumberedDetections:
    """Detections of several cameras, as read from their files."""

    skeleton: Skeleton  # J joints
    # By camera and frame number, detections (D, J, 3): x, y px, confidence; NaN where absent
    views: dict[str, dict[int, np.ndarray]]
    fps: float | None = None  # Frames per second; None if the files do not state it
    # By camera, error messages of the files that could not be read
    unreadable: dict[str, list[str]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()  # Decisions of the reader that can be wrong
    # By camera, image width and height, px, if the files state them
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)
    rig: CameraRig | None = None  # The cameras, if the reader needs them to read the detections
    # By frame number, true positions (P, K, 3) m on `truth_skeleton`, P the same in all frames; None without truth
    truth: dict[int, np.ndarray] | None = None
    truth_skeleton: Skeleton | None = None

    @property
    def size(self) -> tuple[int, int] | None:
        """Image width and height of all cameras, px; None if they differ or the files do not state them."""
        sizes = set(self.sizes.values())
        return sizes.pop() if len(sizes) == 1 and set(self.sizes) == set(self.views) else None


def check_span(path: Path, numbers: Collection[int], files: int) -> None:
    """Raise ValueError, with the path, unless the numbers of a camera's files can be frame numbers."""
    if max(numbers) - min(numbers) >= _MAX_SPAN * files + 1000:
        raise ValueError(
            f"{path}: expected files numbered by frame, found {len(numbers)} that count from {min(numbers)} to "
            f"{max(numbers)}; name files <anything><frame number>.json"
        )


def to_clip(found: NumberedDetections, rig: CameraRig, fps: float, path: Path) -> Clip:
    """Return detections and cameras as a clip, from the first to the last frame that any camera has.

    Frames are aligned by number. If a camera lacks a frame, its detections in that frame are absent.
    `provenance["notes"]` contains the number of missing frames and all other notes.

    Args:
        rig: The cameras. Cameras without detections are left out.
        path: Path of the recording, for the id of the clip and for messages.

    Raises ValueError if cameras do not match, nothing could be read, or numbers in file names are not frame numbers.
    """
    if not found.views:
        raise ValueError(f"{path}: expected detections, found no frame of any camera")
    index, how = match_cameras(list(found.views), rig, path)
    numbers = [number for view in found.views.values() for number in view]
    for name, view in found.views.items():
        if not view:
            broken = found.unreadable.get(name, [])
            raise ValueError(
                f"{path}: camera {name!r} has no readable frame{': ' * bool(broken)}{'; '.join(broken[:1])}"
            )
    check_span(path, numbers, max(len(view) for view in found.views.values()))
    first, frames = min(numbers), max(numbers) - min(numbers) + 1
    for name, place in zip(found.views, index, strict=True):
        expected = tuple(rig.size[place].tolist())
        if found.sizes.get(name, expected) != expected:
            raise ValueError(
                f"{path}: camera {name!r}: expected images of {expected} px as its calibration says, found "
                f"{found.sizes[name]}; detect in images of the size that was calibrated"
            )
    order = np.argsort(index)
    names = [list(found.views)[i] for i in order]
    values = _stack([found.views[name] for name in names], first, frames, len(found.skeleton))
    notes = [how] if how else []
    notes += [*found.notes, *_absences(found, names, first, frames)]
    return Clip(
        id=path.resolve().stem,
        fps=fps,
        rig=rig[sorted(index)],
        detections=Detections2D(found.skeleton, values[..., :2], values[..., 2]),
        truth=_truth(found, first, frames),
        provenance={"path": str(path), "first_frame": first, "notes": notes},
    )


def _stack(views: list[dict[int, np.ndarray]], first: int, frames: int, joints: int) -> np.ndarray:
    """Return the detections of all views as one array (F, V, D, J, 3): x, y px, confidence; NaN where absent."""
    counts = [len(found) for view in views for found in view.values()]
    most = max(counts, default=0)
    _check_array_size("detections in one frame", frames * len(views) * most, most, sum(counts))
    values = np.full((frames, len(views), most, joints, 3), np.nan)
    for v, view in enumerate(views):
        for number, found in view.items():
            values[number - first, v, : len(found)] = found
    values[~np.isfinite(values).all(-1)] = np.nan
    return values


def _truth(found: NumberedDetections, first: int, frames: int) -> Poses3D | None:
    truth, skeleton = found.truth, found.truth_skeleton
    if truth is None or skeleton is None:
        return None
    counts = [len(people) for people in truth.values()]
    persons = max(counts, default=0)
    _check_array_size("true persons", frames * persons, persons, sum(counts))
    xyz = np.full((frames, persons, len(skeleton), 3), np.nan)
    for number, people in truth.items():
        if first <= number < first + frames:
            xyz[number - first] = people
    return Poses3D(skeleton, xyz)


def _check_array_size(what: str, cells: int, most: int, total: int) -> None:
    """Raise ValueError if the array would be too large because one frame contains far more people than the others."""
    if cells > max(_MAX_CELLS, _MAX_CELLS_EACH * total):
        raise ValueError(f"found {most} {what}, and {total} in all frames, which span too many")


def _absences(found: NumberedDetections, names: list[str], first: int, frames: int) -> list[str]:
    notes = []
    for name in names:
        absent, broken = frames - len(found.views[name]), found.unreadable.get(name, [])
        if absent or broken:
            note = f"{camera_label(name)}: {absent} of frames {first} to {first + frames - 1} are absent"
            notes.append(note + (f"; {len(broken)} files could not be read, first {broken[0]}" if broken else ""))
    return notes


def csv_rows(file: Path, lines: Sequence[list[str]], columns: int, first: int) -> np.ndarray:
    """Return the numbers (n, columns) in the cells of n lines; NaN where a cell is empty.

    Raises ValueError, with the file and the line counted from `first`, if a line has other cells, or a cell is no
    number.
    """
    rows = np.full((len(lines), columns), np.nan)
    for number, cells in enumerate(lines):
        if len(cells) != columns:
            raise ValueError(f"{file}, line {number + first}: expected {columns} cells, found {len(cells)}")
        try:
            rows[number] = [float(cell) if cell.strip() else np.nan for cell in cells]
        except ValueError as error:
            raise ValueError(f"{file}, line {number + first}: expected numbers, {error}") from None
    return rows
