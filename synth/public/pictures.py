"""Draw clips in the rooms in which they were simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dmae.data.clip import Clip
from dmae.public.arguments import checked
from dmae.viewing.config import LayersConfig
from dmae.viewing.overlay import chosen_layers
from dmae.viewing.sheet import has_images, write_sheet
from dmae.viewing.show import of_views, show_clip
from synth.viewing.rooms import draw_rooms


@checked
def contact_sheet(clip: Clip, out: str | Path, *, frames: int = 4, width: int = 480) -> None:
    """Draw a clip in its room as a PNG: some frames, all views, each true joint in the colour of its occluder.

    Args:
        clip: The clip. If it has poses, these are drawn, as by `dmae.show`.
        out: The PNG file.
        frames: Number of frames, evenly spread over the clip, one row each.
        width: Width of a view, px.

    Examples:
        >>> clip = next(synth.generate("scene.seconds=1", clips=1, seed=7))
        >>> synth.contact_sheet(clip, "sheet.png", frames=1, width=320)
        >>> Path("sheet.png").stat().st_size > 10_000
        True
    """
    write_sheet(clip, Path(out), chosen_layers(clip, LayersConfig()), rows=frames, width=width, rooms=_rooms(clip))


@checked
def show(clip: Clip, out: str | Path, **options: object) -> list[Path]:
    """Draw a clip in its room: a contact sheet, a video, a recording for Rerun.

    Args:
        clip: Any clip. A clip that was not simulated is drawn without a room.
        out: Folder of the files.
        options: Options of `dmae.show`: `frames`, `views`, `width`, `layers`, `video`, `rerun`.

    Returns:
        The files: `sheet.png`, `clip.mp4`, `clip.rrd`.

    Raises:
        ValueError: there is no such camera, or Rerun is not installed.

    Examples:
        >>> clip = next(synth.generate("scene.seconds=1", clips=1, seed=7))
        >>> files = synth.show(clip, "pictures", frames=1, width=240, views=["0", "2"])
        >>> [file.name for file in files]
        ['sheet.png', 'clip.mp4']
    """
    clip = of_views(clip, options.pop("views", ()))
    return show_clip(clip, Path(out), rooms=_rooms(clip), **options)


def _rooms(clip: Clip) -> list[np.ndarray] | None:
    return draw_rooms(clip) if not has_images(clip) and "spec" in clip.provenance else None
