"""Claim the folder of a data set when it is begun. Its stored configuration identifies the data set."""

import json
import os
import shutil
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from enum import Enum
from pathlib import Path

import numpy as np

from dmae.data.images import KINDS
from dmae.data.resume import claim_folder
from dmae.data.store import MANIFEST, load_clip, read_manifest, save_clip, write_manifest
from dmae.files.checksums import Checksum, begin_data_set, clip_checksum, end_data_set, find_damage, write_checksums
from dmae.files.contents import whole_folder, write_atomic
from dmae.files.structured import read_json
from dmae.parallel import in_parallel, running_on
from dmae.parts import SHARD, claim_shard
from dmae.progress import counted_progress, progress
from synth.datasets.clip import GenerateConfig, attempt_seed, check, clip_id, simulate_clip
from synth.datasets.images import add_images, image_kinds, missing_files, missing_kinds
from synth.errors import FailedSimulation
from synth.physics.body_state import FILE as STATE
from synth.physics.body_state import load_state, save_state

CONFIG = "config.json"
_OF_IMAGES = ("images", "quality", "rgb")
"""Settings that may differ when images are added to a data set."""
_OF_COMMANDS = ("config.yaml",)
"""Files that a folder may contain and still counts as empty: a command writes them about its own run."""


def claim(out: Path, settings: dict) -> None:
    """Claim a folder for a data set, and store the settings in it. The folder is new, empty, or contains a part of it.

    Args:
        out: The folder.
        settings: All settings that the clips depend on, as JSON values. `images`, `quality` and `rgb` may differ when
            images are added to existing clips.

    Raises:
        ValueError: the folder contains something else, or a data set of another configuration.
    """
    if out.exists() and not out.is_dir():
        raise ValueError(f"out={out}: expected a folder, found a file")
    others = [path.name for path in sorted(out.glob("*")) if path.name not in _OF_COMMANDS] if out.is_dir() else []
    if others and not (out / CONFIG).is_file():
        raise ValueError(
            f"out={out}: expected a new or empty folder, or a data set; it holds {', '.join(others[:3])}"
            f"{' and more' if len(others) > 3 else ''} and no {CONFIG}"
        )
    claim_folder(out / CONFIG, settings, "a data set", may_differ=_OF_IMAGES)
    kept = read_json(out / CONFIG)
    kinds = {*image_kinds(kept["images"]), *image_kinds(settings["images"])}
    if kinds != {*image_kinds(kept["images"])}:
        kept |= {"quality": settings["quality"], "rgb": settings["rgb"]}
        kept["images"] = [kind for kind in KINDS if kind in kinds]
        write_atomic(out / CONFIG, json.dumps(kept, indent=1))


def as_settings(config, leave: Collection[str] = ()) -> dict:
    """Return the options of a configuration as JSON values, without the names in `leave`."""

    def plain(value):
        return value.name if isinstance(value, Enum) else str(value)

    settings = {name: value for name, value in asdict(config).items() if name not in leave}
    settings["images"] = image_kinds(config.images)
    return json.loads(json.dumps(settings, default=plain))


# Count the pictures that several processes render.

TALLY = ".pictures"
"""Name of the file with the numbers, in the folder of a data set while it is made."""


class PixelTally:
    """Two numbers for each clip, in a file that processes share: rendered pictures, and all pictures.

    Args:
        folder: Folder of the data set.
        clips: Number of clips.
    """

    def __init__(self, folder: Path, clips: int):
        self._path, self._shape = Path(folder) / TALLY, (clips, 2)

    def begin(self, pictures: Sequence[int]) -> None:
        """Create the file, with the number of pictures of each clip."""
        np.stack([np.zeros(self._shape[0]), pictures], axis=1).astype(np.int64).tofile(self._path)

    def count(self) -> tuple[int, int]:
        """Return the number of rendered pictures, and the number of all pictures."""
        return tuple(np.fromfile(self._path, np.int64).reshape(self._shape).sum(0).tolist())

    @contextmanager
    def clip(self, index: int, pictures: int) -> Iterator[Callable[[], None]]:
        """Store the number of pictures of a clip, and yield a function to call after each picture.

        Nothing is counted if the file does not exist. `begin` creates the file.
        """
        if not self._path.is_file():
            yield lambda: None
            return
        numbers = np.memmap(self._path, np.int64, "r+", shape=self._shape)
        numbers[index] = 0, pictures

        def seen() -> None:
            numbers[index, 0] += 1

        yield seen


# Generate data sets: many clips in parallel, with a manifest. Runs can be resumed, and images can be added later.

_NOT_STORED = ("out", "first", "clips", "shard", "recheck", "workers", "backend", "dry_run")
"""Options that may differ when a data set is continued. They are not stored."""


def generate(config: GenerateConfig) -> list[dict]:
    """Make a data set with its manifest and checksums, or add missing clips and images to an existing one.

    Existing undamaged clips are kept and get their missing images. To find damage, the sizes of files and the contents
    of labels are compared; with `recheck`, the contents of images as well. A clip gets its final name only when it is
    complete, so a run can be interrupted at any time and resumed.

    Returns:
        The lines of the manifest, one per clip: `id`, `status` ("ok" or "failed"), `seed`, and number of `attempts`. A
        clip with status "ok" also has `frames`, `persons`, `quality` (`synth.physics.simulation.SimulationQuality`) and
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
