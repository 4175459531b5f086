"""Hugging Face `datasets`: one image folder per split, with `metadata.jsonl`."""

import shutil
from collections import Counter
from pathlib import Path

from dmae.formats.labelled_images.coco_entries import annotation_entry, clip_entry
from synth.datasets.exporters.physical_entries import KEYS, PhysicalEntries
from synth.datasets.exporters.registry import exporter
from synth.datasets.exporters.selection import ClipTask, Selection, world_joints, write_lines
from synth.datasets.exporters.webdataset import camera_entry

METADATA = "metadata.jsonl"
PERSONS = (
    "track_id", "bbox", "bbox_of", "area", "keypoints", "xyz", "segmentation", "visibility", "hidden_by",
    "visible_pixels", "amodal_pixels", "amodal_segmentation", "amodal_bbox", *KEYS,
)  # fmt: skip
"""Keys of `persons`, as in COCO's annotations: each a list with one entry per person. Keys that a clip does not have
are left out, because a column of nulls has no type."""


@exporter("huggingface")
def export_huggingface(selection: Selection, out: Path) -> dict[str, Counter]:
    """Image folders that `datasets.load_dataset` reads, with the persons of each picture."""
    found = {split: Counter() for split in selection.splits}
    for task, counts in selection.each_clip(_write_clip, out):
        found[task.split] += counts
        with (out / task.split / METADATA).open("ab") as joined, task.part("jsonl").open("rb") as part:
            shutil.copyfileobj(part, joined)
    return found


def _write_clip(task: ClipTask) -> Counter:
    clip, counts = task.load(), Counter(clips=1)
    about = clip_entry(clip) | {"clip": task.name}
    lines, of_persons, physical = [], [], PhysicalEntries(task.folder, clip.rig)
    for picture in task.pictures(clip, counts):
        camera = camera_entry(clip.rig, picture.view)
        lines.append({"file_name": task.write(picture, ""), **about, "camera": camera, "frame": picture.number})
        of_persons.append(
            [
                annotation_entry(each, 0, 0) | {"xyz": world_joints(each)} | physical.of(picture, each)
                for each in picture.persons
            ]
        )
    known = [key for key in PERSONS if any(entry.get(key, []) != [] for entries in of_persons for entry in entries)]
    for line, entries in zip(lines, of_persons, strict=True):
        line["persons"] = {key: [entry[key] for entry in entries] for key in known}
    write_lines(task.part("jsonl"), lines)
    return counts
