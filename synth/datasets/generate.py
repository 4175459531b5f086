"""Generate data sets: many clips in parallel, resumably, and their manifest. Images are added to clips that exist."""

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

from dmae.data.store import MANIFEST, load_clip, read_manifest, save_clip, write_manifest
from dmae.parallel import in_parallel
from dmae.progress import counted_progress, progress
from synth.datasets.clip import GenerateConfig, attempt_seed, check, clip_id, simulate_clip
from synth.datasets.images.clip_images import add_images, missing_kinds
from synth.datasets.images.tally import FILE as TALLY
from synth.datasets.images.tally import PixelTally
from synth.datasets.set_folder import as_settings, claim
from synth.errors import FailedSimulation
from synth.physics.body_state import FILE as STATE
from synth.physics.body_state import load_state, save_state

_NOT_KEPT = ("out", "clips", "workers", "dry_run")
"""Options that may differ when a data set is continued, and are not kept."""


def generate(config: GenerateConfig) -> list[dict]:
    """Make a data set, or its missing clips or images, and its manifest.

    Clips that exist and are undamaged are kept, and get the images that they lack. A clip appears under its name once
    it is complete, so that a run can be interrupted at any time and resumed.

    Returns:
        The lines of the manifest, one a clip: `id`, `status` ("ok" or "failed"), `seed`, number of `attempts`; of clips
        that are ok `frames`, `persons`, `quality` (`synth.physics.quality.SimulationQuality`) and
        `occlusion`, see `synth.datasets.occlusion.summary`; with `rig.error` also `calibration_error`,
        the error of projections by the calibration of each camera, px; of clips that failed the `reason`.

    Raises:
        ValueError: the folder holds something else, or a data set of another configuration, or the configuration cannot
            be met.
        FailedSimulation: not one clip could be made, or `occlusion.target` is out of reach.
    """
    out = Path(config.out)
    rig = check(config)
    claim(out, as_settings(config, leave=_NOT_KEPT))
    lines = {line["id"]: line for line in read_manifest(out)} if (out / MANIFEST).is_file() else {}
    try:
        for line in _watched(config, len(rig)):
            lines[line["id"]] = line
    finally:
        # Processes that were ended in the middle of a clip leave it behind.
        for leftover in (*out.glob(".*.partial"), *out.glob("*/.images")):
            shutil.rmtree(leftover, ignore_errors=True)
        (out / TALLY).unlink(missing_ok=True)
        write_manifest(out, list(lines.values()))
    if all(line["status"] == "failed" for line in lines.values()):
        reason = next(iter(lines.values()))["reason"]
        raise FailedSimulation(f"{out}: all {len(lines)} clips failed, the first because of this: {reason}")
    return read_manifest(out)


def _watched(config: GenerateConfig, views: int) -> Iterator[dict]:
    """Yield manifest lines, and show the progress: by picture where there are any, else by clip."""
    if not config.image_options.kinds:
        return progress(_make_all(config), "generating clips", config.clips)
    tally = PixelTally(Path(config.out), config.clips)
    tally.begin([config.scene.frames * views] * config.clips)
    return counted_progress(_make_all(config), "rendering pictures", tally.count)


def limit_threads(workers: int) -> None:
    """Let each of several processes render on one core: Mesa's rasteriser would take all of them in every process."""
    if workers != 1:
        os.environ.setdefault("LP_NUM_THREADS", "1")


def _make_all(config: GenerateConfig) -> Iterator[dict]:
    """Yield manifest lines in the order in which clips are finished."""
    limit_threads(config.workers)
    return in_parallel(_make, ((config, index) for index in range(config.clips)), config.workers, ordered=False)


def _make(config: GenerateConfig, index: int) -> dict:
    """Make one clip on disk, or its images, unless they exist, and return its manifest line."""
    folder = Path(config.out) / clip_id(index, config.prefix)
    if _is_kept(folder, config):
        return _with_images(config, index, folder)
    partial = folder.with_name(f".{folder.name}.partial")
    for leftover in (partial, folder):
        shutil.rmtree(leftover, ignore_errors=True)
    try:
        clip, state = simulate_clip(config, index)
        save_clip(clip, partial)
        save_state(state, partial)
        line = _with_images(config, index, partial)
        partial.rename(folder)
    except FailedSimulation as failure:
        seed = attempt_seed(config.seed, config.retries)
        return {
            "id": folder.name, "status": "failed", "seed": seed, "attempts": config.retries + 1, "reason": str(failure)
        }  # fmt: skip
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return line


def _with_images(config: GenerateConfig, index: int, folder: Path) -> dict:
    """Add the images that a clip in a folder lacks; return its manifest line."""
    clip = load_clip(folder)
    pictures = len(clip) * len(clip.rig) if missing_kinds(clip, config.image_options) else 0
    with PixelTally(Path(config.out), config.clips).clip(index, pictures) as seen:
        if pictures:
            add_images(clip, load_state(folder), folder, config.image_options, seen)
    return clip.provenance["manifest"]


def _is_kept(folder: Path, config: GenerateConfig) -> bool:
    """Return whether a clip exists, undamaged, with the states that images are rendered from."""
    try:
        clip = load_clip(folder)
    except (FileNotFoundError, ValueError):
        return False
    return (folder / STATE).is_file() or not missing_kinds(clip, config.image_options)
