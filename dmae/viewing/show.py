"""Draw a clip: a contact sheet, a video, a recording for Rerun."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from importlib import util
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw

from dmae.data.clip import Clip, Source, person_name
from dmae.data.images import write_video
from dmae.files.contents import write_atomic, written_whole
from dmae.formats.reading import camera_indices
from dmae.progress import progress
from dmae.reporting.tables import counted
from dmae.viewing.config import ShowConfig
from dmae.viewing.overlay import (
    COLOURS,
    DETECTED,
    FAINT,
    INK,
    MEANINGS,
    PAPER,
    RED,
    RGB,
    TRUE,
    Layers,
    Mark,
    Overlay,
    chosen_layers,
    draw_mark,
    first_joints,
    font,
    images_of,
    person_colour,
)

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


_GAP = 6  # px; space between views
_MAX_WIDTH = 2560  # px; greatest width of a sheet or video. With many cameras, views are drawn smaller.
_COLUMNS = 6  # Greatest number of columns of a sheet


def write_sheet(
    clip: Clip,
    path: Path,
    layers: Layers,
    *,
    rows: int = 4,
    width: int = 480,
    rooms: Sequence[np.ndarray] | None = None,
) -> None:
    """Write a PNG with a row, or several with many views, for each of some frames and a column for each view."""
    columns = min(len(clip.rig), _COLUMNS)
    overlay = Overlay(clip, _fitting(width, columns), layers, rooms)
    frames = np.unique(((np.arange(rows) + 0.5) * len(clip) / rows).astype(int))
    pictures = [
        _grid(overlay.tiles(frame, images), columns)
        for frame, images in zip(frames.tolist(), images_of(clip, frames), strict=True)
    ]
    sheet = np.concatenate([header(overlay, pictures[0].shape[1]), *pictures])
    write_atomic(path, cv2.imencode(".png", cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))[1].tobytes())


def write_overlay_video(
    clip: Clip, path: Path, layers: Layers, *, width: int = 480, rooms: Sequence[np.ndarray] | None = None
) -> None:
    """Write an H.264 video of all views of all frames."""
    columns = int(np.ceil(np.sqrt(len(clip.rig))))
    overlay = Overlay(clip, _fitting(width, columns), layers, rooms)
    frames = np.arange(len(clip))

    def pictures() -> Iterator[np.ndarray]:
        top = header(overlay, columns * (overlay.width + _GAP) + _GAP)
        for frame, images in zip(progress(frames, "drawing", len(frames)), images_of(clip, frames), strict=True):
            whole = np.concatenate([top, _grid(overlay.tiles(int(frame), images), columns)])
            # H.264 needs even sides.
            yield np.pad(whole, ((0, whole.shape[0] % 2), (0, whole.shape[1] % 2), (0, 0)), mode="edge")

    with written_whole(path) as part:
        write_video(part, pictures(), clip.fps)


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


# The strip above the views: the name of the clip, a legend of the marks, and counts of joints

Item = tuple[str, tuple[Mark, RGB] | None]
"""A text, and the mark in front of it."""
_LETTERS, _SPACE, _MARK = font(14), 18, 17


def header(overlay: Overlay, width: int) -> np.ndarray:
    """Draw the strip (h, width, 3) uint8 with the number of lines that the text needs."""
    clip, shown = overlay.clip, overlay.shown
    persons = 0 if shown is None else shown.xyz.shape[1]
    about = [counted(persons, "person")] if persons else []
    about += [counted(len(clip.rig), "camera"), f"{len(clip) / clip.fps:.1f} s"]
    lacking = [(f"no {' and no '.join(overlay.layers.lacking)}", None)] if overlay.layers.lacking else []
    first = _wrapped([(f"clip {clip.id}", None), (", ".join(about), None), *lacking], width)
    lines = first + [line for items in _legend(overlay) for line in _wrapped(items, width)]
    canvas = np.full((12 + 24 * len(lines), width, 3), PAPER, np.uint8)
    texts = []
    for number, line in enumerate(lines):
        x, y = 10.0, 8 + 24 * number
        for words, mark in line:
            if mark:
                draw_mark(canvas, np.array([x + 5.5, y + 8.5]), *mark, 2)
                x += _MARK
            texts.append(((x, y), words, INK if mark or number < len(first) else FAINT))
            x += _LETTERS.getlength(words) + _SPACE
    image = Image.fromarray(canvas)
    draw = ImageDraw.Draw(image)
    for place, words, colour in texts:
        draw.text(place, words, colour, _LETTERS)
    return np.asarray(image)


def _legend(overlay: Overlay) -> list[list[Item]]:
    layers, clip = overlay.layers, overlay.clip
    if layers.occlusion:
        return _occlusion_legend(overlay)
    items: list[Item] = [("detected", (Mark.CROSS, DETECTED))] if layers.detections else []
    if not layers.poses:
        there = [] if overlay.shown is None else np.isfinite(overlay.shown.xyz).any((0, 2, 3))
        items += [(f"true {person_name(p)}", (Mark.RING, person_colour(p))) for p in np.flatnonzero(there).tolist()]
        return [items] if items else []
    items += [("true", (Mark.RING, TRUE))] if layers.truth else []
    assert clip.poses is not None
    source = clip.poses.source[:, :, first_joints(clip.poses)]
    there = (source != Source.ABSENT).any(-1)
    total = max(1, there.sum() * source.shape[-1])
    completed = (source == Source.COMPLETED).sum() / total
    measured = clip.poses.measured[:, :, first_joints(clip.poses)].sum() / total
    if layers.measured:
        items += [(person_name(p), (Mark.DISC, person_colour(p))) for p in range(source.shape[1]) if there[:, p].any()]
    if layers.completed and completed:
        items += [("completed: fewer than two cameras agree, or rejected", (Mark.SQUARE, RED))]
    shares = f"joints of people who are present: {measured:.0%} measured, {completed:.0%} completed"
    return [items, [(f"{shares}, {max(0.0, 1 - measured - completed):.0%} absent", None)]]


def _occlusion_legend(overlay: Overlay) -> list[list[Item]]:
    clip = overlay.clip
    assert clip.truth is not None and clip.occlusion is not None
    joints = first_joints(clip.truth)
    codes = clip.occlusion.visibility[..., joints]
    there = np.isfinite(clip.truth.xyz[:, :, joints]).all(-1)
    visible_views = clip.occlusion.visible_views[..., joints][there]
    seen = np.bincount(visible_views, minlength=len(clip.rig) + 1) / max(1, there.sum())
    legend: list[Item] = [
        (f"{meaning} {np.mean(codes == cause):.0%}", (Mark.DISC, COLOURS[cause])) for cause, meaning in MEANINGS.items()
    ]
    if overlay.layers.detections:
        legend.insert(0, ("detected", (Mark.CROSS, DETECTED)))
    counts = [(f"{number}: {share:.0%}", None) for number, share in enumerate(seen) if share > 0]
    return [legend, [("joints by number of cameras that see them", None), *counts]]


def _wrapped(items: list[Item], width: int) -> list[list[Item]]:
    """Wrap texts with their marks, if any, into lines of `width` px."""
    lines, x = [[]], 10.0
    for words, mark in items:
        needed = _LETTERS.getlength(words) + _SPACE + (_MARK if mark else 0)
        if lines[-1] and x + needed > width:
            lines, x = [*lines, []], 10.0
        lines[-1].append((words, mark))
        x += needed
    return lines
