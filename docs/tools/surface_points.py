"""Draw the named points on people's surfaces over an image: `docs/images/surface_points.jpg`.

    python docs/tools/surface_points.py            # one image, under a minute

Filled dots are seen by the camera. Rings are hidden: by the own body in grey, by another person in yellow, by an object
in blue. What touches another person is red.
"""

from pathlib import Path

import cv2
import numpy as np

from dmae.data.labels import Visibility
from synth.datasets.clip import simulate_clip
from synth.datasets.config import GenerateConfig
from synth.interactions.registry import InteractionConfig
from synth.labels.surfaces import surface_labels, surface_points
from synth.physics.simulation import rebuilt_scene
from synth.rendering.config import ImageQuality
from synth.rendering.renderer import Renderer
from synth.rigs.config import RigConfig, RingConfig
from synth.scene.config import SceneConfig

FILE = Path(__file__).parents[1] / "images/surface_points.jpg"
_COLOURS = {
    Visibility.VISIBLE: (255, 255, 255),
    Visibility.HIDDEN_BY_SELF: (140, 140, 140),
    Visibility.HIDDEN_BY_PERSON: (40, 210, 250),
    Visibility.HIDDEN_BY_OBJECT: (240, 120, 40),
}
"""Colours by visibility, BGR."""
_RED = (40, 40, 240)


def main() -> None:
    config = GenerateConfig(
        seed=4, scene=SceneConfig(arena="studio", seconds=4.0, fps=5.0, props=[0, 0]),
        rig=RigConfig(ring=RingConfig(views=3, radius=[2.8, 2.8], height=[1.5, 1.5])),
        interaction=InteractionConfig(kind="hug"),
    )  # fmt: skip
    clip, state = simulate_clip(config, 0)
    rig, scene = clip.actual_rig, rebuilt_scene(clip, state)
    points = surface_points(scene, list(state.shapes))
    labels = surface_labels(scene, points, state.qpos, rig, np.arange(len(clip)) / clip.fps)
    touching = (labels.touches > 0) & (labels.touches < 256)
    frame = int(touching.sum((1, 2)).argmax())
    view = int((labels.visibility[frame] == Visibility.VISIBLE).sum((1, 2)).argmax())
    print(f"frame {frame}, camera {rig.names[view]}: {touching[frame].sum(1).tolist()} points touch the other person")
    with Renderer(scene.model, scene.geom_ids, rig, ImageQuality.high) as renderer:
        picture = renderer.image(state.qpos[frame], view, ("rgb",), seconds=frame / clip.fps).rgb
    scale = 2
    image = cv2.resize(
        np.ascontiguousarray(picture[..., ::-1]), None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC
    )
    plain = image.copy()
    xy = (rig[view : view + 1].project(labels.xyz[frame][None])[0][0, 0] + 0.5) * scale - 0.5
    for person, number in zip(*np.nonzero(labels.visibility[frame, view] <= Visibility.HIDDEN_BY_OBJECT), strict=True):
        code, touches = labels.visibility[frame, view, person, number], touching[frame, person, number]
        place = tuple(int(v) for v in np.round(xy[person, number]))
        seen = code == Visibility.VISIBLE
        cv2.circle(image, place, 4, _RED if touches else _COLOURS[Visibility(code)], -1 if seen else 1, cv2.LINE_AA)
    low, high = np.nanmin(xy, (0, 1)) - 60, np.nanmax(xy, (0, 1)) + 60
    (left, top), (right, bottom) = np.maximum(low, 0).astype(int), high.astype(int)
    both = np.hstack([plain[top:bottom, left:right], image[top:bottom, left:right]])
    cv2.imwrite(str(FILE), both, [cv2.IMWRITE_JPEG_QUALITY, 85])


if __name__ == "__main__":
    main()
