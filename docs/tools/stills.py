"""Complete single frames of captured people: `docs/results/stills.json`.

    python docs/tools/stills.py CAPTURED...     # data sets with truth that `dmae capture` wrote, as of `make gains`

One frame a second is completed by itself, by the shipped weights, and by hanging the joints of the mean pose of their
training data on those that are seen.
"""

import sys
from pathlib import Path

import numpy as np
from provenance import measured

from dmae.completion.complete import completers
from dmae.completion.training_data import pose_pair
from dmae.completion.windows import make_rows
from dmae.data.clip import Poses3D
from dmae.data.json_values import json_text
from dmae.data.skeleton import BODY25
from dmae.data.store import clip_folders, load_clip
from dmae.progress import progress

FILE = Path(__file__).parents[1] / "results/stills.json"
FPS = 25
_EVERY, _FEWEST = 25, 5
"""Frames from one still to the next, and the least number of measured joints of a person who is completed."""
KINDS = ("that one camera detected", "that no camera detected", "all")


def measure(folders: list[Path]) -> dict[str, np.ndarray]:
    """Return sums of errors, mm, of the mean pose and of completion, and the number of unmeasured joints, by kind."""
    complete = completers(None, smooth=0.0)(BODY25)
    rest = complete.model.rest.numpy()
    sums = {kind: np.zeros(3) for kind in KINDS}
    for clip in progress([clip for folder in folders for clip in clip_folders(folder)], "completing"):
        pair = pose_pair(load_clip(clip), BODY25, FPS)
        if pair.captured is None:
            continue
        given, truth = (poses.select(slice(0, None, _EVERY)) for poses in (pair.captured, pair.truth))
        counted = ~given.measured & ~np.isnan(truth.xyz).any(-1) & (given.measured.sum(-1) >= _FEWEST)[..., None]
        ray = ~np.isnan(given.rays[..., 0, 0])
        alone = Poses3D(BODY25, given.xyz.reshape(1, -1, *given.xyz.shape[2:]))
        hung = make_rows(alone, FPS, rest, 1).base.reshape(given.xyz.shape)
        errors = [1000 * np.linalg.norm(xyz - truth.xyz, axis=-1) for xyz in (hung, complete(given, 0.5).xyz)]
        for kind, chosen in zip(KINDS, (counted & ray, counted & ~ray, counted), strict=True):
            sums[kind] += [*(error[chosen].sum() for error in errors), chosen.sum()]
    return sums


if __name__ == "__main__":
    found = measure([Path(folder) for folder in sys.argv[1:]])
    rows = [[kind, str(int(n)), f"{mean / n:.0f}", f"{done / n:.0f}"] for kind, (mean, done, n) in found.items()]
    table = {"columns": ["unmeasured joints", "number", "mean pose, mm", "completed, mm"], "rows": rows}
    table |= {"command": "make gains && python docs/tools/stills.py runs/gains/captured/*"}
    FILE.write_text(json_text({"measured": measured("torch"), "tables": {"stills": table}}) + "\n")
    print(FILE)
