"""Verify clips and data sets: files, numbers, labels, images, and their consistency."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from dmae.data.clip import Clip
from dmae.data.store import CHECKSUMS, MANIFEST, load_clip, read_manifest
from dmae.files.checksums import find_damage, find_data_set_damage, number_of
from dmae.files.structured import read_json
from dmae.progress import progress
from synth.datasets.checks import check_detections, check_labels, check_numbers, check_projection
from synth.datasets.clip import attempt_seed
from synth.datasets.images.clip_images import image_kinds
from synth.datasets.images.image_checks import check_images, check_surplus
from synth.datasets.set_folder import CONFIG

DATA_SET = "data set"
"""Name used in place of a clip for problems of the whole data set."""


class Problem(NamedTuple):
    """A problem: the folder name of its clip, or "data set"; the check of `CHECKS` that found it; and a description."""

    clip: str
    check: str
    what: str


class Verification(NamedTuple):
    """The result of a verification.

    Attributes:
        clips: Names of the checked folders.
        problems: All problems.
        again: Names of the clips that must be generated again.
        number: One checksum of all files: the SHA-256 of `checksums.json`; None if there is no such file.
        without: Names of the clips without checksums. In these, only changes that cause a contradiction are found.
    """

    clips: list[str]
    problems: list[Problem]
    again: list[str]
    number: str | None
    without: list[str]


def verify(path: Path, *, fast: bool = False) -> Verification:
    """Check a clip, or all clips of a data set and its manifest.

    Args:
        path: The clip or data set.
        fast: Compare only the sizes of files, and the contents of JSON files with their checksums.

    Raises:
        FileNotFoundError: the path is neither a clip nor a data set.
    """
    path = Path(path)
    if (path / "clip.json").is_file() or (_is_clip(path) and not (path / MANIFEST).is_file()):
        return _result(path.parent, [path.name], verify_clip(path, fast=fast)[1], number_of(path))
    if not (path / MANIFEST).is_file() and not (path / CHECKSUMS).is_file():
        raise FileNotFoundError(f"{path}: expected a clip (clip.json) or a data set ({MANIFEST}), found neither")
    lines, problems = _manifest(path)
    config, found = _config(path)
    names = [line["id"] for line in lines if line["status"] == "ok"]
    problems += found + [
        Problem(clip or DATA_SET, "checksums", what) for clip, what in find_data_set_damage(path, names)
    ]
    problems += [Problem(DATA_SET, "manifest", what) for what in _check_data_set(path, lines)]
    lost = {problem.clip for problem in problems}
    for line in progress(lines, "verifying clips", len(lines)):
        # Clips with known damage are not read.
        if line["status"] != "ok" or line["id"] in lost:
            continue
        clip, found = verify_clip(path / line["id"], fast=fast)
        problems += found
        if clip is not None:
            problems += [
                Problem(line["id"], "manifest", what)
                for what in _guarded("clip.json", lambda: _check_line(clip, line, config))  # noqa: B023
            ]
    return _result(path, names, problems, number_of(path))


def verify_clip(folder: Path, *, fast: bool = False) -> tuple[Clip | None, list[Problem]]:
    """Return a clip and its problems. The clip is None if it was not read."""
    damage = find_damage(folder, fast=fast)
    if damage:
        # All further problems would be consequences of the damage.
        return None, [Problem(folder.name, "checksums", what) for what in damage]
    if fast and ((folder / CHECKSUMS).is_file()):
        return None, []
    try:
        clip = load_clip(folder)
    except (FileNotFoundError, ValueError) as error:
        return None, [Problem(folder.name, "files", str(error))]
    except Exception as error:
        return None, [Problem(folder.name, "files", _error_text(folder / "clip.json", error))]
    if fast:
        return None, []
    problems = []
    for check, find in _OF_A_CLIP.items():
        problems += [Problem(folder.name, check, what) for what in _guarded("clip.json", lambda: find(clip))]  # noqa: B023
    if clip.images and clip.images.folder.resolve().is_relative_to(folder.resolve()):
        # A clip may also refer to some frames of another clip.
        problems += [Problem(folder.name, "images", what) for what in check_surplus(clip)]
    return clip, problems


def _is_clip(path: Path) -> bool:
    return (path / "arrays.safetensors").is_file()


def _result(path: Path, names: list[str], problems: list[Problem], number: str | None) -> Verification:
    again = sorted({problem.clip for problem in problems} - {DATA_SET})
    without = [name for name in names if not (path / name / CHECKSUMS).is_file() and name not in again]
    return Verification(names, problems, again, number, without)


def _guarded(name: str, check: Callable[[], list[str]]) -> list[str]:
    """Return the problems that a check finds. Damaged files can cause any error, so each error is a problem as well."""
    try:
        return check()
    except Exception as error:
        return [_error_text(name, error)]


def _error_text(name: object, error: Exception) -> str:
    """Return the description of an error that a file caused: a missing key, or a value of another kind."""
    lacks = isinstance(error, KeyError) and error.args
    what = f"lacks {error.args[0]!r}" if lacks else f"holds what cannot be read, {type(error).__name__}: {error}"
    return f"{name}: {what}; check keys and values for typing errors"


def _manifest(path: Path) -> tuple[list[dict], list[Problem]]:
    """Return the lines of a manifest and its problems. If it is damaged, lines are made from the folders of clips."""
    try:
        lines = read_manifest(path)
        for line in lines:
            if not isinstance(line["id"], str) or Path(line["id"]).name != line["id"]:
                raise ValueError(f"{path / MANIFEST}: expected the name of a folder as id, found {line['id']!r}")
        return lines, []
    except (ValueError, OSError) as error:
        there = [{"id": folder.parent.name, "status": "ok"} for folder in sorted(path.glob("*/clip.json"))]
        return there, [Problem(DATA_SET, "manifest", f"{error}; the clips are checked without it")]


def _config(path: Path) -> tuple[dict | None, list[Problem]]:
    """Return the configuration of a data set and its problems. It is None if there is no usable configuration."""
    if not (path / CONFIG).is_file():
        return None, []
    try:
        config = read_json(path / CONFIG)
        image_kinds(config["images"]), config["scene"]["fps"], config["seed"] + 0
    except Exception as error:
        what = str(error) if isinstance(error, ValueError) else _error_text(path / CONFIG, error)
        return None, [Problem(DATA_SET, "manifest", what)]
    return config, []


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
        # This is a captured clip. Its data set has a manifest and a configuration of another kind.
        return problems
    own = clip.provenance.get("manifest", line)
    if line.keys() == {"id", "status"}:
        # The manifest could not be read.
        line = own
    problems += [
        f"{key}: {line.get(key)!r} in {MANIFEST}, {own.get(key)!r} in clip.json"
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
    if {"seed", "attempts"} <= line.keys() and line["seed"] != (
        seed := attempt_seed(config["seed"], line["attempts"] - 1)
    ):
        problems.append(f"seed: {line['seed']}, and attempt {line['attempts']} with that of {CONFIG} has {seed}")
    return problems


_OF_A_CLIP: dict[str, Callable[[Clip], list[str]]] = {
    "numbers": check_numbers,
    "labels": check_labels,
    "projection": check_projection,
    "detections": check_detections,
    "images": check_images,
}
CHECKS = {
    "checksums": "all files as they were written, no others",
    "files": "exist, undamaged, of matching shapes",
    "numbers": "finite; points whole or NaN",
    "labels": "codes and occluders that exist and match",
    "projection": "visibility matches the projections of joints",
    "detections": "in the image, near their person",
    "images": "exist, no others do, readable, of the right size, as labelled",
    "manifest": "lists the clips that exist, as they are",
}
"""The checks, in the order of printing, and what each requires."""
