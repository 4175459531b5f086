"""Draw a clip as a contact sheet and as a video."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import repeat
from pathlib import Path

import cv2
import numpy as np

from dmae.data.clip import Clip
from dmae.data.images import write_video
from dmae.files.contents import write_atomic
from dmae.progress import progress
from dmae.viewing.canvas import PAPER
from dmae.viewing.header import header
from dmae.viewing.layers import Layers
from dmae.viewing.overlay import Overlay

_GAP = 6
"""px; space between views."""
_MAX_WIDTH = 2560
"""px; greatest width of a sheet or video. With many cameras, views are drawn smaller."""
_COLUMNS = 6
"""Greatest number of columns of a sheet."""


def has_images(clip: Clip) -> bool:
    """Return whether a clip has colour images to draw over."""
    return clip.images is not None and "rgb" in clip.images.kinds


def write_sheet(
    clip: Clip,
    path: Path,
    layers: Layers,
    *,
    rows: int = 4,
    width: int = 480,
    rooms: Sequence[np.ndarray] | None = None,
) -> None:
    """Write a PNG with a row for each of some frames and a column for each view.

    With many views a frame takes several rows.
    """
    if rows < 1:
        raise ValueError(f"frames={rows}: expected 1 or more frames in the contact sheet")
    columns = min(len(clip.rig), _COLUMNS)
    overlay = Overlay(clip, _fitting(width, columns), layers, rooms)
    frames = np.unique(((np.arange(rows) + 0.5) * len(clip) / rows).astype(int))
    pictures = [
        _grid(overlay.tiles(frame, images), columns)
        for frame, images in zip(frames.tolist(), pictures_of(clip, frames), strict=True)
    ]
    sheet = np.concatenate([header(overlay, pictures[0].shape[1]), *pictures])
    written, data = cv2.imencode(".png", cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
    if not written:
        raise OSError(f"{path}: could not write PNG")
    write_atomic(path, data.tobytes())


def write_overlay_video(
    clip: Clip, path: Path, layers: Layers, *, width: int = 480, rooms: Sequence[np.ndarray] | None = None
) -> None:
    """Write an H.264 video of all views of all frames."""
    columns = int(np.ceil(np.sqrt(len(clip.rig))))
    overlay = Overlay(clip, _fitting(width, columns), layers, rooms)
    frames = np.arange(len(clip))

    def pictures() -> Iterator[np.ndarray]:
        top = header(overlay, columns * (overlay.width + _GAP) + _GAP)
        for frame, images in zip(progress(frames, "drawing", len(frames)), pictures_of(clip, frames), strict=True):
            whole = np.concatenate([top, _grid(overlay.tiles(int(frame), images), columns)])
            # H.264 needs even sides.
            yield np.pad(whole, ((0, whole.shape[0] % 2), (0, whole.shape[1] % 2), (0, 0)), mode="edge")

    with written_whole(path) as part:
        write_video(part, pictures(), clip.fps)


@contextmanager
def written_whole(path: Path) -> Iterator[Path]:
    """Yield the path of a temporary file next to `path`.

    The file replaces `path` when it is completely written. It is removed on failure.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.stem}.part{path.suffix}")
    try:
        yield part
        part.replace(path)
    finally:
        part.unlink(missing_ok=True)


def pictures_of(clip: Clip, frames: np.ndarray) -> Iterator[Sequence[np.ndarray | None]]:
    """Yield the images of all views, frame by frame; None for a view without images."""
    if not has_images(clip):
        return repeat([None] * len(clip.rig), len(frames))
    images = clip.images.select(frames, clip.rig.names)
    return zip(*(images.read("rgb", name) for name in clip.rig.names), strict=True)


def _fitting(width: int, columns: int) -> int:
    """Return the width of a view, px, with which `columns` views fit side by side."""
    return min(width, (_MAX_WIDTH - _GAP) // columns - _GAP)


def _grid(tiles: list[np.ndarray], columns: int) -> np.ndarray:
    """Return tiles of equal width arranged in rows, with margins between and around them."""
    width = tiles[0].shape[1]
    rows = [tiles[first : first + columns] for first in range(0, len(tiles), columns)]
    grid = []
    for row in rows:
        line = np.full((max(map(len, row)) + _GAP, columns * (width + _GAP) + _GAP, 3), PAPER, np.uint8)
        for column, tile in enumerate(row):
            left = _GAP + column * (width + _GAP)
            line[: len(tile), left : left + width] = tile
        grid.append(line)
    return np.concatenate(grid)
