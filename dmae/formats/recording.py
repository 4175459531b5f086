"""Detections of several cameras, as their files number the frames and name the cameras, put together to a clip."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dmae.cameras import CameraRig
from dmae.clip import Clip, Detections2D, Poses3D
from dmae.skeleton import Skeleton

_MOST_GAPS = 20
"""Frames a recording may span for each frame there is: beyond that the numbers count something else."""


@dataclass(frozen=True)
class Recording:
    """What the files of detections say.

    Attributes:
        skeleton: J joints.
        views: Of each camera, by frame number, its detections (D, J, 3): x, y px, confidence; NaN where absent.
        fps: Frames per second, None where the files do not say.
        unreadable: Of each camera, what is wrong with the files that could not be read.
        notes: What was decided in reading and can be wrong.
        sizes: Image width and height of cameras, px, where the files say.
    """

    skeleton: Skeleton
    views: dict[str, dict[int, np.ndarray]]
    fps: float | None = None
    unreadable: dict[str, list[str]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    sizes: dict[str, tuple[int, int]] = field(default_factory=dict)

    @property
    def size(self) -> tuple[int, int] | None:
        """That of all cameras, None where they differ or the files do not say."""
        sizes = set(self.sizes.values())
        return sizes.pop() if len(sizes) == 1 and set(self.sizes) == set(self.views) else None


def to_clip(
    recording: Recording,
    rig: CameraRig,
    fps: float,
    path: Path,
    truth: dict[int, np.ndarray] | None = None,
    truth_skeleton: Skeleton | None = None,
) -> Clip:
    """Detections and cameras as a clip from the first to the last frame that any camera has.

    Frames are aligned by number; a camera that lacks one is blind in it. What is absent is counted in
    `provenance["notes"]`, with whatever else the user should know.

    Args:
        rig: The cameras, and maybe more: those without detections are left out.
        truth: By frame number, (P, K, 3) m; P is the same in all.

    Raises:
        ValueError: cameras do not fit together, nothing could be read, or frame numbers are no counters.
    """
    index, how = match_cameras(list(recording.views), rig, path)
    numbers = [number for view in recording.views.values() for number in view]
    for name, view in recording.views.items():
        if not view:
            broken = recording.unreadable.get(name, [])
            raise ValueError(
                f"{path}: camera {name!r} has no readable frame{': ' * bool(broken)}{'; '.join(broken[:1])}"
            )
    first, frames = min(numbers), max(numbers) - min(numbers) + 1
    if frames > _MOST_GAPS * max(len(view) for view in recording.views.values()) + 1000:
        raise ValueError(
            f"{path}: expected files numbered by frame, found {len(numbers)} that count from {first} to "
            f"{max(numbers)}; name files of detections <anything><frame number>.json"
        )
    for name, view in zip(recording.views, index, strict=True):
        expected = tuple(rig.size[view].tolist())
        if recording.sizes.get(name, expected) != expected:
            raise ValueError(
                f"{path}: camera {name!r}: expected images of {expected} px as its calibration says, found "
                f"{recording.sizes[name]}; detect in images of the size that was calibrated"
            )
    order = np.argsort(index)
    names = [list(recording.views)[i] for i in order]
    values = _stack([recording.views[name] for name in names], first, frames, len(recording.skeleton))
    notes = [how] if how else []
    notes += [*recording.notes, *_absences(recording, names, first, frames)]
    return Clip(
        id=path.resolve().stem,
        fps=fps,
        rig=rig[sorted(index)],
        detections=Detections2D(recording.skeleton, values[..., :2], values[..., 2]),
        truth=None if truth is None else _truth(truth, truth_skeleton, first, frames),
        provenance={"path": str(path), "first_frame": first, "notes": notes},
    )


def _stack(views: list[dict[int, np.ndarray]], first: int, frames: int, joints: int) -> np.ndarray:
    """(F, V, D, J, 3)."""
    most = max((len(found) for view in views for found in view.values()), default=0)
    values = np.full((frames, len(views), most, joints, 3), np.nan)
    for v, view in enumerate(views):
        for number, found in view.items():
            values[number - first, v, : len(found)] = found
    values[~np.isfinite(values).all(-1)] = np.nan
    return values


def _truth(truth: dict[int, np.ndarray], skeleton: Skeleton, first: int, frames: int) -> Poses3D:
    persons = max((len(found) for found in truth.values()), default=0)
    xyz = np.full((frames, persons, len(skeleton), 3), np.nan)
    for number, found in truth.items():
        if first <= number < first + frames:
            xyz[number - first] = found
    return Poses3D(skeleton, xyz)


def _absences(recording: Recording, names: list[str], first: int, frames: int) -> list[str]:
    notes = []
    for name in names:
        absent, broken = frames - len(recording.views[name]), recording.unreadable.get(name, [])
        if absent or broken:
            note = f"camera {name}: {absent} of frames {first} to {first + frames - 1} are absent"
            notes.append(note + (f"; {len(broken)} files could not be read, first {broken[0]}" if broken else ""))
    return notes


def match_cameras(names: Sequence[str], rig: CameraRig, path: Path) -> tuple[list[int], str | None]:
    """Which camera of a rig each camera of the detections is.

    They match by name, but for case and punctuation; or by the last number in it; or, where there are no
    numbers, in order. Of these only the first allows the rig to have more cameras.

    Returns:
        index: Into the rig, one for each name.
        note: How they match where it is not by name, and which cameras are left out.

    Raises:
        ValueError: they do not; the message has both lists.
    """
    calibrated, found = [_plain(name) for name in rig.names], [_plain(name) for name in names]
    both = f"detections of {', '.join(names)} and calibration of {', '.join(rig.names)}"
    if len(set(found)) < len(found) or len(set(calibrated)) < len(calibrated):
        raise ValueError(f"{path}: expected different cameras, found {both}")
    if set(found) <= set(calibrated):
        spare = [name for name, plain in zip(rig.names, calibrated, strict=True) if plain not in found]
        note = f"{len(spare)} calibrated cameras have no detections and are left out: {', '.join(spare[:5])}"
        return [calibrated.index(name) for name in found], note if spare else None
    if set(found) & set(calibrated) or len(names) != len(rig):
        lacking = [name for name, plain in zip(names, found, strict=True) if plain not in calibrated]
        raise ValueError(
            f"{path}: expected a calibration of each camera that has detections, found {both}: {', '.join(lacking)} "
            "has none; name the cameras alike, or name other files by data.calibration=... or data.detections=..."
        )
    numbers = [[_number(name) for name in part] for part in (names, rig.names)]
    ranks, how = [_ranks([natural(name) for name in part]) for part in (names, rig.names)], "in order of their names"
    if all(None not in part and len(set(part)) == len(part) for part in numbers):
        steps = {a - b for a, b in zip(*map(sorted, numbers), strict=True)}
        if len(steps) > 1:
            raise ValueError(f"{path}: expected cameras numbered alike, found {both}")
        ranks, how = [_ranks(part) for part in numbers], "by number" if steps == {0} else "in order of their numbers"
    index = [ranks[1].index(rank) for rank in ranks[0]]
    pairs = ", ".join(f"{name} = {rig.names[i]}" for name, i in zip(names, index, strict=True))
    return index, f"cameras of detections and calibration are matched {how}: {pairs}"


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _number(name: str) -> int | None:
    digits = re.findall(r"\d+", name)
    return int(digits[-1]) if digits else None


def natural(name: str) -> list:
    """Sorting by this puts cam2 before cam10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _ranks(keys: list) -> list[int]:
    """The place of each in their order."""
    return [sorted(keys).index(key) for key in keys]


def frame_number(path: Path, stem: str) -> int:
    """The last number in the name of a file.

    Raises:
        ValueError: there is none.
    """
    number = _number(stem)
    if number is None:
        raise ValueError(f"{path}: expected a file name that ends in the frame number")
    return number
