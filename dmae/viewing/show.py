"""Draw a clip: a contact sheet, a video, a recording for Rerun."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from importlib import util
from pathlib import Path

import numpy as np

from dmae.data.clip import Clip
from dmae.formats.reading import camera_indices
from dmae.viewing.config import ShowConfig
from dmae.viewing.overlay import chosen_layers
from dmae.viewing.sheet import write_overlay_video, write_sheet

Rooms = Callable[[Clip], Sequence[np.ndarray] | None]
"""Function that draws the room of a clip and returns an image (H, W, 3) uint8 for each view."""


def show_clip(
    clip: Clip, out: Path, config: ShowConfig, rooms: Rooms | Sequence[np.ndarray] | None = None
) -> list[Path]:
    """Draw one clip and return the paths of the files: `sheet.png`, `clip.mp4`, `clip.rrd`.

    The fields `data` and `out` of the configuration are not used; `rooms` are the backgrounds of a clip without images.
    Raises ValueError if the clip has no frames or no camera of a given name, frames or width are too small, or Rerun is
    requested but not installed.
    """
    for name, value, least in (("frames", config.frames, 1), ("width", config.width, 160)):
        if value < least:
            raise ValueError(f"{name}={value}: expected {least} or more")
    if config.rerun and util.find_spec("rerun") is None:
        raise ValueError("rerun=true: rerun-sdk is not installed; pip install 'dmae-synth[viz]' adds it")
    if not len(clip):
        raise ValueError(f"clip {clip.id!r}: expected frames to draw, found none")
    clip = of_cameras(clip.without_lost_images(), config.cameras)
    rooms = rooms(clip) if callable(rooms) else rooms
    layers, files = chosen_layers(clip, config.layers), [out / "sheet.png"]
    write_sheet(clip, files[0], layers, rows=config.frames, width=config.width, rooms=rooms)
    if config.video:
        files.append(out / "clip.mp4")
        write_overlay_video(clip, files[-1], layers, width=config.width, rooms=rooms)
    if config.rerun:
        from dmae.viewing.rerun import write_recording

        files.append(out / "clip.rrd")
        write_recording(clip, files[-1], layers)
    return files


def of_cameras(clip: Clip, cameras: Sequence[str]) -> Clip:
    """Return the clip with some cameras only; its poses are only drawn, and kept."""
    if not cameras:
        return clip
    return replace(clip.select(views=camera_indices(clip, cameras, "cameras")), poses=clip.poses)
