"""Forecast the cost of simulated clips and their images, and render existing clips again."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from dmae.cli import compose
from dmae.data.clip import Clip
from dmae.data.store import clip_folders, load_clip
from synth.cli import SYNTH
from synth.datasets import forecast as datasets_forecast
from synth.datasets import render as rendering
from synth.datasets.forecast import Forecast


def forecast(*overrides: str, out: str | Path = "runs/data") -> Forecast:
    """Forecast the time and the disk space of `generate` from a few short clips, which are deleted afterwards.

    Args:
        overrides: Options as on the command line: `"clips=100"`, `"images=[rgb,ids]"`.
        out: Folder of the data set. Existing clips in it are not counted.

    Returns:
        The numbers of `clips`, `frames` and `pictures` to be made, the time in `seconds` and the size in `megabytes`.

    Raises:
        ValueError: an option is unknown or cannot be met.

    Examples:
        >>> found = synth.forecast("clips=2", "scene.seconds=1", "scene.persons=[1,1]")
        >>> found.clips, found.frames
        (2, 50)
    """
    return datasets_forecast.forecast(replace(compose(SYNTH.commands["generate"], overrides), out=str(out)))


def render(data: str | Path, *overrides: str, out: str | Path, rig: str | None = None) -> Iterator[Clip]:
    """Render clips again: as other images, at another quality, or with other cameras. Nothing is simulated.

        for clip in synth.render("runs/data", "images=[rgb,flow]", "quality=high", out="runs/high"): ...
        for clip in synth.render("runs/data", "rig.ring.views=8", rig="ring", out="runs/ring"): ...

    Args:
        data: Data set that `generate` made, or one clip of it.
        overrides: Options as on the command line.
        out: Folder of the data set that is made or completed.
        rig: Name of a preset with other cameras. Visibility and detections are then made for these cameras as well.

    Yields:
        Clips with images, and with all labels.

    Raises:
        FileNotFoundError: there is no clip, or it contains no body state.
        ValueError: an option is unknown, or `out` contains something else.

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
