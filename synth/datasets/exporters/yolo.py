"""YOLO pose in the layout of Ultralytics: `data.yaml`, `images/<split>/`, and one text file per image in
`labels/<split>/`."""

from collections import Counter
from pathlib import Path

import yaml

from dmae.formats.labelled_images.pictures import PersonLabel, Picture
from synth.datasets.exporters.registry import exporter
from synth.datasets.exporters.selection import ClipTask, Selection

_KEYS = {"train": "train", "validation": "val", "test": "test"}
"""Keys of splits in `data.yaml`."""


@exporter("yolo", validation=True)
def export_yolo(selection: Selection, out: Path) -> dict[str, Counter]:
    """YOLO pose: one line per person with class, box and joints, as fractions of the image."""
    found = {split: Counter() for split in selection.splits}
    for task, counts in selection.each_clip(_write_clip, out):
        found[task.split] += counts
    content = {_KEYS.get(split, split): f"images/{split}" for split in selection.splits}
    content["names"] = {0: "person"}
    content["kpt_shape"] = [len(selection.skeleton), 3]
    content["flip_idx"] = list(selection.skeleton.mirror)
    (out / "data.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return found


def _write_clip(task: ClipTask) -> Counter:
    counts = Counter(clips=1)
    for picture in task.pictures(task.load(), counts):
        name = Path(task.write(picture, "images"))
        path = task.out / "labels" / task.split / name.with_suffix(".txt")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(_line(person, picture) + "\n" for person in picture.persons if person.box))
    return counts


def _line(person: PersonLabel, picture: Picture) -> str:
    """Return the line of a person: class, centre, width and height of the box, and x, y, v of each joint.

    Positions are fractions of the image, from its corner. Pixel (0, 0) of our convention is the centre of the first
    pixel.
    """
    width, height = picture.size
    x, y, box_width, box_height = person.box
    # A box around joints is in pixel coordinates, so its origin is the centre of a pixel.
    half = 0 if person.visible_pixels else 0.5
    values = [(x + half + box_width / 2) / width, (y + half + box_height / 2) / height]
    values += [box_width / width, box_height / height]
    for (u, v), flag in zip(person.xy.tolist(), person.flags.tolist(), strict=True):
        values += [(u + 0.5) / width, (v + 0.5) / height, flag] if flag else [0, 0, 0]
    return " ".join(["0", *(f"{value:.6g}" for value in values)])
