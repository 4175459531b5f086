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
from synth.datasets import forecast as datasets_forecast
from synth.datasets import generate as datasets
from synth.datasets import verify as datasets_verify
from synth.datasets.clip import GenerateConfig, check, clip_id, generate_clip
from synth.datasets.forecast import Forecast
from synth.datasets.images import render as rendering
from synth.datasets.verify import Problem
from synth.errors import FailedSimulation
from synth.physics.body_state import BodyState, load_state
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


def forecast(*overrides: str, out: str | Path = "runs/data") -> Forecast:
    """Forecast what `generate` takes, from a few short clips that are made and thrown away.

    Args:
        overrides: Options as on the command line: `"clips=100"`, `"images=[rgb,ids]"`.
        out: Folder of the data set. What it already holds is not counted.

    Returns:
        Numbers of `clips`, `frames` and `pictures` to be made, `seconds` and `megabytes`.

    Raises:
        ValueError: an option is unknown or cannot be met.

    Examples:
        >>> found = synth.forecast("clips=2", "scene.seconds=1", "scene.persons=[1,1]")
        >>> found.clips, found.frames
        (2, 50)
    """
    return datasets_forecast.forecast(replace(compose(SYNTH.commands["generate"], overrides), out=str(out)))


def render(data: str | Path, *overrides: str, out: str | Path, rig: str | None = None) -> Iterator[Clip]:
    """Render clips again: as other images, at another quality, through other cameras. Nothing is simulated.

        for clip in synth.render("runs/data", "images=[rgb,flow]", "quality=high", out="runs/high"): ...
        for clip in synth.render("runs/data", "rig.ring.views=8", rig="ring", out="runs/ring"): ...

    Args:
        data: Data set that `generate` made, or one clip of it.
        overrides: Options as on the command line.
        out: Folder of the data set that is made or completed.
        rig: Name of a preset: other cameras, whose visibility and detections are made as well.

    Yields:
        Clips with images, and with all labels.

    Raises:
        FileNotFoundError: there is no clip, or it holds no state of bodies.
        ValueError: an option is unknown, or `out` holds something else.

    Examples:
        >>> short = ("scene.seconds=0.1", "scene.persons=[1,1]", "rig.ring.views=2", "rig.ring.size=[96,72]")
        >>> for clip in synth.generate(*short, "rig.ring.focal=90", rig="ring", clips=1, out="walks"): pass
        >>> clip = next(synth.render("walks", "quality=draft", "images=[rgb,flow]", out="seen"))
        >>> clip.images.kinds
        ('rgb', 'flow')
        >>> clip.images.at("flow", "ring0", 0).shape
        (72, 96, 2)
    """
    given = [f"data={data}", f"out={out}", *([f"rig={rig}"] if rig else []), *overrides]
    rendering.render(compose(SYNTH.commands["render"], given))
    return (load_clip(folder) for folder in clip_folders(Path(out)))


def body_state(clip: str | Path) -> BodyState:
    """Read the state of the bodies of a simulated clip: pose, shape, forces, contacts, actions.

    Args:
        clip: Folder of the clip.

    Raises:
        FileNotFoundError: the clip has no state: it is no simulated one, or of an older version.
        ValueError: the file is malformed.

    Examples:
        >>> for clip in synth.generate("scene.seconds=0.2", "scene.persons=[1,1]", clips=1, out="walks"): pass
        >>> state = synth.body_state("walks/000000")
        >>> state.rotations.shape, len(state.action_names) > 0
        ((5, 1, 16, 4), True)
    """
    return load_state(Path(clip))


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
