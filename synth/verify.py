"""Whether clips and data sets are whole and true: files, numbers, labels, images and what they say of each other."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from dmae.clip import Clip
from dmae.progress import progress
from dmae.store import MANIFEST, load_clip, read_json, read_manifest, write_atomic
from dmae.tables import Table, print_tables
from synth.checks import (
    check_detections,
    check_images,
    check_labels,
    check_numbers,
    check_projection,
    check_surplus,
)
from synth.dataset import CONFIG
from synth.generate import ImageKinds

_DATA_SET = "data set"


class Problem(NamedTuple):
    """What is wrong: with which clip (its folder's name, or "data set"), found by which check of `CHECKS`, and how."""

    clip: str
    check: str
    what: str


@dataclass(frozen=True)
class VerifyConfig:
    """`synth verify`.

    Attributes:
        path: A clip, or a data set.
        out: JSON file that takes what was found.
    """

    path: str = "???"
    out: str = "runs/verify.json"


def run_verify(config: VerifyConfig, out: Path) -> None:
    """Print how many clips fail each check, write what is wrong to `out`; ValueError if anything is."""
    clips, problems = verify(Path(config.path))
    write_atomic(out, json.dumps({"clips": clips, "problems": [p._asdict() for p in problems]}, indent=1))
    rows = []
    for check, meaning in CHECKS.items():
        failing = sorted({problem.clip for problem in problems if problem.check == check})
        some = ", ".join(failing[:3]) + (", ..." if len(failing) > 3 else "")
        rows.append((f"{check}: {meaning}", str(len(failing)), some or "-"))
    print_tables([Table(f"{config.path}: {len(clips)} clips", ("check", "fail", "which"), rows)])
    for clip, check, what in problems[:_SHOWN]:
        print(f"{clip}: {check}: {what}")
    if problems:
        more = f"; {len(problems) - _SHOWN} more of them are in {out}" if len(problems) > _SHOWN else ""
        failing = len({problem.clip for problem in problems})
        raise ValueError(f"{config.path}: {len(problems)} problems in {failing} of {len(clips)} clips{more}")


_SHOWN = 20
"""So many problems are printed; all are written."""


def verify(path: Path) -> tuple[list[str], list[Problem]]:
    """Check a clip, or all clips of a data set and its manifest.

    Returns:
        clips: Names of the folders looked at.
        problems: All that is wrong; none if nothing is.

    Raises:
        FileNotFoundError: neither a clip nor a data set is there.
    """
    path = Path(path)
    if (path / "clip.json").is_file():
        return [path.name], verify_clip(path)[1]
    if not (path / MANIFEST).is_file():
        raise FileNotFoundError(f"{path}: expected a clip (clip.json) or a data set ({MANIFEST}), found neither")
    try:
        lines = read_manifest(path)
        config = read_json(path / CONFIG) if (path / CONFIG).is_file() else None
    except ValueError as error:
        return [], [Problem(_DATA_SET, "manifest", str(error))]
    problems = [Problem(_DATA_SET, "manifest", what) for what in _check_data_set(path, lines)]
    made = [line for line in lines if line["status"] == "ok"]
    for line in progress(made, "verifying clips", len(made)):
        clip, found = verify_clip(path / line["id"])
        problems += found
        if clip is not None:
            problems += [Problem(line["id"], "manifest", what) for what in _check_line(clip, line, config)]
    return [line["id"] for line in made], problems


def verify_clip(folder: Path) -> tuple[Clip | None, list[Problem]]:
    """A clip, None where it cannot be read, and what is wrong with it."""
    try:
        clip = load_clip(folder)
    except (FileNotFoundError, ValueError) as error:
        return None, [Problem(folder.name, "files", str(error))]
    problems = []
    for check, find in _OF_A_CLIP.items():
        problems += [Problem(folder.name, check, what) for what in find(clip)]
    if clip.images and clip.images.folder.resolve().is_relative_to(folder.resolve()):
        # Clips may also point to some of another one's frames.
        problems += [Problem(folder.name, "images", what) for what in check_surplus(clip)]
    return clip, problems


def _check_data_set(path: Path, lines: list[dict]) -> list[str]:
    """The manifest against the folders."""
    names = [line["id"] for line in lines]
    problems = [f"{MANIFEST}: clip {name} is listed twice" for name in sorted(set(names)) if names.count(name) > 1]
    made = {line["id"] for line in lines if line["status"] == "ok"}
    there = {folder.parent.name for folder in path.glob("*/clip.json")}
    problems += [f"{name}: a clip that {MANIFEST} does not call ok" for name in sorted(there - made)]
    problems += [
        f"{MANIFEST}: clip {line['id']} has status {line['status']!r} and no reason"
        for line in lines
        if line["status"] != "ok" and not line.get("reason")
    ]
    return problems


def _check_line(clip: Clip, line: dict, config: dict | None) -> list[str]:
    """A clip against its line in the manifest, and against the configuration it was made with."""
    problems = [] if clip.id == line["id"] else [f"clip.json calls it {clip.id!r}"]
    if clip.poses is not None:
        # Captured since: its data set has a manifest and a configuration of another kind.
        return problems
    own = clip.provenance.get("manifest", line)
    problems += [
        f"{key}: {line.get(key)!r} in {MANIFEST}, {own.get(key)!r} in the clip"
        for key in sorted({*line, *own})
        if line.get(key) != own.get(key)
    ]
    expected = {"frames": len(clip)} | ({} if clip.truth is None else {"persons": clip.truth.xyz.shape[1]})
    problems += [
        f"{key}: {line[key]} in {MANIFEST}, {found} in the arrays"
        for key, found in expected.items()
        if line.get(key, found) != found
    ]
    if config is None:
        return problems
    fps, kinds = config["scene"]["fps"], ImageKinds[config["images"]].value
    if clip.fps != fps:
        problems.append(f"fps: {fps} in {CONFIG}, {clip.fps} in the clip")
    found = clip.images.kinds if clip.images else ()
    if found != kinds:
        problems.append(f"images: {kinds} in {CONFIG}, {found} in the clip")
    return problems


_OF_A_CLIP: dict[str, Callable[[Clip], list[str]]] = {
    "numbers": check_numbers,
    "labels": check_labels,
    "projection": check_projection,
    "detections": check_detections,
    "images": check_images,
}
CHECKS = {
    "files": "there, undamaged, of fitting shapes",
    "numbers": "finite; points whole or NaN",
    "labels": "codes and causes that exist and go together",
    "projection": "visibility is where the cameras project joints",
    "detections": "in the image, about where their person is",
    "images": "there and no others, readable, of the right size, and as labelled",
    "manifest": "lists the clips that are there, as they are",
}
"""The checks, in the order of their printing, and what each asks."""
