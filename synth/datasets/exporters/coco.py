"""COCO keypoints: `annotations/person_keypoints_<split>.json` and `images/<split>/`."""

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from dmae.files.structured import read_json
from dmae.formats.labelled_images.coco_entries import annotation_entry, category_entry, clip_entry, image_entry
from synth.datasets.exporters.physical_entries import PhysicalEntries
from synth.datasets.exporters.registry import exporter
from synth.datasets.exporters.selection import ClipTask, Selection, write_lines


@exporter("coco")
def export_coco(selection: Selection, out: Path) -> dict[str, Counter]:
    """COCO keypoints with masks as run lengths, boxes, and the occluder of each joint."""
    found = {split: Counter() for split in selection.splits}
    tasks: dict[str, list[ClipTask]] = {split: [] for split in selection.splits}
    for task, counts in selection.each_clip(_write_clip, out):
        found[task.split] += counts
        tasks[task.split].append(task)
    (out / "annotations").mkdir()
    for split, each in tasks.items():
        with (out / f"annotations/person_keypoints_{split}.json").open("w") as file:
            _join(file, each, category_entry(selection.skeleton))
    return found


def _write_clip(task: ClipTask) -> Counter:
    """Write the images of a clip, and the entries of its images and annotations with ids from 1 on. Return counts."""
    clip, counts = task.load(), Counter(clips=1)
    images, annotations = [], []
    physical = PhysicalEntries(task.folder, clip.rig)
    for picture in task.pictures(clip, counts):
        images.append(image_entry(picture, len(images) + 1, task.write(picture, "images")) | {"clip": task.name})
        for person in picture.persons:
            entry = annotation_entry(person, len(annotations) + 1, len(images))
            annotations.append(entry | physical.of(picture, person))
    write_lines(task.part("images"), images)
    write_lines(task.part("annotations"), annotations)
    task.part("clip").write_text(json.dumps(clip_entry(clip)))
    return counts


def _join(file: TextIO, tasks: list[ClipTask], category: dict) -> None:
    """Write the entries of all clips as one JSON with new ids. Only one entry is in memory at a time."""
    info = {"clips": {task.name: read_json(task.part("clip")) for task in tasks}}
    file.write(f'{{"info": {json.dumps(info)}, "categories": {json.dumps([category])}')
    images_before = [0]
    file.write(', "images": [\n')
    separator = ""
    for task in tasks:
        count = 0
        for line in _lines(task.part("images")):
            file.write(separator + json.dumps(line | {"id": images_before[-1] + line["id"]}))
            separator, count = ",\n", count + 1
        images_before.append(images_before[-1] + count)
    file.write('], "annotations": [\n')
    separator, number = "", 0
    for task, before in zip(tasks, images_before, strict=False):
        for line in _lines(task.part("annotations")):
            number += 1
            file.write(separator + json.dumps(line | {"id": number, "image_id": before + line["image_id"]}))
            separator = ",\n"
    file.write("]}\n")


def _lines(path: Path) -> Iterator[dict]:
    with path.open() as file:
        yield from map(json.loads, file)
