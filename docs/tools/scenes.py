"""Draw the six rooms with people in them: `docs/images/scenes.jpg`.

    python docs/tools/scenes.py            # under a minute

The camera is the one of eight around the room in which the least visible person has the most visible pixels.
"""

from pathlib import Path

import cv2
import numpy as np

from dmae.progress import progress
from synth.datasets.clip import simulate_clip
from synth.datasets.config import GenerateConfig
from synth.physics.simulation import rebuilt_scene
from synth.rendering.config import ImageQuality
from synth.rendering.renderer import Renderer
from synth.rigs.config import RigConfig, RingConfig
from synth.scene.config import SceneConfig

FILE = Path(__file__).parents[1] / "images/scenes.jpg"
ROOMS = ("studio", "office", "living_room", "warehouse", "pillars", "market")
COLUMNS, SIZE, SHARPER = 3, (480, 360), 2
"""Images in a row, their width and height, px, and how much larger they are drawn."""


def draw(room: str, seed: int) -> np.ndarray:
    """Return an image (H, W, 3) of a room in the middle of a clip."""
    width, height = (SHARPER * size for size in SIZE)
    ring = RingConfig(views=8, radius=[4.0, 4.4], height=[2.2, 2.8], focal=0.85 * width, size=[width, height])
    scene = SceneConfig(arena=room, persons=[3, 4], seconds=3.0, fps=5.0)
    clip, state = simulate_clip(GenerateConfig(seed=seed, scene=scene, rig=RigConfig(ring=ring)), 0)
    rig, frame = clip.actual_rig, len(clip) // 2
    qpos, seconds = state.qpos[frame], frame / clip.fps
    built, persons = rebuilt_scene(clip, state), len(state.shapes)
    with Renderer(built.model, built.geom_ids, rig, ImageQuality.draft) as renderer:
        ids = [renderer.image(qpos, view, ("ids",), seconds=seconds).ids for view in range(len(rig))]
    seen = [np.bincount(each.ravel(), minlength=1 + persons)[1 : 1 + persons].min() for each in ids]
    with Renderer(built.model, built.geom_ids, rig, ImageQuality.high) as renderer:
        image = renderer.image(qpos, int(np.argmax(seen)), ("rgb",), seconds=seconds).rgb
    return cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA)


if __name__ == "__main__":
    drawn = list(progress(map(draw, ROOMS, range(7, 7 + len(ROOMS))), "drawing", len(ROOMS)))
    rows = [np.hstack(drawn[first : first + COLUMNS]) for first in range(0, len(drawn), COLUMNS)]
    cv2.imwrite(str(FILE), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])
