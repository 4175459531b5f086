"""Draw the room of a simulated clip as a background for its people if the clip has no images."""

from dataclasses import replace

import mujoco
import numpy as np

from dmae.data.clip import Clip
from dmae.viewing.overlay import PAPER
from synth.rendering.raycasting import RayPainter
from synth.scene.build import build_scene
from synth.scene.spec import SceneSpec

_BLOCK = 2
"""Side of the blocks of pixels that share a ray, px."""


def draw_rooms(clip: Clip) -> list[np.ndarray]:
    """Return a dimmed image of the room of a clip without its people, (H, W, 3) uint8 for each view. Needs no OpenGL.

    Raises:
        ValueError: the clip's provenance has no scene, or one of another version.
        FileNotFoundError: a file of the room does not exist.
    """
    rig = clip.actual_rig
    scene = build_scene(replace(SceneSpec.of(clip), persons=()), rig)
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    painter = RayPainter(scene.model, scene.geom_ids, rig, _BLOCK)
    rooms = [painter.paint(data, view, ("rgb",))[0] for view in range(len(rig))]
    return [(0.25 * np.array(PAPER) + 0.65 * room).astype(np.uint8) for room in rooms]
