"""Write the images of a clip."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.images import KINDS, Images, write_depth, write_ids, write_parts, write_video
from dmae.files.names import child
from synth.people.segments import SEGMENTS
from synth.rendering.renderer import RenderedView, Renderer


def render_images(
    renderer: Renderer, qpos: np.ndarray, rig: CameraRig, folder: Path, fps: float, kinds: tuple[str, ...] = KINDS
) -> Images:
    """Write images of every view of every frame in the layout of `dmae.data.images`, one view in memory at a time.

    Args:
        renderer: Of the scene and the rig.
        qpos: (F, nq) states.
        rig: V cameras.
        folder: Takes the images.
        fps: Frames per second of the videos.
        kinds: Which images, of `dmae.data.images.KINDS`.
    """

    def rendered(view: int) -> Iterator[RenderedView]:
        for frame, state in enumerate(qpos):
            image = renderer.picture(state, view, kinds)
            for kind, write in {"depth": write_depth, "ids": write_ids, "parts": write_parts}.items():
                if kind in kinds:
                    write(child(folder / kind, rig.names[view], "camera") / f"{frame:06d}.png", getattr(image, kind))
            yield image

    for view, name in enumerate(rig.names):
        if "rgb" in kinds:
            write_video(child(folder / "rgb", f"{name}.mp4", "camera"), (image.rgb for image in rendered(view)), fps)
        else:
            for _ in rendered(view):
                pass
    return Images(folder, rig.names, tuple(range(len(qpos))), kinds, SEGMENTS if "parts" in kinds else ())
