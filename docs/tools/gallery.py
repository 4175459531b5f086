"""Draw three clips of each interaction at the moment of most contact: `docs/images/interactions.jpg`.

    python docs/tools/forces.py clips=3 keep=runs/interactions
    python docs/tools/gallery.py data=runs/interactions

The camera is one of eight around the people: the one in which the least visible person has the most visible pixels.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

from dmae.data.cameras import CameraRig
from dmae.data.store import clip_folders, load_clip
from dmae.progress import progress
from synth.physics.body_state import BodyState, load_state
from synth.physics.simulation import rebuilt_scene
from synth.rendering.config import ImageQuality
from synth.rendering.renderer import Renderer
from synth.scene.spec import SceneSpec

OUT = Path(__file__).parents[2] / "docs/images/interactions.jpg"
CLIPS, COLUMNS = 3, 7
SIZE, SHARPER = (240, 200), 2
"""Width and height of an image, px, and how much larger it is drawn."""
_AROUND, _ABOVE, _LENS = 8, 0.9, 1.15
"""Cameras, their height above the hips, m, and their focal length in widths of the image."""
_HEAD = 24


def main(data: Path, out: Path) -> None:
    kinds = sorted(each.name for each in data.iterdir() if (each / "manifest.jsonl").is_file())
    kinds = [kind for kind in kinds if kind not in ("none", "office")]
    tasks = [(kind, folder) for kind in kinds for folder in clip_folders(data / kind)[:CLIPS]]
    drawn = dict.fromkeys(kinds, ())
    for (kind, _), image in zip(tasks, progress(map(_draw, tasks), "drawing", len(tasks)), strict=True):
        drawn[kind] += (image,)
    blank = np.full((SIZE[1], SIZE[0], 3), 255, np.uint8)
    rows = []
    for first in range(0, len(kinds), COLUMNS):
        some = kinds[first : first + COLUMNS]
        some += [""] * (COLUMNS - len(some))
        rows.append(np.hstack([_title(kind) for kind in some]))
        columns = [(drawn.get(kind, ()) + (blank,) * CLIPS)[:CLIPS] for kind in some]
        rows += [np.hstack(row) for row in zip(*columns, strict=True)]
    cv2.imwrite(str(out), np.vstack(rows)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])


def _title(kind: str) -> np.ndarray:
    title = np.full((_HEAD, SIZE[0], 3), 244, np.uint8)
    words = kind.replace("_", " ")
    return cv2.putText(title, words, (6, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (20, 20, 20), 1, cv2.LINE_AA)


def _draw(task: tuple[str, Path]) -> np.ndarray:
    """Return an image (H, W, 3) of a clip."""
    _, folder = task
    clip, state = load_clip(folder), load_state(folder)
    frame = _moment(state)
    spec = SceneSpec.of(clip)
    taking_part = len(spec.persons) - spec.interaction.bystanders
    hips = state.root[frame, :taking_part]
    rig = _cameras(hips.mean(0), 0.9 * np.linalg.norm(np.ptp(hips[:, :2], axis=0)) + 2.2)
    scene = rebuilt_scene(clip, state, rig)
    qpos, seconds = state.qpos[frame], frame / clip.fps
    with Renderer(scene.model, scene.geom_ids, rig, ImageQuality.draft) as renderer:
        shown = [
            _least(renderer.image(qpos, view, ("ids",), seconds=seconds).ids, taking_part) for view in range(len(rig))
        ]
    best = int(np.argmax(shown))
    with Renderer(scene.model, scene.geom_ids, rig, ImageQuality.high) as renderer:
        image = renderer.image(qpos, best, ("rgb",), seconds=seconds).rgb
    return cv2.resize(image, SIZE, interpolation=cv2.INTER_AREA)


def _least(ids: np.ndarray, persons: int) -> int:
    """Return the number of visible pixels of the least visible person."""
    return int(np.bincount(ids.ravel(), minlength=1 + persons)[1 : 1 + persons].min())


def _moment(state: BodyState) -> int:
    """Return the frame of the largest force in the second with the most force.

    Forces between people and forces on anything other than the floor count. Forces between legs do not count. Without
    any such force, return the middle frame.
    """
    owner = np.array([name.partition("/")[0] for name in state.contact_names])
    leg = np.array([name.endswith(("thigh", "shin", "foot")) for name in state.contact_names])
    one, other = owner[state.contact_between].T
    counted = (one != other) & (one != "floor") & (other != "floor") & ~leg[state.contact_between].all(1)
    force = np.zeros(len(state.qpos))
    np.add.at(force, state.contact_frame[counted], np.linalg.norm(state.contact_force[counted], axis=1))
    begin = int(np.argmax(np.convolve(force, np.ones(25), "valid")))
    return begin + int(np.argmax(force[begin : begin + 25])) if force.any() else len(force) // 2


def _cameras(middle: np.ndarray, distance: float) -> CameraRig:
    """Return cameras on a circle around a point (3,), m, which look at it."""
    width, height = (SHARPER * size for size in SIZE)
    poses = []
    for angle in np.linspace(0, 2 * np.pi, _AROUND, endpoint=False):
        centre = middle + distance * np.array((np.cos(angle), np.sin(angle), 0)) + (0, 0, _ABOVE)
        ahead = middle - centre
        ahead /= np.linalg.norm(ahead)
        right = np.cross(ahead, (0, 0, 1))
        right /= np.linalg.norm(right)
        turn = np.stack([right, np.cross(ahead, right), ahead])
        poses.append(np.block([[turn, -(turn @ centre)[:, None]], [np.zeros((1, 3)), np.ones((1, 1))]]))
    lens = np.array([[_LENS * width, 0, width / 2 - 0.5], [0, _LENS * width, height / 2 - 0.5], [0, 0, 1]])
    names = [str(number) for number in range(_AROUND)]
    return CameraRig(
        names, np.tile(lens, (_AROUND, 1, 1)), np.zeros((_AROUND, 5)), np.array(poses), [(width, height)] * _AROUND
    )


if __name__ == "__main__":
    options = dict(argument.split("=") for argument in sys.argv[1:])
    main(Path(options["data"]), Path(options.get("out", OUT)))
