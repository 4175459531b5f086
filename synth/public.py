"""The verbs of `import synth`: each command as a function, with objects where the command has files."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from dmae.cli import compose
from dmae.data.clip import Clip
from dmae.data.store import clip_folders, load_clip
from dmae.parallel import in_parallel
from synth.cli import SYNTH
from synth.datasets import generate as datasets
from synth.datasets import verify as datasets_verify
from synth.datasets.clip import GenerateConfig, check, clip_id, generate_clip
from synth.datasets.verify import Problem
from synth.errors import FailedSimulation
from synth.viewing import show


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
        overrides: Options as on the command line, for those that are not named here: `"scene.seconds=4"`.
        clips: How many.
        seed: Of all of them; clip k depends on `seed` and k alone. 0 is a seed.
        scene: Name of a preset, as on the command line: room, props, how many people.
        rig: Name of a preset: cameras.
        motion: Name of a preset: how people move, or the kind of recordings to replay.
        interaction: Name of a preset: what people do together.
        detector: Name of a preset: how the 2D detector fails.
        workers: Processes; -1 for one a core.
        out: Folder of a data set, made or completed as `synth generate` does, from which the clips are then read. By
            default they are made in memory, and have no images.

    Yields:
        Clips of F frames, V views and P persons: `truth`, detections, visibility and its causes. A clip that fails
        with every seed is left out with a warning that gives the reason.

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
    made = in_parallel(_clip_or_failure, ((config, index) for index in range(config.clips)), config.workers)
    failed = 0
    for index, result in enumerate(made):
        if isinstance(result, Clip):
            yield result
            continue
        failed += 1
        if failed == config.clips:
            raise result
        warnings.warn(f"clip {clip_id(index)} failed and is left out: {result}", stacklevel=2)


def _clip_or_failure(config: GenerateConfig, index: int) -> Clip | FailedSimulation:
    try:
        return generate_clip(config, index)
    except FailedSimulation as failure:
        return failure


def contact_sheet(clip: Clip, out: str | Path, *, frames: int = 4, width: int = 480) -> None:
    """Draw a simulated clip as a PNG: some frames, all views, each joint in the colour of what hides it.

    Args:
        clip: Has visibility.
        out: The PNG.
        frames: How many, evenly spread over the clip; a row each.
        width: Of a view, px.

    Raises:
        ValueError: the clip has no visibility.

    Examples:
        >>> clip = next(synth.generate("scene.seconds=1", clips=1, seed=7))
        >>> synth.contact_sheet(clip, "sheet.png", frames=1, width=320)
        >>> Path("sheet.png").stat().st_size > 10_000
        True
    """
    rooms: list[np.ndarray] | None = None
    if clip.images is None and "spec" in clip.provenance:
        rooms = show.draw_rooms(clip)
    show.write_sheet(clip, Path(out), rows=frames, width=width, rooms=rooms)


def verify(path: str | Path) -> list[Problem]:
    """Check that the clips of a data set, or one clip, are whole and true.

    Args:
        path: Folder of a clip, or of a data set with its manifest.

    Returns:
        All that is wrong: clip, check, and what; none if nothing is.

    Raises:
        FileNotFoundError: neither a clip nor a data set is there.

    Examples:
        >>> for clip in synth.generate("scene.seconds=1", clips=2, seed=7, out="walks"): pass
        >>> synth.verify("walks")
        []
    """
    return datasets_verify.verify(Path(path))[1]
