"""Why does a detector miss people? Draw each of them again with one thing changed: `docs/results/missed.json`.

    python docs/tools/missed.py data=runs/low       # the set of `COMMAND`

Pose, camera, light and background stay. The person is found if the detector finds it in any of the meter's crops.
"""

import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from provenance import measured

from dmae.data.clip import Clip
from dmae.data.images import FIRST_OBJECT_ID
from dmae.data.json_values import json_text
from dmae.data.labels import Visibility
from dmae.data.store import clip_folders, load_clip
from dmae.detection.pipeline import make_detector
from dmae.detection.registry import PoseDetectorConfig
from synth.people.skinning import let_swing
from synth.physics.body_state import BodyState, load_state
from synth.recognition.realism import Crop, crops, found_in, sightings
from synth.rendering.renderer import Renderer
from synth.scene.build import build_scene
from synth.scene.spec import SceneSpec

FILE = Path(__file__).parents[2] / "docs/results/missed.json"
COMMAND = (
    "synth generate scene=office rig=ring rig.ring.views=3 images=rgb rgb=jpeg scene.fps=1 scene.seconds=8 first=1 "
    "clips=1 seed=87 'motion.actions=[sit,bend,crouch,lift]' out=runs/low && python docs/tools/missed.py data=runs/low"
)
_UNDRAWN = 5
"""A geom group that is not drawn."""


def main(data: str) -> None:
    detector, rows, people = make_detector(PoseDetectorConfig(windows=[1.0], search_every=1)), [], 0
    for folder in clip_folders(Path(data)):
        clip, state = load_clip(folder), load_state(folder)
        seen = sightings(clip)
        for crop in crops(clip, seen, detector):
            people += 1
            if crop.found:
                continue
            place = (crop.frame, crop.view, crop.person)
            row = {"cut off by the border": bool((seen.visibility[place] == Visibility.OUTSIDE_IMAGE).any())}
            for change, image in _changed(clip, state, crop):
                row[change] = found_in(image, seen, place, detector).found
            rows.append(row)
    changes = [change for change in rows[0] if change != "cut off by the border"]
    table = []
    for name, cut in (("whole in the image", False), ("cut off by the border", True)):
        some = [row for row in rows if row["cut off by the border"] == cut]
        table.append([name, str(len(some)), *(str(sum(row[change] for row in some)) for change in changes)])
    columns = [f"missed, of {people} people", "number", *changes]
    tables = {"missed": {"command": COMMAND, "columns": columns, "rows": table}}
    FILE.write_text(json_text({"measured": measured("mujoco"), "tables": tables, "people": rows}) + "\n")


def _changed(clip: Clip, state: BodyState, crop: Crop) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the image of a person with each change."""
    spec, rig = SceneSpec.of(clip), clip.actual_rig
    looks = spec.persons[crop.person].looks
    persons = list(spec.persons)
    persons[crop.person] = replace(persons[crop.person], looks=replace(looks, top=replace(looks.top, pattern="plain")))
    for change, others, things, drawn in (
        ("drawn again", True, True, spec),
        ("without other people", False, True, spec),
        ("without people and things", False, False, spec),
        ("in a plain shirt", True, True, replace(spec, persons=tuple(persons))),
    ):
        scene = build_scene(drawn, rig)
        let_swing(scene.model, state.qpos, clip.fps)
        ids, group = scene.geom_ids, scene.model.geom_group
        if not others:
            group[(ids > 0) & (ids < FIRST_OBJECT_ID) & (ids != 1 + crop.person)] = _UNDRAWN
        if not things:
            left = [FIRST_OBJECT_ID + k for k, name in enumerate(scene.objects) if name.startswith(("floor", "wall"))]
            group[(ids >= FIRST_OBJECT_ID) & ~np.isin(ids, left)] = _UNDRAWN
        with Renderer(scene.model, ids, rig) as renderer:
            seconds = crop.frame / clip.fps
            yield change, renderer.image(state.qpos[crop.frame], crop.view, ("rgb",), seconds=seconds).rgb


if __name__ == "__main__":
    given = dict(each.split("=", 1) for each in sys.argv[1:])
    if set(given) != {"data"}:
        sys.exit("expected data=<a data set with colour images>")
    main(given["data"])
