"""Compare the visibility of joints with images of ids, body parts and depth: `docs/results/visibility.json`.

    python docs/tools/forces.py clips=1 keep=runs/interactions
    python docs/tools/visibility.py interactions=runs/interactions      # and six rooms, which it generates

Labels come from rays, images from OpenGL. At the pixel of a joint, the images say which surface is in front, and how
far. A joint must be visible if that is the surface of its own limb at most the depth of the joint in the limb before
it, another limb of the person that touches it, or a surface behind the joint. Pixels are left out where the surface
changes, or where its distance is near the greatest one, within two pixels.
"""

import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from provenance import measured

import synth
from dmae.data.clip import Clip
from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.json_values import json_text
from dmae.data.labels import Visibility
from dmae.data.store import clip_folders, load_clip
from dmae.progress import progress
from synth.labels.visibility import CONTACT
from synth.people.body import PARENTS, landmarks
from synth.physics.body_state import load_state
from synth.physics.simulation import rebuilt_scene
from synth.rendering.config import ImageQuality
from synth.rendering.renderer import Renderer
from synth.rooms.config import room_choices
from synth.scene.spec import SceneSpec

FILE = Path(__file__).parents[2] / "docs/results/visibility.json"
SEED, SECONDS = 95, 3.0
EVERY = 0.5
"""Time between two compared frames, s."""
_MARGIN, _NEAR = 2, 0.008
"""Least distance of a joint from where the surface changes, px, and of the surface from the greatest depth, m."""
_NOTHING = 1e6
"""Depth where there is no surface, m."""
COMMAND = (
    "python docs/tools/forces.py clips=1 keep=runs/interactions && "
    "python docs/tools/visibility.py interactions=runs/interactions"
)
COLUMNS = ["joints that are", "compared", "agree", "wrongly hidden", "wrongly visible"]
KINDS = ("visible", "hidden by the own body", "hidden by another person", "hidden by an object")


def main(interactions: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        rooms = {room: Path(folder, room) for room in room_choices()}
        for number, (room, out) in enumerate(progress(rooms.items(), "rooms", len(rooms))):
            rig = synth.preset("rig", "random" if number % 2 else "ring")
            scene = synth.preset("scene", room, seconds=SECONDS, persons=[3, 5], gathering=0.3)
            list(synth.generate(scene=scene, rig=rig, clips=1, seed=SEED + number, out=out))
        sets = rooms | {each.name: each for each in sorted(Path(interactions).iterdir()) if each.is_dir()}
        found = {name: _compared(clip_folders(out)) for name, out in progress(sets.items(), "comparing", len(sets))}
    total = sum(found.values())
    rows = [
        [kind, *map(str, (each.sum(), each[code], each[0] if code else 0, each[1:].sum() if code == 0 else 0))]
        for code, (kind, each) in enumerate(zip(KINDS, total, strict=True))
    ]
    numbers = {
        "measured": measured("mujoco"),
        "tables": {"joints": {"command": COMMAND, "columns": COLUMNS, "rows": rows}},
        "sets": {name: each.tolist() for name, each in found.items()},
    }
    FILE.write_text(json_text(numbers) + "\n")
    print(np.array2string(total), f"{total.sum()} compared, {total[1:, 0].sum()} wrongly hidden")


def _compared(folders: list[Path]) -> np.ndarray:
    """Return the (4, 4) number of joints by label (rows) and by what the images say (columns)."""
    total = np.zeros((4, 4), int)
    for folder in folders:
        clip, state = load_clip(folder), load_state(folder)
        rig = clip.actual_rig
        scene = rebuilt_scene(clip, state, painted=False)
        frames = range(0, len(clip), max(1, round(EVERY * clip.fps)))
        with Renderer(scene.model, scene.geom_ids, rig, ImageQuality.draft) as renderer:
            for view in range(len(rig)):
                for frame in frames:
                    images = renderer.image(
                        state.qpos[frame], view, ("ids", "parts", "depth"), seconds=frame / clip.fps
                    )
                    total += _of_image(clip, rig, view, frame, images)
    return total


def _of_image(clip: Clip, rig, view: int, frame: int, images) -> np.ndarray:
    """Return the counts of `_compared` for one image."""
    xyz, codes = clip.truth.xyz[frame].astype(float), clip.occlusion.visibility[frame, view]
    xy, along = (part[0, 0] for part in rig[view : view + 1].project(xyz[None]))
    reach = np.linalg.norm(xyz - rig.centers[view], axis=-1)
    total = np.zeros((4, 4), int)
    kernel = np.ones((2 * _MARGIN + 1,) * 2, np.uint8)
    surface = np.nan_to_num(images.depth, nan=_NOTHING)
    nearest, farthest = cv2.erode(surface, kernel), cv2.dilate(surface, kernel)
    same = np.ones(images.ids.shape, bool)
    for image in (images.ids, images.parts):
        same &= cv2.erode(image, kernel) == cv2.dilate(image, kernel)
    for person, spec in enumerate(SceneSpec.of(clip).persons):
        segments, _, depth = landmarks(spec.body, clip.truth.skeleton)
        for joint in np.flatnonzero(codes[person] <= Visibility.HIDDEN_BY_OBJECT):
            column, row = np.round(xy[person, joint]).astype(int).clip(0, rig.size[view] - 1)
            if not same[row, column] or clip.truth.skeleton.joints[joint].endswith("top_head"):
                continue
            owner, part = int(images.ids[row, column]), int(images.parts[row, column]) - 1
            # How far before the joint the surface is, along the ray, m: at most and at least around the pixel.
            before = reach[person, joint] * (1 - np.array([nearest, farthest])[:, row, column] / along[person, joint])
            near = part == segments[joint] or part == PARENTS[segments[joint]] or PARENTS[part] == segments[joint]
            allowed = 0.0
            if owner == 1 + person:
                allowed = depth[joint] if near else min(depth[joint], CONTACT)
            if before[1] - _NEAR < allowed < before[0] + _NEAR:
                continue
            shown = 0
            if before[0] > allowed:
                shown = 1 if owner == 1 + person else 3 if owner >= FIRST_OBJECT_ID else 2
            total[codes[person, joint], shown] += 1
    return total


if __name__ == "__main__":
    given = dict(each.split("=", 1) for each in sys.argv[1:])
    if set(given) != {"interactions"}:
        sys.exit("expected interactions=<what python docs/tools/forces.py keep=... left>")
    main(given["interactions"])
