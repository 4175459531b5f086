"""Data sets: generate, verify, split, describe, export."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from dmae.cli import compose
from dmae.data.clip import Clip
from dmae.data.store import clip_folders, load_clip
from dmae.files.structured import read_json
from dmae.parallel import in_parallel, running_on
from synth.cli import SYNTH
from synth.datasets import generate as datasets
from synth.datasets import splits as datasets_splits
from synth.datasets import verify as datasets_verify
from synth.datasets.clip import GenerateConfig, check, clip_id, generate_clip
from synth.datasets.exporters import export as datasets_export
from synth.datasets.exporters.selection import PictureFormat
from synth.datasets.splits import SplitBy, Take, list_takes
from synth.datasets.statistics import NUMBERS, describe
from synth.datasets.verify import Problem
from synth.errors import FailedSimulation


def generate(
    *overrides: str,
    clips: int = 8,
    seed: int = 0,
    scene: str = "office",
    rig: str = "shelf",
    motion: str = "procedural",
    interaction: str = "none",
    detector: str = "shelf_openpose",
    workers: int = 1,
    out: str | Path | None = None,
) -> Iterator[Clip]:
    """Simulate clips with exact truth, one after the other.

        for clip in synth.generate(clips=8, scene="office", seed=7): ...
        for clip in synth.generate("scene.persons=[4,4]", "rig.ring.views=8", rig="ring", out="runs/ring"): ...

    Args:
        overrides: Options that are not named here, as on the command line: `"scene.seconds=4"`.
        clips: Number of clips.
        seed: Seed of the data set. Clip k depends only on `seed` and k. 0 is a valid seed.
        scene: Name of a preset, as on the command line: room, props, number of people.
        rig: Name of a preset: cameras.
        motion: Name of a preset: how people move, or the kind of recordings to replay.
        interaction: Name of a preset: what people do together.
        detector: Name of a preset: errors of the 2D detector.
        workers: Processes; -1 for one per core.
        out: Folder of a data set. It is made or completed as by `synth generate`, and the clips are read from it. By
            default the clips are made in memory and have no images.

    Yields:
        Clips of F frames, V views and P persons: `truth`, detections, visibility and occluders. A clip that fails with
        every seed is left out, with a warning that gives the reason.

    Raises:
        ValueError: an option is unknown or cannot be met, or `out` holds a data set of another configuration.
        FailedSimulation: no clip could be made.

    Examples:
        >>> clips = list(synth.generate("scene.seconds=1", clips=2, seed=7))
        >>> [len(clip) for clip in clips]
        [25, 25]
        >>> again = next(synth.generate("scene.seconds=1", clips=1, seed=7))
        >>> np.array_equal(clips[0].truth.xyz, again.truth.xyz)
        True
    """
    groups = {"scene": scene, "rig": rig, "motion": motion, "interaction": interaction, "detector": detector}
    values = {"clips": clips, "seed": seed, "workers": workers}
    given = [f"{name}={value}" for name, value in (groups | values).items()]
    config = compose(SYNTH.commands["generate"], [*given, *overrides])
    if out is not None:
        datasets.generate(replace(config, out=str(out)))
        return (load_clip(folder) for folder in clip_folders(Path(out)))
    if config.image_options.kinds:
        raise ValueError(f"images={list(config.image_options.kinds)}: images are written to a folder; give out=...")
    check(config)
    return _in_memory(config)


def _in_memory(config: GenerateConfig) -> Iterator[Clip]:
    with running_on(config.backend):
        made = in_parallel(_clip_or_failure, ((config, index) for index in config.numbers), config.workers)
    failed = 0
    for index, result in zip(config.numbers, made, strict=True):
        if isinstance(result, Clip):
            yield result
            continue
        failed += 1
        if failed == len(config.numbers):
            raise result
        warnings.warn(f"clip {clip_id(index)} failed and is left out: {result}", stacklevel=2)


def _clip_or_failure(config: GenerateConfig, index: int) -> Clip | FailedSimulation:
    try:
        return generate_clip(config, index)
    except FailedSimulation as failure:
        return failure


def verify(path: str | Path, *, fast: bool = False) -> list[Problem]:
    """Check that the clips of a data set, or one clip, are complete and correct.

    Args:
        path: Folder of a clip, or of a data set with its manifest.
        fast: Compare only the sizes of files, and the contents of JSON files with their checksums.

    Returns:
        The problems: clip, check, and description of each; an empty list if there are none.

    Raises:
        FileNotFoundError: there is neither a clip nor a data set.

    Examples:
        >>> for clip in synth.generate("scene.seconds=1", clips=2, seed=7, out="walks"): pass
        >>> synth.verify("walks")
        []
    """
    return datasets_verify.verify(Path(path), fast=fast).problems


def split(
    path: str | Path,
    by: str = "person",
    *,
    train: float = 0.8,
    validation: float = 0.1,
    test: float = 0.1,
    seed: int = 0,
    out: str | Path | None = None,
) -> dict[str, list[str]]:
    """Divide the clips of a data set so that no person, motion or rig is in two splits.

    Args:
        path: The data set.
        by: `person`, `motion`, `subject` or `rig`.
        train: Share of the clips.
        validation: Share of the clips; 0 for no such split.
        test: Share of the clips; 0 for no such split.
        seed: Seed of the order in which clips are drawn.
        out: JSON file to write, an input of `export`; by default none is written.

    Returns:
        The names of the clips of each split, by its name.

    Raises:
        ValueError: the shares do not add up to 1, or clips share too much for this number of splits.

    Examples:
        >>> for clip in synth.generate("scene.seconds=1", clips=2, seed=7, out="walks"): pass
        >>> parts = synth.split("walks", train=0.5, validation=0.5, test=0, out="splits.json")
        >>> [len(names) for names in parts.values()]
        [1, 1]
    """
    kind = SplitBy[by] if by in SplitBy.__members__ else None
    if kind is None:
        raise ValueError(f"by={by!r}: expected one of {', '.join(SplitBy.__members__)}")
    shares = {"train": train, "validation": validation, "test": test}
    made = datasets_splits.split(Path(path), shares, kind, seed=seed)
    if out is not None:
        datasets_splits.write_splits(Path(out), made, kind, seed)
    return made


def takes(
    path: str | Path, *, train: float = 0.0, validation: float = 0.0, test: float = 0.0, seed: int = 0
) -> list[Take]:
    """List takes of recorded motion, and divide them so that no subject is in two sets.

    Args:
        path: A folder of takes, or a list (TSV) of takes. Subjects and sets of a list are kept.
        train: Share of the total duration. If all three shares are 0, no sets are made.
        validation: Share of the total duration.
        test: Share of the total duration.
        seed: Seed of the order in which subjects are drawn.

    Returns:
        The takes: `listed` (file, subject, set), `seconds`, `fps`, `readable`, and `notes`, which give the reason if a
        take cannot be read.

    Raises:
        FileNotFoundError: there is no take.
        ValueError: the shares do not add up to 1, or there are fewer subjects than sets.

    Examples:
        >>> from synth.motion.readers.npz import write_npz
        >>> from synth.motion.source import MotionConfig, load_motion
        >>> write_npz(Path("2_1.npz"), load_motion(MotionConfig(), seconds=2, fps=30, rng=np.random.default_rng(0)))
        >>> [(take.listed.subject, take.seconds) for take in synth.takes("2_1.npz")]
        [('2', 2.0)]
    """
    shares = {"train": train, "validation": validation, "test": test}
    return list_takes(Path(path), shares, seed=seed)


def stats(path: str | Path, out: str | Path, *, extra_data: Sequence[str | Path] = (), workers: int = 1) -> dict:
    """Describe a data set: occlusion by joint and cause, contacts, people, distances, angles, motion.

    Args:
        path: The data set, or a clip.
        out: Folder of the page, `README.md`, its figure, and the numbers of both.
        extra_data: More data sets that the same page describes.
        workers: Processes; -1 for one per core.

    Returns:
        The numbers, as in `statistics.json`.

    Raises:
        FileNotFoundError: there is neither a clip nor a data set.

    Examples:
        >>> for clip in synth.generate("scene.seconds=1", clips=2, seed=7, out="walks"): pass
        >>> synth.stats("walks", "card")["counts"]["frames"]
        50
    """
    describe([Path(each) for each in (path, *extra_data)], Path(out), workers=workers)
    return read_json(Path(out) / NUMBERS)


def export(
    path: str | Path,
    out: str | Path,
    format: str = "coco",
    *,
    splits: str | Path | None = None,
    skeleton: str | None = None,
    every: int = 1,
    pictures: str = "jpg",
    workers: int = 1,
    damaged: bool = False,
) -> dict:
    """Write a data set in the layout of another program: images and annotations.

    Args:
        path: The data set, or a clip.
        out: Folder to write, whole or not at all; it must be empty or not exist.
        format: `coco`, `yolo`, `webdataset`, `huggingface`, `panoptic` or `npz`. All but the last two need images.
        splits: File that `split` wrote; by default all clips are in the split `train`.
        skeleton: Skeleton of the joints; by default coco17, for panoptic always panoptic19.
        every: Number of frames from one image to the next; 2 for every other frame.
        pictures: `jpg` or `png`.
        workers: Processes; -1 for one per core.
        damaged: Whether to export even if files are missing or have changed.

    Returns:
        A description of the export, as in `export.json`.

    Raises:
        ValueError: `out` is not empty, clips lack images or truth, or files are damaged.

    Examples:
        >>> for clip in synth.generate("scene.seconds=1", clips=1, seed=7, out="walks"): pass
        >>> synth.export("walks", "panoptic", "panoptic")["skeleton"]
        'panoptic19'
    """
    options = {"skeleton": skeleton, "every": every, "workers": workers, "damaged": damaged}
    if pictures not in PictureFormat.__members__:
        raise ValueError(f"pictures={pictures!r}: expected one of {', '.join(PictureFormat.__members__)}")
    chosen = None if splits is None else Path(splits)
    return datasets_export.export(
        Path(path), Path(out), format, splits=chosen, pictures=PictureFormat[pictures], **options
    )
