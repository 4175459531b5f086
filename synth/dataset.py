"""Data sets of clips: many of them in parallel, resumably, and their manifest."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import asdict
from enum import Enum
from pathlib import Path

from joblib import Parallel, delayed

from dmae.progress import progress
from dmae.store import MANIFEST, load_clip, read_json, read_manifest, save_clip, write_atomic, write_manifest
from synth.generate import GenerateConfig, ImageKinds, attempt_seed, check, clip_id, generate_clip
from synth.quality import FailedSimulation
from synth.render import find_backend

CONFIG = "config.json"
_WHERE_AND_HOW_MANY = ("out", "clips", "workers")
"""What may differ when a data set is continued."""


def generate(config: GenerateConfig) -> list[dict]:
    """Make a data set, or what is still missing of it, and its manifest.

    Clips that are already there and whole are kept. Each appears under its name once it is complete, so that a run
    may be broken off at any time and begun again.

    Returns:
        The manifest's lines, one a clip: `id`, `status` ("ok" or "failed"), `seed` it was drawn with, `attempts` it
        took; and of those that are ok `frames`, `persons`, `quality` (`synth.quality.Quality`) and `occlusion`, see
        `synth.occlusion.summary`; with `rig.error` also `calibration_error`, by how many pixels
        the calibration misplaces what each camera sees; of those that failed the `reason`.

    Raises:
        ValueError: the folder holds a data set of another configuration, or the configuration cannot be met.
        FailedSimulation: not one clip could be made, or `occlusion.target` is out of reach.
    """
    out = Path(config.out)
    check(config)
    _claim(out, config)
    if config.images != ImageKinds.none:
        find_backend()
    lines = {line["id"]: line for line in read_manifest(out)} if (out / MANIFEST).is_file() else {}
    try:
        for line in progress(_make_all(config), "generating clips", config.clips):
            lines[line["id"]] = line
    finally:
        write_manifest(out, list(lines.values()))
    if all(line["status"] == "failed" for line in lines.values()):
        reason = next(iter(lines.values()))["reason"]
        raise FailedSimulation(f"{out}: all {len(lines)} clips failed, the first because of this: {reason}")
    return read_manifest(out)


def _claim(out: Path, config: GenerateConfig) -> None:
    """Write the resolved configuration, or make sure that it is the one already there."""
    found, wanted = out / CONFIG, _settings(config)
    if not found.is_file():
        write_atomic(found, json.dumps(wanted, indent=1))
        return
    other = dict(_leaves(read_json(found)))
    changed = sorted(key for key, value in _leaves(wanted) if other.get(key) != value or key not in other)
    changed += sorted(set(other) - {key for key, _ in _leaves(wanted)})
    if changed:
        raise ValueError(
            f"{out} holds a data set made with another configuration: {', '.join(changed)} differ from {found}. "
            "Choose another out, or remove the folder"
        )


def _settings(config: GenerateConfig) -> dict:
    """All that the clips depend on, as JSON has it."""

    def plain(value):
        return value.name if isinstance(value, Enum) else str(value)

    settings = {name: value for name, value in asdict(config).items() if name not in _WHERE_AND_HOW_MANY}
    return json.loads(json.dumps(settings, default=plain))


def _leaves(settings, prefix: str = "") -> Iterator[tuple[str, object]]:
    """(dotted name, value) of all that is no dictionary."""
    for key, value in settings.items():
        if isinstance(value, dict) and value:
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def _make_all(config: GenerateConfig) -> Iterator[dict]:
    """Manifest lines in whatever order the clips are ready."""
    tasks = (delayed(_make)(config, index) for index in range(config.clips))
    return Parallel(n_jobs=config.workers, return_as="generator_unordered")(tasks)


def _make(config: GenerateConfig, index: int) -> dict:
    """Make one clip on disk unless it is there; its manifest line."""
    folder = Path(config.out) / clip_id(index)
    kept = _kept(folder)
    if kept is not None:
        return kept
    partial = folder.with_name(f".{folder.name}.partial")
    for leftover in (partial, folder):
        shutil.rmtree(leftover, ignore_errors=True)
    try:
        clip = generate_clip(config, index, images=partial / "images")
        save_clip(clip, partial)
        partial.rename(folder)
    except FailedSimulation as failure:
        seed = attempt_seed(config.seed, config.retries)
        return {
            "id": folder.name, "status": "failed", "seed": seed, "attempts": config.retries + 1, "reason": str(failure)
        }  # fmt: skip
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return clip.provenance["manifest"]


def _kept(folder: Path) -> dict | None:
    """The manifest line of a clip that is there and undamaged."""
    try:
        return load_clip(folder).provenance["manifest"]
    except (FileNotFoundError, ValueError):
        return None
