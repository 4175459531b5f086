"""Verify clips and data sets: files, numbers, labels, images, and their consistency."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from dmae.data.clip import Clip
from dmae.data.store import MANIFEST, load_clip, read_manifest
from dmae.files.structured import read_json
from dmae.progress import progress
from synth.datasets.checks import check_detections, check_labels, check_numbers, check_projection
from synth.datasets.images.clip_images import image_kinds
from synth.datasets.images.image_checks import check_images, check_surplus
from synth.datasets.set_folder import CONFIG

_DATA_SET = "data set"


class Problem(NamedTuple):
    """A problem: the folder name of its clip, or "data set"; the check of `CHECKS` that found it; and a description."""

    clip: str
    check: str
    what: str


def verify(path: Path) -> tuple[list[str], list[Problem]]:
    """Check a clip, or all clips of a data set and its manifest.

    Returns:
        clips: Names of the folders checked.
        problems: All problems found.

    Raises:
        FileNotFoundError: the path is neither a clip nor a data set.
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
    """Return a clip, None where it cannot be read, and its problems."""
    try:
        clip = load_clip(folder)
    except (FileNotFoundError, ValueError) as error:
        return None, [Problem(folder.name, "files", str(error))]
    problems = []
    for check, find in _OF_A_CLIP.items():
        problems += [Problem(folder.name, check, what) for what in find(clip)]
    if clip.images and clip.images.folder.resolve().is_relative_to(folder.resolve()):
        # A clip may also refer to some of the frames of another one.
        problems += [Problem(folder.name, "images", what) for what in check_surplus(clip)]
    return clip, problems


def _check_data_set(path: Path, lines: list[dict]) -> list[str]:
    """Compare the manifest with the folders."""
    names = [line["id"] for line in lines]
    problems = [f"{MANIFEST}: clip {name} is listed twice" for name in sorted(set(names)) if names.count(name) > 1]
    made = {line["id"] for line in lines if line["status"] == "ok"}
    there = {folder.parent.name for folder in path.glob("*/clip.json")}
    problems += [f"{name}: a clip that is not ok in {MANIFEST}" for name in sorted(there - made)]
    problems += [
        f"{MANIFEST}: clip {line['id']} has status {line['status']!r} and no reason"
        for line in lines
        if line["status"] != "ok" and not line.get("reason")
    ]
    return problems


def _check_line(clip: Clip, line: dict, config: dict | None) -> list[str]:
    """Compare a clip with its line of the manifest, and with the configuration of the data set."""
    problems = [] if clip.id == line["id"] else [f"its id in clip.json is {clip.id!r}"]
    if clip.poses is not None:
        # A captured clip: its data set has a manifest and a configuration of another kind.
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
    try:
        fps, kinds = config["scene"]["fps"], image_kinds(config["images"])
    except (KeyError, TypeError, ValueError):
        return [*problems, f"{CONFIG}: expected the configuration of a data set, found {config!r:.60}"]
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
    "files": "exist, undamaged, of matching shapes",
    "numbers": "finite; points whole or NaN",
    "labels": "codes and occluders that exist and match",
    "projection": "visibility matches the projections of joints",
    "detections": "in the image, near their person",
    "images": "exist, no others do, readable, of the right size, as labelled",
    "manifest": "lists the clips that exist, as they are",
}
"""The checks, in the order of printing, and what each requires."""
