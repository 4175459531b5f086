"""Make a data set: clips in parallel, each renamed into its folder when it is whole, a manifest, and checksums.

A data set is the clip folders in it. The same command makes what is missing, so a run can be interrupted at any time,
and several machines can fill one folder, each with its own `first` and `clips`.
"""

import json
import os
import shutil
from collections.abc import Callable, Collection
from dataclasses import asdict
from enum import Enum
from pathlib import Path

from dmae.data.images import KINDS
from dmae.data.json_values import flat
from dmae.data.resume import claim_folder
from dmae.data.store import MANIFEST, all_failed, load_clip, read_manifest, save_clip, write_atomic
from dmae.files.checksums import Checksum, begin_data_set, clip_checksum, find_damage, seal, write_checksums
from dmae.files.contents import whole_folder
from dmae.files.structured import read_json
from dmae.parallel import in_parallel, running_on
from dmae.progress import counted_progress, progress
from synth.datasets.clip import attempt_seed, check, clip_id, simulate_clip
from synth.datasets.config import GenerateConfig, RenderConfig, image_kinds
from synth.datasets.images import add_images, image_files, missing_kinds
from synth.errors import FailedSimulation
from synth.physics.body_state import FILE as STATE
from synth.physics.body_state import load_state, save_state

CONFIG = "config.json"
"""File of the options that the clips of a data set depend on."""
_NOT_STORED = ("out", "first", "clips", "recheck", "workers", "backend", "dry_run")
"""Options that may differ when a data set is continued."""
_OF_IMAGES = ("images", "quality", "rgb", "imaging")
"""Settings that may differ when images are added to a data set."""
_OF_COMMANDS = ("config.yaml",)
"""Files that a folder may contain and still counts as empty: a command writes them about its own run."""


def generate(config: GenerateConfig) -> list[dict]:
    """Make a data set with its manifest and checksums, or add missing clips and images to an existing one.

    Existing undamaged clips are kept and get their missing images. To find damage, the sizes of files and the contents
    of labels are compared; with `recheck`, the contents of images as well.

    Returns:
        The lines of the manifest, one per clip: `id`, `status` ("ok" or "failed"), `seed`, and number of `attempts`. A
        clip with status "ok" also has `frames`, `persons`, `quality` (`synth.physics.simulation.assess`) and
        `occlusion` (see `synth.datasets.occlusion.summary`); with `rig.error` also `calibration_error`, the error of
        projections by the calibration of each camera, px. A failed clip has the `reason`.

    Raises:
        ValueError: the folder contains something else or a data set of another configuration, or the configuration
            cannot be met.
        FailedSimulation: no clip could be made, or `occlusion.target` cannot be met.
    """
    out, numbers = Path(config.out), config.numbers
    rig = check(config)
    claim(out, as_settings(config, leave=_NOT_STORED))
    if (out / MANIFEST).is_file():
        read_manifest(out)  # a damaged one is refused before any work
    checksums = begin_data_set(out)
    names = {clip_id(number, config.prefix): number for number in numbers}
    tasks = {name: (config, number, checksums.get(name)) for name, number in names.items()}
    lines = make_clips(config, _make, tasks, checksums, config.scene.frames * len(rig) * len(tasks))
    if all(line["status"] == "failed" for line in lines):
        raise FailedSimulation(f"{out}: {all_failed(lines)}")
    return lines


def make_clips(
    config: GenerateConfig | RenderConfig,
    make: Callable[..., dict],
    tasks: dict[str, tuple],
    checksums: dict[str, Checksum | None],
    images: int,
) -> list[dict]:
    """Make clips in parallel, and write the manifest and the checksums of their data set. Return the manifest.

    Args:
        make: Makes one clip on disk from its task, counts its images in the tally, and returns its manifest line.
        tasks: Arguments of `make`, by the name of the clip.
        checksums: Checksums of clips from before, from `begin_data_set`.
        images: Number of images of the clips, one for each frame and view.
    """
    out, made, tally = Path(config.out), [], ImageTally(config)
    limit_threads(config.workers)
    if config.kinds:
        tally.begin()
    try:
        with running_on(config.backend):
            lines = in_parallel(make, tasks.values(), config.workers, ordered=False)
            if config.kinds:
                lines = counted_progress(lines, "rendering images", lambda: tally.count(images))
            else:
                lines = progress(lines, "generating clips", len(tasks))
            made += lines
    finally:
        # Processes that were stopped during a clip leave an incomplete folder.
        for name in tasks:
            for leftover in (out / f".{name}.partial", out / name / ".images"):
                shutil.rmtree(leftover, ignore_errors=True)
        tally.end()
        seal(out, made, (CONFIG,), checksums)
    return read_manifest(out)


