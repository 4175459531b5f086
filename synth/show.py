"""A clip to look at: a contact sheet, a video, and a recording for the Rerun viewer."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from importlib import util
from itertools import repeat
from pathlib import Path

import cv2
import mujoco
import numpy as np

from dmae.clip import Clip
from dmae.images import write_video
from dmae.progress import progress
from dmae.store import load_clip, write_atomic
from synth.overlay import PAPER, Overlay
from synth.raycast import RayPainter
from synth.scene import build_scene
from synth.spec import SceneSpec

_GAP = 6
"""Between views, px."""
_WIDEST = 2560
"""Of a sheet or video, px; views of many cameras are drawn smaller."""
_COLUMNS = 6
"""At most, of a sheet."""
_BLOCK = 2
"""Side of the pixels that share a ray where a room is drawn."""


@dataclass(frozen=True)
class ShowConfig:
    """`synth show`.

    Attributes:
        clip: Folder of a simulated clip.
        out: Folder that takes `sheet.png`, `clip.mp4` and, where rerun-sdk is installed, `clip.rrd`.
        frames: How many the sheet shows, evenly spread over the clip.
        views: Names of the cameras; none for all.
        width: Of a view, px.
    """

    clip: str = "???"
    out: str = "runs/show"
    frames: int = 4
    views: list[str] = field(default_factory=list)
    width: int = 480

    def __post_init__(self):
        for name, least in (("frames", 1), ("width", 160)):
            if getattr(self, name) < least:
                raise ValueError(f"{name}: expected {least} or more, got {getattr(self, name)}")


def run_show(config: ShowConfig, out: Path) -> None:
    clip, rooms = _chosen(load_clip(Path(config.clip)), config), None
    if not _coloured(clip):
        try:
            rooms = draw_rooms(clip)
        except (ValueError, OSError) as error:
            print(f"the room is not drawn, only its floor: {error}")
    write_sheet(clip, out / "sheet.png", rows=config.frames, width=config.width, rooms=rooms)
    print(out / "sheet.png")
    write_overlay_video(clip, out / "clip.mp4", width=config.width, rooms=rooms)
    print(out / "clip.mp4")
    if util.find_spec("rerun") is None:
        print("no recording for the Rerun viewer: rerun-sdk is not installed (pip install 'dmae-synth[viz]' adds it)")
        return
    from synth.recording import write_recording

    write_recording(clip, out / "clip.rrd")
    print(out / "clip.rrd")


def _chosen(clip: Clip, config: ShowConfig) -> Clip:
    unknown = sorted(set(config.views) - set(clip.rig.names))
    if unknown:
        raise ValueError(f"views: {config.clip} has no camera {unknown}; it has {list(clip.rig.names)}")
    return clip.select(views=[clip.rig.names.index(name) for name in config.views]) if config.views else clip


def _coloured(clip: Clip) -> bool:
    """Whether a clip has images to draw over."""
    return clip.images is not None and "rgb" in clip.images.kinds


def draw_rooms(clip: Clip) -> list[np.ndarray]:
    """What stands where a clip was made, without its people: (H, W, 3) uint8 a view, dimmed. No OpenGL is needed.

    Raises:
        ValueError: the clip does not say where it was made, or says it as another version of this software does.
        FileNotFoundError: what stood there is a file that is gone.
    """
    if "spec" not in clip.provenance:
        raise ValueError(f"clip {clip.id!r} does not say where it was made")
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
    """A PNG of some frames, a row each, in all views, a column each; more than `_COLUMNS` views take more rows.

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
    """An H.264 video of all views of all frames. Raises as `write_sheet` does."""
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
    """The images of all views, frame by frame; nothing where there are none."""
    if not _coloured(clip):
        return repeat([None] * len(clip.rig), len(frames))
    images = clip.images.select(frames, clip.rig.names)
    return zip(*(images.read("rgb", name) for name in clip.rig.names), strict=True)


def _fitting(width: int, columns: int) -> int:
    """Width of a view such that so many fit side by side, px."""
    return min(width, (_WIDEST - _GAP) // columns - _GAP)


def _grid(tiles: list[np.ndarray], columns: int) -> np.ndarray:
    """Tiles of one width in rows, with gaps between and around."""
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
