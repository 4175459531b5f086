"""Match the cameras of detections to calibrated cameras, by name, number or order."""

import re
from collections.abc import Sequence
from pathlib import Path

from dmae.data.cameras import CameraRig

_OPTIONS = "data.calibration=... or data.detections=..."


def match_cameras(
    names: Sequence[str], rig: CameraRig, path: Path, what: str = "detections", options: str = _OPTIONS
) -> tuple[list[int], str | None]:
    """Match the cameras of detections to the cameras of a rig.

    Cameras are matched by name, ignoring case and punctuation; or else by the last number in the name; or else, if
    names have no numbers, by order. The rig may contain further cameras only if the cameras match by name.

    Args:
        names: Names of the cameras of the detections.
        rig: Calibrated cameras.
        path: Path of the recording, for messages.
        what: The data of the cameras with these names, "detections" for example, for messages.
        options: Options by which the user can give other files, for messages.

    Returns:
        index: Index of a camera in the rig, one for each name.
        note: How cameras were matched if not by name, and the calibrated cameras that are left out; None if neither
            applies.

    Raises:
        ValueError: the cameras do not match; the message lists both.
    """
    calibrated, found = [_plain(name) for name in rig.names], [_plain(name) for name in names]
    both = f"{what} of {', '.join(names)} and calibration of {', '.join(rig.names)}"
    if len(set(found)) < len(found) or len(set(calibrated)) < len(calibrated):
        raise ValueError(f"{path}: expected different cameras, found {both}")
    if set(found) <= set(calibrated):
        spare = [name for name, plain in zip(rig.names, calibrated, strict=True) if plain not in found]
        note = f"{len(spare)} calibrated cameras have no {what} and are left out: {', '.join(spare[:5])}"
        return [calibrated.index(name) for name in found], note if spare else None
    if set(found) & set(calibrated) or len(names) != len(rig):
        lacking = [name for name, plain in zip(names, found, strict=True) if plain not in calibrated]
        raise ValueError(
            f"{path}: expected a calibration of each camera that has {what}, found {both}: {', '.join(lacking)} "
            f"has none; give the cameras the same names, or name other files by {options}"
        )
    numbers = [[_number(name) for name in part] for part in (names, rig.names)]
    ranks, how = [_ranks([natural(name) for name in part]) for part in (names, rig.names)], "in order of their names"
    if all(None not in part and len(set(part)) == len(part) for part in numbers):
        steps = {a - b for a, b in zip(*map(sorted, numbers), strict=True)}
        if len(steps) > 1:
            raise ValueError(f"{path}: expected cameras with the same numbers, found {both}")
        ranks, how = [_ranks(part) for part in numbers], "by number" if steps == {0} else "in order of their numbers"
    index = [ranks[1].index(rank) for rank in ranks[0]]
    pairs = ", ".join(f"{name} = {rig.names[i]}" for name, i in zip(names, index, strict=True))
    return index, f"cameras of {what} and calibration are matched {how}: {pairs}"


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _number(name: str) -> int | None:
    digits = re.findall(r"\d+", name)
    return int(digits[-1]) if digits else None


def natural(name: str) -> list:
    """Return a sort key by which cam2 comes before cam10."""
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", name)]


def _ranks(keys: list) -> list[int]:
    """Return the rank of each key."""
    return [sorted(keys).index(key) for key in keys]


def frame_number(path: Path, stem: str) -> int:
    """Return the last number in the name of a file.

    Raises:
        ValueError: the name contains no number.
    """
    number = _number(stem)
    if number is None:
        raise ValueError(f"{path}: expected a file name that ends in the frame number")
    return number