def limit_threads(workers: int) -> None:
    """Limit rendering to one core per process if there are several. Mesa's rasteriser would otherwise use all cores."""
    if workers != 1:
        os.environ.setdefault("LP_NUM_THREADS", "1")


def _make(config: GenerateConfig, number: int, expected: Checksum | None) -> dict:
    """Make one clip on disk, or only its images, and return its manifest line. Existing undamaged files are kept."""
    folder = Path(config.out) / clip_id(number, config.prefix)
    if _is_kept(folder, config, expected):
        return with_images(config, folder)
    shutil.rmtree(folder, ignore_errors=True)
    try:
        with whole_folder(folder) as partial:
            clip, state = simulate_clip(config, number)
            save_clip(clip, partial)
            save_state(state, partial)
            line = with_images(config, partial)
            write_checksums(partial)
    except FailedSimulation as failure:
        seed = attempt_seed(config.seed, config.retries)
        return {
            "id": folder.name, "status": "failed", "seed": seed, "attempts": config.retries + 1, "reason": str(failure)
        }  # fmt: skip
    return line


def with_images(config: GenerateConfig | RenderConfig, folder: Path) -> dict:
    """Add the images that a clip lacks, and return its manifest line."""
    clip, tally = load_clip(folder), ImageTally(config)
    if missing_kinds(clip, config):
        add_images(clip, load_state(folder), folder, config, tally.add)
        write_checksums(folder)
    else:
        tally.add(kept=len(clip) * len(clip.rig))
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
        same = (clip.id, line["id"], line["seed"], clip.fps) == wanted
        same &= all(path.is_file() for path in (image_files(clip.images) if clip.images else ()))
    except (FileNotFoundError, ValueError, KeyError, TypeError, AttributeError):
        return False
    return same and ((folder / STATE).is_file() or not missing_kinds(clip, config))


def claim(out: Path, settings: dict) -> None:
    """Claim a folder for a data set: it is new, empty, or contains a part of it. Store the settings in it.

    `settings` are all settings that the clips depend on, as JSON values. Those of images may differ for kinds of images
    that the data set does not have.

    Raises ValueError if the folder contains something else, a data set of another configuration, or one with images of
    other settings.
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
    before, kinds = image_kinds(kept["images"]), image_kinds(settings["images"])
    if not kinds:
        return
    # Colour images stay as they are when others are added.
    stays = ("rgb", "imaging") if "rgb" in before and "rgb" not in kinds else ()
    now = kept | {name: settings[name] for name in _OF_IMAGES if name not in stays}
    now["images"] = [kind for kind in KINDS if kind in (*before, *kinds)]
    fixed = [*(["quality"] if before else []), *(["rgb", "imaging"] if "rgb" in before else [])]
    made, asked = (flat({name: each[name] for name in fixed}) for each in (kept, now))
    other = [f"{name}={made[name]}, not {value}" for name, value in asked.items() if value != made[name]]
    if other:
        raise ValueError(
            f"{out} has images of {', '.join(other)}; `synth render data=... out=...` renders its clips again in "
            "another folder"
        )
    if now != kept:
        write_atomic(out / CONFIG, json.dumps(now, indent=1))


def as_settings(config, leave: Collection[str] = ()) -> dict:
    """Return the options of a configuration as JSON values, without the names in `leave`."""

    def plain(value):
        return value.name if isinstance(value, Enum) else str(value)

    settings = {name: value for name, value in asdict(config).items() if name not in leave}
    settings["images"] = image_kinds(config.images)
    return json.loads(json.dumps(settings, default=plain))


class ImageTally:
    """How many images processes have rendered: the marks in a file that they append to, if it exists."""

    def __init__(self, config: GenerateConfig | RenderConfig):
        self._path = Path(config.out) / f".images.{getattr(config, 'first', 0)}"

    def begin(self) -> None:
        """Create the file."""
        self._path.write_bytes(b"")

    def end(self) -> None:
        """Remove the file."""
        self._path.unlink(missing_ok=True)

    def add(self, kept: int = 0) -> None:
        """Count an image that was rendered, or so many that are kept and need not be."""
        if self._path.is_file():
            with self._path.open("ab") as file:
                file.write(b"k" * kept or b"r")

    def count(self, images: int) -> tuple[int, int]:
        """Return the number of rendered images, and of all to render, which are `images` without the kept ones."""
        marks = self._path.read_bytes()
        return marks.count(b"r"), images - marks.count(b"k")
