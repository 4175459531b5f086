"""Write the images of a clip."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.images import (
    KINDS,
    Images,
    write_amodal,
    write_depth,
    write_flow,
    write_ids,
    write_normals,
    write_parts,
    write_rgb,
    write_video,
)
from synth.people.segments import SEGMENTS
from synth.rendering.renderer import Renderer

_WRITERS = {
    "rgb": write_rgb,
    "depth": write_depth,
    "ids": write_ids,
    "parts": write_parts,
    "normals": write_normals,
    "flow": write_flow,
    "amodal": write_amodal,
}


class RenderedImages(NamedTuple):
    """Images on disk, and the numbers of pixels of each person in them.

    Attributes:
        images: The images.
        visible: (F, V, P) int32 number of pixels that show each person; None without id images.
        amodal: (F, V, P) int32 number of pixels that would show each person if nothing else were there; None without id
            images.
    """

    images: Images
    visible: np.ndarray | None
    amodal: np.ndarray | None


def render_images(
    renderer: Renderer,
    qpos: np.ndarray,
    rig: CameraRig,
    folder: Path,
    fps: float,
    kinds: tuple[str, ...] = KINDS,
    rgb: str = "h264",
    seen: Callable[[], None] = lambda: None,
) -> RenderedImages:
    """Write images of every view of every frame in the layout of `dmae.data.images`, with only one in memory at a time.

    Args:
        renderer: Renderer of the scene and the rig.
        qpos: (F, nq) states.
        rig: V cameras.
        folder: Folder to write the images to.
        fps: Frames per second of the videos.
        kinds: Kinds of images, from `dmae.data.images.KINDS`.
        rgb: Format of colour images, from `dmae.data.images.RGB_FILES`.
        seen: Called after each view of each frame.
    """
    images = Images(folder, rig.names, tuple(range(len(qpos))), kinds, SEGMENTS if "parts" in kinds else (), rgb)
    counted = "ids" in kinds
    visible, amodal = (np.zeros((len(qpos), len(rig), renderer.persons), np.int32) for _ in range(2))

    def pictures(view: int) -> Iterator[np.ndarray | None]:
        """Render the images of a view, write all that are not in a video, and yield the colours."""
        for frame, state in enumerate(qpos):
            following = qpos[frame + 1] if frame + 1 < len(qpos) else None
            picture = renderer.picture(state, view, kinds, following)
            for kind in kinds:
                path = images.path(kind, rig.names[view], frame)
                if path.suffix != ".mp4":
                    _WRITERS[kind](path, getattr(picture, kind))
            if counted:
                for person in range(renderer.persons):
                    visible[frame, view, person] = np.count_nonzero(picture.ids == 1 + person)
                    amodal[frame, view, person] = np.count_nonzero(renderer.alone(state, view, person))
            seen()
            yield picture.rgb

    for view, name in enumerate(rig.names):
        colours = pictures(view)
        if "rgb" in kinds and rgb == "h264":
            write_video(images.path("rgb", name), colours, fps)
        for _ in colours:
            pass
    return RenderedImages(images, visible if counted else None, amodal if counted else None)
