"""Draw a clip as a contact sheet and as a video."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import repeat
from pathlib import Path

import cv2
import mujoco
import numpy as np

from dmae.data.clip import Clip
from dmae.data.images import write_video
from dmae.data.store import write_atomic
from dmae.progress import progress
from synth.rendering.raycasting import RayPainter
from synth.scene.build import build_scene
from synth.scene.spec import SceneSpec
from synth.viewing.overlay import PAPER, Overlay

_GAP = 6
"""px; between views."""
_MAX_WIDTH = 2560
"""px; of a sheet or video. Views of many cameras are drawn smaller."""
_COLUMNS = 6
"""Greatest number of columns of a sheet."""
_BLOCK = 2
"""px; side of the blocks of pixels that share a ray in images of a room."""


def has_images(clip: Clip) -> bool:
    """Return whether a clip has colour images to draw over."""
    return clip.images is not None and "rgb" in clip.images.kinds


def draw_rooms(clip: Clip) -> list[np.ndarray]:
    """Render the room of a clip, without its people: (H, W, 3) uint8 a view, dimmed. No OpenGL is needed.

    Raises:
        ValueError: the clip's provenance has no scene, or one of another version.
        FileNotFoundError: a file of the room does not exist.
    """
    if "spec" not in clip.provenance:
        raise ValueError(f"clip {clip.id!r} has no scene in its provenance")
    rig = clip.rig if clip.true_rig is None else clip.true_rig
    spec = SceneSpec.from_json(json.dumps(clip.provenance["spec"]))
    scene = build_scene(replace(spec, persons=()), rig)
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    painter = RayPainter(scene.model, scene.geom_ids, rig, _BLOCK)
    rooms = [painter.paint(data, view, ("rgb",))[0] for view in range(len(rig))]
    return [(0.25 * np.array(PAPER) + 0.65 * room).astype(np.uint8) for room in rooms]


def write_sheet(
    clip: Clip, path: Path, *, rows: int = 4, width: int = 480, rooms: Sequence[np.ndarray] | None = None
) -> None:
    """Write a PNG of some frames, a row each, in all views, a column each; more than `_COLUMNS` views take more rows.

    Raises:
        ValueError: the clip has no visibility.
    """
    columns = min(len(clip.rig), _COLUMNS)
    overlay = Overlay(clip, _fitting(width, columns), rooms)
    frames = np.unique(((np.arange(rows) + 0.5) * len(clip) / rows).astype(int))
    pictures = [
        _grid([overlay.tile(frame, view, image) for view, image in enumerate(images)], columns)
        for frame, images in zip(frames.tolist(), _pictures(clip, frames), strict=True)
    ]
    sheet = np.concatenate([overlay.header(pictures[0].shape[1]), *pictures])
    written, data = cv2.imencode(".png", cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))
    if not written:
        raise OSError(f"{path}: could not write PNG")
    write_atomic(path, data.tobytes())


def write_overlay_video(clip: Clip, path: Path, *, width: int = 480, rooms: Sequence[np.ndarray] | None = None) -> None:
    """Write an H.264 video of all views of all frames. Raises as `write_sheet` does."""
    columns = int(np.ceil(np.sqrt(len(clip.rig))))
    overlay = Overlay(clip, _fitting(width, columns), rooms)
    frames = np.arange(len(clip))

    def pictures() -> Iterator[np.ndarray]:
        header = overlay.header(columns * (overlay.width + _GAP) + _GAP)
        for frame, images in zip(progress(frames, "drawing", len(frames)), _pictures(clip, frames), strict=True):
            tiles = [overlay.tile(int(frame), view, image) for view, image in enumerate(images)]
            whole = np.concatenate([header, _grid(tiles, columns)])
            # H.264 needs even sides.
            yield np.pad(whole, ((0, whole.shape[0] % 2), (0, whole.shape[1] % 2), (0, 0)), mode="edge")

    write_video(path, pictures(), clip.fps)


def _pictures(clip: Clip, frames: np.ndarray) -> Iterator[Sequence[np.ndarray | None]]:
    """Yield the images of all views, frame by frame; None where there are none."""
    if not has_images(clip):
        return repeat([None] * len(clip.rig), len(frames))
    images = clip.images.select(frames, clip.rig.names)
    return zip(*(images.read("rgb", name) for name in clip.rig.names), strict=True)


def _fitting(width: int, columns: int) -> int:
    """Return the width of a view, px, such that `columns` fit side by side."""
    return min(width, (_MAX_WIDTH - _GAP) // columns - _GAP)


def _grid(tiles: list[np.ndarray], columns: int) -> np.ndarray:
    """Arrange tiles of one width in rows, with gaps between and around."""
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
