"""Generate data sets: many clips in parallel, resumably, and their manifest."""

import json
import shutil
from collections.abc import Iterator
from dataclasses import asdict
from enum import Enum
from pathlib import Path

from dmae.data.resume import claim_folder
from dmae.data.store import MANIFEST, load_clip, read_manifest, save_clip, write_manifest
from dmae.files.checksums import Checksum, begin_data_set, clip_checksum, end_data_set, find_damage, write_checksums
from dmae.parallel import in_parallel
from dmae.progress import progress
from synth.datasets.clip import GenerateConfig, ImageKinds, attempt_seed, check, clip_id, generate_clip
from synth.datasets.image_checks import missing_files
from synth.datasets.parts.shards import SHARD, claim_shard
from synth.errors import FailedSimulation
from synth.rendering.backend import find_backend

CONFIG = "config.json"
_NOT_COMPARED = ("out", "first", "clips", "shard", "workers", "recheck")
"""Options that may differ when a data set is continued."""


def generate(config: GenerateConfig) -> list[dict]:
    """Make a data set, or its missing clips, its manifest and its checksums.

    Clips that exist and are undamaged are kept: sizes of files are compared, and the contents of labels; with `recheck`
    the contents of images, too. A clip appears under its name once it is complete, so that a run can be
    interrupted at any time and resumed.

    Returns:
        The lines of the manifest, one a clip: `id`, `status` ("ok" or "failed"), `seed`, number of `attempts`; of clips
        that are ok `frames`, `persons`, `quality` (`synth.physics.quality.SimulationQuality`) and
        `occlusion`, see `synth.datasets.occlusion.summary`; with `rig.error` also `calibration_error`,
        the error of projections by the calibration of each camera, px; of clips that failed the `reason`.

    Raises:
        ValueError: the folder holds a data set of another configuration, or the configuration cannot be met.
        FailedSimulation: not one clip could be made, or `occlusion.target` is out of reach.
    """
    out = Path(config.out)
    check(config)
    claim_shard(out, config.first, config.clips, config.shard)
    claim_folder(out / CONFIG, _settings(config), "a data set")
    if config.images != ImageKinds.none:
        find_backend()
    lines = {line["id"]: line for line in read_manifest(out)} if (out / MANIFEST).is_file() else {}
    checksums = begin_data_set(out)
    try:
        for line in progress(_make_all(config, checksums), "generating clips", len(config.numbers)):
            lines[line["id"]] = line
            checksums[line["id"]] = clip_checksum(out / line["id"])
    finally:
        # Processes that were ended in the middle of a clip leave it behind.
        for partial in out.glob(".*.partial"):
            shutil.rmtree(partial, ignore_errors=True)
        write_manifest(out, list(lines.values()))
        end_data_set(out, (CONFIG, SHARD), checksums)
    if all(line["status"] == "failed" for line in lines.values()):
        reason = next(iter(lines.values()))["reason"]
        raise FailedSimulation(f"{out}: all {len(lines)} clips failed, the first because of this: {reason}")
    return read_manifest(out)


def _settings(config: GenerateConfig) -> dict:
    """Return all options that the clips depend on, as JSON."""

    def plain(value):
        return value.name if isinstance(value, Enum) else str(value)

    settings = {name: value for name, value in asdict(config).items() if name not in _NOT_COMPARED}
    return json.loads(json.dumps(settings, default=plain))


def _make_all(config: GenerateConfig, checksums: dict[str, Checksum | None]) -> Iterator[dict]:
    """Yield manifest lines in the order in which clips are finished."""
    tasks = ((config, index, checksums.get(clip_id(index))) for index in config.numbers)
    return in_parallel(_make, tasks, config.workers, ordered=False)


def _make(config: GenerateConfig, index: int, expected: Checksum | None) -> dict:
    """Make one clip on disk unless it exists as expected, and return its manifest line."""
    folder = Path(config.out) / clip_id(index)
    kept = _kept(folder, config, expected)
    if kept is not None:
        return kept
    partial = folder.with_name(f".{folder.name}.partial")
    for leftover in (partial, folder):
        shutil.rmtree(leftover, ignore_errors=True)
    try:
        clip = generate_clip(config, index, images=partial / "images")
        save_clip(clip, partial)
        write_checksums(partial)
        partial.rename(folder)
    except FailedSimulation as failure:
        seed = attempt_seed(config.seed, config.retries)
        return {
            "id": folder.name, "status": "failed", "seed": seed, "attempts": config.retries + 1, "reason": str(failure)
        }  # fmt: skip
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return clip.provenance["manifest"]


def _kept(folder: Path, config: GenerateConfig, expected: Checksum | None) -> dict | None:
    """Return the manifest line of a clip that exists, undamaged, and is of this data set; None otherwise."""
    if expected not in (None, clip_checksum(folder)) or find_damage(folder, fast=not config.recheck):
        return None
    try:
        clip = load_clip(folder)
        line = clip.provenance["manifest"]
        same = (clip.id, line["id"], line["seed"], clip.fps, clip.images.kinds if clip.images else ()) == (
            folder.name, folder.name, attempt_seed(config.seed, line["attempts"] - 1), config.scene.fps,
            config.images.value,
        )  # fmt: skip
        return line if same and not missing_files(clip) else None
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError):
        return None
