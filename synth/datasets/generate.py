"""Generate data sets: many clips in parallel, with a manifest. Runs can be resumed, and images can be added later."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from dmae.data.store import MANIFEST, load_clip, read_manifest, save_clip, whole_folder, write_manifest
from dmae.files.checksums import Checksum, begin_data_set, clip_checksum, end_data_set, find_damage, write_checksums
from dmae.parallel import in_parallel, running_on
from dmae.parts import SHARD, claim_shard
from dmae.progress import counted_progress, progress
from synth.datasets.clip import GenerateConfig, attempt_seed, check, clip_id, simulate_clip
from synth.datasets.images.clip_images import add_images, missing_kinds
from synth.datasets.images.image_checks import missing_files
from synth.datasets.images.tally import FILE as TALLY
from synth.datasets.images.tally import PixelTally
from synth.datasets.set_folder import CONFIG, as_settings, claim
from synth.errors import FailedSimulation
from synth.physics.body_state import FILE as STATE
from synth.physics.body_state import load_state, save_state

_NOT_STORED = ("out", "first", "clips", "shard", "recheck", "workers", "backend", "dry_run")
"""Options that may differ when a data set is continued. They are not stored."""


def generate(config: GenerateConfig) -> list[dict]:
    """Make a data set with its manifest and checksums, or add missing clips and images to an existing one.

    Existing undamaged clips are kept and get their missing images. To find damage, the sizes of files and the contents
    of labels are compared; with `recheck`, the contents of images as well. A clip gets its final name only when it is
    complete, so a run can be interrupted at any time and resumed.

    Returns:
        The lines of the manifest, one per clip: `id`, `status` ("ok" or "failed"), `seed`, and number of `attempts`. A
        clip with status "ok" also has `frames`, `persons`, `quality` (`synth.physics.quality.SimulationQuality`) and
        `occlusion` (see `synth.datasets.occlusion.summary`); with `rig.error` also `calibration_error`, the error of
        projections by the calibration of each camera, px. A failed clip has the `reason`.

    Raises:
        ValueError: the folder contains something else or a data set of another configuration, or the configuration
            cannot be met.
        FailedSimulation: no clip could be made, or `occlusion.target` cannot be met.
    """
    out = Path(config.out)
    rig = check(config)
    claim(out, as_settings(config, leave=_NOT_STORED))
    claim_shard(out, config.first, config.clips, config.shard)
    lines = {line["id"]: line for line in read_manifest(out)} if (out / MANIFEST).is_file() else {}
    checksums = begin_data_set(out)
    try:
        for line in _watched(config, len(rig), checksums):
            lines[line["id"]] = line
            checksums[line["id"]] = clip_checksum(out / line["id"])
    finally:
        # Processes that were stopped during a clip leave an incomplete folder.
        for leftover in (*out.glob(".*.partial"), *out.glob("*/.images")):
            shutil.rmtree(leftover, ignore_errors=True)
        (out / TALLY).unlink(missing_ok=True)
        write_manifest(out, list(lines.values()))
        end_data_set(out, (CONFIG, SHARD), checksums)
    if all(line["status"] == "failed" for line in lines.values()):
        reason = next(iter(lines.values()))["reason"]
        raise FailedSimulation(f"{out}: all {len(lines)} clips failed, the first because of this: {reason}")
    return read_manifest(out)


def _watched(config: GenerateConfig, views: int, checksums: dict[str, Checksum | None]) -> Iterator[dict]:
    """Yield manifest lines, and show the progress: by picture if images are rendered, otherwise by clip."""
    clips = len(config.numbers)
    if not config.image_options.kinds:
        return progress(_make_all(config, checksums), "generating clips", clips)
    tally = PixelTally(Path(config.out), clips)
    tally.begin([config.scene.frames * views] * clips)
    return counted_progress(_make_all(config, checksums), "rendering pictures", tally.count)


def limit_threads(workers: int) -> None:
    """Limit rendering to one core per process if there are several. Mesa's rasteriser would otherwise use all cores."""
    if workers != 1:
        os.environ.setdefault("LP_NUM_THREADS", "1")


def _make_all(config: GenerateConfig, checksums: dict[str, Checksum | None]) -> Iterator[dict]:
    """Yield manifest lines in the order in which clips are finished."""
    limit_threads(config.workers)
    tasks = ((config, index, checksums.get(clip_id(index, config.prefix))) for index in config.numbers)
    with running_on(config.backend):
        return in_parallel(_make, tasks, config.workers, ordered=False)


def _make(config: GenerateConfig, index: int, expected: Checksum | None) -> dict:
    """Make one clip on disk, or only its images, and return its manifest line. Existing undamaged files are kept."""
    folder = Path(config.out) / clip_id(index, config.prefix)
    if _is_kept(folder, config, expected):
        return _with_images(config, index, folder)
    shutil.rmtree(folder, ignore_errors=True)
    try:
        with whole_folder(folder) as partial:
            clip, state = simulate_clip(config, index)
            save_clip(clip, partial)
            save_state(state, partial)
            line = _with_images(config, index, partial)
            write_checksums(partial)
    except FailedSimulation as failure:
        seed = attempt_seed(config.seed, config.retries)
        return {
            "id": folder.name, "status": "failed", "seed": seed, "attempts": config.retries + 1, "reason": str(failure)
        }  # fmt: skip
    return line


def _with_images(config: GenerateConfig, index: int, folder: Path) -> dict:
    """Add the missing images of a clip in a folder, and return its manifest line."""
    clip = load_clip(folder)
    pictures = len(clip) * len(clip.rig) if missing_kinds(clip, config.image_options) else 0
    with PixelTally(Path(config.out), len(config.numbers)).clip(index - config.numbers.start, pictures) as seen:
        if pictures:
            add_images(clip, load_state(folder), folder, config.image_options, seen)
            write_checksums(folder)
    return clip.provenance["manifest"]


def _is_kept(folder: Path, config: GenerateConfig, expected: Checksum | None) -> bool:
    """Return whether an undamaged clip of this data set exists, with the body states that images are rendered from."""
    if expected not in (None, clip_checksum(folder)) or find_damage(folder, fast=not config.recheck):
        return False
    try:
        clip = load_clip(folder)
        line = clip.provenance["manifest"]
        seed = attempt_seed(config.seed, line["attempts"] - 1)
        wanted = (folder.name, folder.name, seed, config.scene.fps)
        same = (clip.id, line["id"], line["seed"], clip.fps) == wanted and not missing_files(clip)
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError):
        return False
    return same and ((folder / STATE).is_file() or not missing_kinds(clip, config.image_options))
