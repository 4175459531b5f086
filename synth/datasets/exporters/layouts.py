"""The layouts that are shipped: COCO, YOLO, WebDataset, Hugging Face, NumPy and CMU Panoptic."""

import io
import json
import re
import shutil
import tarfile
from collections import Counter
from dataclasses import fields, replace
from itertools import count
from pathlib import Path
from typing import Any, TextIO

import numpy as np
import yaml

from dmae.data.cameras import CameraRig
from dmae.data.conversion import convert
from dmae.data.labels import Visibility
from dmae.files.structured import read_json
from dmae.formats.calibrations import require, write_calibration
from dmae.formats.coco import annotation_entry, category_entry, clip_entry, image_entry, joint_names
from dmae.formats.labelled_images import LabelledImage, PersonLabel, file_part, joint_labels
from dmae.formats.panoptic import write_poses
from synth.datasets.exporters import exporter
from synth.datasets.exporters.selection import ClipTask, Selection
from synth.labels.forces import ContactSource, PeopleContacts
from synth.labels.physical_labels import FILE, PhysicalLabels, physical_labels
from synth.labels.surfaces import SurfaceLabels

KEYS = (
    "contacts", "weight", "ground_reaction", "centre_of_pressure", "residual", "surface_keypoints",
    "surface_visibility", "surface_hidden_by", "surface_touches",
)  # fmt: skip
"""Keys of an entry. Each kind of physical labels has some of them."""


def _physical_labels(folder: Path) -> PhysicalLabels:
    return physical_labels(folder) if (folder / FILE).is_file() else PhysicalLabels()


class PhysicalEntries:
    """The entries of one clip. Entries are empty if the clip has no physical labels.

    Args:
        folder: Folder of the clip.
        rig: True cameras of the clip.
    """

    def __init__(self, folder: Path, rig: CameraRig):
        self._labels, self._rig = _physical_labels(folder), rig
        contacts = self._labels.contacts
        self._persons = np.empty((0, 2)) if contacts is None else contacts.persons

    def of(self, image: LabelledImage, person: PersonLabel) -> dict:
        """Return the entry of a person in an image, with the known keys of `KEYS`."""
        found: dict[str, Any] = {}
        if self._labels.contacts is not None:
            found["contacts"] = self._contacts(self._labels.contacts, image.frame, person.person)
        if (forces := self._labels.forces) is not None:
            at = image.frame, person.person
            found |= {"weight": round(float(forces.weights[person.person]), 2)}
            found |= {
                name: [_known(values, digits) for values in getattr(forces, name)[at]]
                for name, digits in (("ground_reaction", 2), ("centre_of_pressure", 4), ("residual", 2))
            }
        if self._labels.surface is not None:
            found |= self._surface(self._labels.surface, image, person.person)
        return found

    def _contacts(self, contacts: PeopleContacts, frame: int, person: int) -> list[dict]:
        found = []
        first, last = np.searchsorted(contacts.frame, (frame, frame + 1))
        for number in range(first, last):
            for side in (1, 0):
                if self._persons[number, side] != person:
                    continue
                part, other = (contacts.names[contacts.between[number, each]] for each in (side, 1 - side))
                force = contacts.force[number] * (1 if side else -1)
                found.append(
                    {
                        "part": part.partition("/")[2],
                        "with": other,
                        "xyz": _known(contacts.point[number], 4),
                        "force": _known(force, 2),
                        "depth": round(float(contacts.depth[number]), 4),
                        "source": ContactSource(contacts.source[number]).name.lower(),
                    }
                )
        return found

    def _surface(self, surface: SurfaceLabels, image: LabelledImage, person: int) -> dict:
        frame, view = image.frame, image.view
        xy = self._rig[view : view + 1].project(surface.xyz[frame, person][None])[0][0, 0]
        codes = surface.visibility[frame, view, person]
        flags = np.select([codes == Visibility.VISIBLE, codes <= Visibility.HIDDEN_BY_OBJECT], [2, 1], 0)
        points = np.where(flags[:, None] > 0, xy, 0).round(2).tolist()
        return {
            "surface_keypoints": [v for (x, y), flag in zip(points, flags.tolist(), strict=True) for v in (x, y, flag)],
            "surface_visibility": codes.tolist(),
            "surface_hidden_by": surface.hidden_by[frame, view, person].tolist(),
            "surface_touches": surface.touches[frame, person].tolist(),
        }


def _known(values: np.ndarray, digits: int) -> list[float] | None:
    """Return rounded numbers as a list; None if one is NaN, because JSON has no NaN."""
    return None if np.isnan(values).any() else [round(value, digits) for value in values.tolist()]


def _world(person: PersonLabel) -> list[list[float] | None]:
    """Return the joints in the world, m, to 0.1 mm; None where absent."""
    return [_known(joint, 4) for joint in np.asarray(person.xyz)]


def _write_lines(path: Path, lines: list[dict]) -> None:
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


# COCO keypoints: `annotations/person_keypoints_<split>.json` and `images/<split>/`.


@exporter("coco")
def export_coco(selection: Selection, out: Path) -> dict[str, Counter]:
    """COCO keypoints with masks as run lengths, boxes, and the occluder of each joint."""
    found = selection.export(_write_coco_clip, out)
    (out / "annotations").mkdir()
    for split in selection.splits:
        tasks = [task for task in selection.tasks(out) if task.split == split]
        with (out / f"annotations/person_keypoints_{split}.json").open("w") as file:
            _join(file, tasks, category_entry(selection.skeleton))
    return found


def _write_coco_clip(task: ClipTask) -> Counter:
    """Write the images of a clip, and the entries of its images and annotations with ids from 1 on. Return counts."""
    clip, counts = task.load(), Counter(clips=1)
    images, annotations = [], []
    physical = PhysicalEntries(task.folder, clip.rig)
    for image in task.images(clip, counts, depth=True):
        entry = image_entry(image, len(images) + 1, task.write(image, "images"))
        images.append(entry | task.write_depth(image, "images", "depth_file_name") | {"clip": task.name})
        for person in image.persons:
            entry = annotation_entry(person, len(annotations) + 1, len(images))
            annotations.append(entry | physical.of(image, person))
    _write_lines(task.part("images"), images)
    _write_lines(task.part("annotations"), annotations)
    task.part("clip").write_text(json.dumps(clip_entry(clip)))
    return counts


def _join(file: TextIO, tasks: list[ClipTask], category: dict) -> None:
    """Write the entries of all clips as one JSON with new ids. Only one entry is in memory at a time."""
    info = {"clips": {task.name: read_json(task.part("clip")) for task in tasks}}
    file.write(f'{{"info": {json.dumps(info)}, "categories": {json.dumps([category])}')
    file.write(', "images": [\n')
    separator, number, before = "", 0, []
    for task in tasks:
        before.append(number)
        with task.part("images").open() as lines:
            for line in lines:
                number += 1
                file.write(separator + json.dumps(json.loads(line) | {"id": number}))
                separator = ",\n"
    file.write('], "annotations": [\n')
    separator, number = "", 0
    for task, first in zip(tasks, before, strict=True):
        with task.part("annotations").open() as lines:
            for line in lines:
                entry, number = json.loads(line), number + 1
                file.write(separator + json.dumps(entry | {"id": number, "image_id": first + entry["image_id"]}))
                separator = ",\n"
    file.write("]}\n")


# YOLO pose in the layout of Ultralytics: `data.yaml`, `images/<split>/`, and one text file per image in
# `labels/<split>/`.

_KEYS = {"train": "train", "validation": "val", "test": "test"}
"""Keys of splits in `data.yaml`."""


@exporter("yolo", validation=True)
def export_yolo(selection: Selection, out: Path) -> dict[str, Counter]:
    """YOLO pose: one line per person with class, box and joints, as fractions of the image."""
    found = selection.export(_write_yolo_clip, out)
    content: dict[str, Any] = {_KEYS.get(split, split): f"images/{split}" for split in selection.splits}
    content["names"] = {0: "person"}
    content["kpt_shape"] = [len(selection.skeleton), 3]
    content["flip_idx"] = list(selection.skeleton.mirror)
    (out / "data.yaml").write_text(yaml.safe_dump(content, sort_keys=False))
    return found


def _write_yolo_clip(task: ClipTask) -> Counter:
    counts = Counter(clips=1)
    for image in task.images(task.load(), counts, masks=False):
        name = Path(task.write(image, "images"))
        path = task.out / "labels" / task.split / name.with_suffix(".txt")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(_line(person, image) + "\n" for person in image.persons if person.box))
    return counts


def _line(person: PersonLabel, image: LabelledImage) -> str:
    """Return the line of a person: class, box centre and size, and x, y, v of each joint, as fractions from the image's
    corner."""
    assert person.box is not None
    width, height = image.size
    x, y, box_width, box_height = person.box
    # A box around joints is in pixel coordinates, so its origin is the centre of a pixel.
    half = 0 if person.visible_pixels else 0.5
    values = [(x + half + box_width / 2) / width, (y + half + box_height / 2) / height]
    values += [box_width / width, box_height / height]
    for (u, v), flag in zip(person.xy.tolist(), person.flags.tolist(), strict=True):
        values += [(u + 0.5) / width, (v + 0.5) / height, flag] if flag else [0, 0, 0]
    return " ".join(["0", *(f"{value:.6g}" for value in values)])


# WebDataset: tar shards of images and their labels, which are read sequentially.

SHARD_BYTES = 10**9
"""A new shard begins after this number of bytes. All images of a clip are in the same shard."""


@exporter("webdataset")
def export_webdataset(selection: Selection, out: Path) -> dict[str, Counter]:
    """Tar shards `<split>-000000.tar` of `<clip>/<camera>/<frame>.jpg`, `.json`, and `.depth.npz` if there is depth."""
    found = {split: Counter() for split in selection.splits}
    shard = None
    try:
        for task, counts in selection.each_clip(_write_webdataset_clip, out):
            part, split = task.part("tar"), found[task.split]
            if shard and (not split or shard.offset > SHARD_BYTES):
                shard.close()
                shard = None
            if shard is None:
                shard = tarfile.open(out / f"{task.split}-{split['shards']:06d}.tar", "w")  # noqa: SIM115
                split["shards"] += 1
            split += counts
            with tarfile.open(part) as members:
                for member in members:
                    shard.addfile(member, members.extractfile(member))
            part.unlink()
    finally:
        if shard:
            shard.close()
    return found


def _write_webdataset_clip(task: ClipTask) -> Counter:
    clip, counts = task.load(), Counter(clips=1)
    about = clip_entry(clip) | {"clip": task.name, "joints": joint_names(task.skeleton)}
    physical = PhysicalEntries(task.folder, clip.rig)
    with tarfile.open(task.part("tar"), "w") as tar:
        for image in task.images(clip, counts, depth=True):
            persons = []
            for number, person in enumerate(image.persons, 1):
                entry = annotation_entry(person, number, 0)
                entry = {key: value for key, value in entry.items() if not key.endswith("id") or key == "track_id"}
                persons.append(entry | {"xyz": _world(person)} | physical.of(image, person))
            camera = camera_entry(clip.rig, image.view)
            label = about | {"camera": camera, "frame": image.number, "persons": persons}
            files = {task.suffix: image.encoded(task.suffix), "json": json.dumps(label).encode()}
            if image.depth is not None:
                # Not PNG: readers of shards decode each PNG as 8 bits of colour, and silently clip millimetres.
                np.savez_compressed(stream := io.BytesIO(), depth=image.depth)
                files["depth.npz"] = stream.getvalue()
            for suffix, data in files.items():
                member = tarfile.TarInfo(f"{task.file_name(image)}.{suffix}")
                member.size = len(data)
                tar.addfile(member, io.BytesIO(data))
    return counts


def camera_entry(rig: CameraRig, view: int) -> dict:
    """Return name, size and calibration of a camera, with the fields of `CameraRig`."""
    return {
        "name": rig.names[view],
        "size": rig.size[view].tolist(),
        "K": rig.K[view].tolist(),
        "dist": rig.dist[view].tolist(),
        "fisheye": bool(rig.fisheye[view]),
        "cam_from_world": rig.cam_from_world[view].tolist(),
    }


# Hugging Face `datasets`: one image folder per split, with `metadata.jsonl`.

METADATA = "metadata.jsonl"
PERSONS = (
    "track_id", "bbox", "bbox_of", "area", "keypoints", "xyz", "segmentation", "visibility", "hidden_by",
    "visible_pixels", "amodal_pixels", "amodal_segmentation", "amodal_bbox", *KEYS,
)  # fmt: skip
"""Keys of `persons`, as in COCO's annotations: each a list with one entry per person. Keys that a clip does not have
are left out, because a column of nulls has no type."""


@exporter("huggingface")
def export_huggingface(selection: Selection, out: Path) -> dict[str, Counter]:
    """Image folders that `datasets.load_dataset` reads, with the persons of each image."""
    found = selection.export(_write_huggingface_clip, out)
    for task in selection.tasks(out):
        with (out / task.split / METADATA).open("ab") as joined, task.part("jsonl").open("rb") as part:
            shutil.copyfileobj(part, joined)
    return found


def _write_huggingface_clip(task: ClipTask) -> Counter:
    clip, counts = task.load(), Counter(clips=1)
    about = clip_entry(clip) | {"clip": task.name}
    lines, of_persons, physical = [], [], PhysicalEntries(task.folder, clip.rig)
    for image in task.images(clip, counts, depth=True):
        files = {"file_name": task.write(image, ""), **task.write_depth(image, "", "depth_file_name")}
        camera = camera_entry(clip.rig, image.view)
        lines.append({**files, **about, "camera": camera, "frame": image.number})
        of_persons.append(
            [annotation_entry(each, 0, 0) | {"xyz": _world(each)} | physical.of(image, each) for each in image.persons]
        )
    known = [key for key in PERSONS if any(entry.get(key, []) != [] for entries in of_persons for entry in entries)]
    for line, entries in zip(lines, of_persons, strict=True):
        line["persons"] = {key: [entry[key] for entry in entries] for key in known}
    _write_lines(task.part("jsonl"), lines)
    return counts


# NumPy: one `.npz` per clip with its cameras, truth and labels, for programs without this package.


@exporter("npz", images=False, skeleton="body25")
def export_npz(selection: Selection, out: Path) -> dict[str, Counter]:
    """One numpy file per clip: cameras, joints, visibility, and physical labels if there are any."""
    return selection.export(_write_npz_clip, out)


def _write_npz_clip(task: ClipTask) -> Counter:
    clip = task.load()
    assert clip.truth is not None
    frames = slice(None, None, task.every)
    labels = joint_labels(clip, clip.truth, task.skeleton)
    arrays = {
        "fps": np.array(clip.fps / task.every),
        "frames": np.arange(len(clip))[frames],
        "cameras": np.array(clip.rig.names),
        **{f"camera.{name}": getattr(clip.rig, name) for name in ("K", "dist", "cam_from_world", "size", "fisheye")},
        "joint_names": np.array(task.skeleton.joints),
        "joints": convert(clip.truth, task.skeleton).xyz[frames],
        "joints_2d": labels.xy[frames],
        **({} if labels.cause is None else {"visibility": labels.cause[frames]}),
        **({} if labels.occluder is None else {"hidden_by": labels.occluder[frames]}),
        "objects": np.array(clip.occlusion.objects if clip.occlusion else (), dtype=str),
        **physical_arrays(task.folder, task.every),
    }
    np.savez_compressed(task.file("npz"), **arrays)
    return Counter(clips=1, persons=clip.truth.xyz.shape[1])


def physical_arrays(folder: Path, every: int = 1) -> dict[str, Any]:
    """Return arrays of the physical labels of a clip, for one frame in `every`: `contacts.*`, `forces.*`, `surface.*`.

    Contacts keep the frame numbers of the clip. The result is empty if the clip has no physical labels.
    """
    labels, found = _physical_labels(folder), {}
    for kind in labels.kinds:
        part = getattr(labels, kind)
        kept = part.frame % every == 0 if kind == "contacts" else slice(None, None, every)
        for name in (field.name for field in fields(part)):
            values = np.array(getattr(part, name))
            found[f"{kind}.{name}"] = values if name in ("names", "weights") else values[kept]
    return found


# CMU Panoptic Studio: one folder per sequence, with calibration, poses and images.

IMAGES = "hdImgs"
PHYSICS = "physics.npz"


@exporter("panoptic", images=False, skeleton="panoptic19", only=True)
def export_panoptic(selection: Selection, out: Path) -> dict[str, Counter]:
    """One folder per clip in the layout of CMU Panoptic: calibration, poses in 3D, and images if there are any."""
    return selection.export(_write_panoptic_clip, out)


def _write_panoptic_clip(task: ClipTask) -> Counter:
    """Write one sequence, and return counts. Cameras without a name <panel>_<node> become nodes of panel 0."""
    clip = task.load()
    assert clip.truth is not None
    require("a Panoptic calibration", clip.rig, coefficients=5)  # before cameras are renamed and images written
    counts = Counter(clips=1, persons=clip.truth.xyz.shape[1])
    taken = {name for name in clip.rig.names if re.fullmatch(r"\d\d_\d\d", name)}
    free = (name for node in count() if (name := f"00_{node:02}") not in taken)
    names = [name if name in taken else next(free) for name in clip.rig.names]
    folder = task.out / task.split / file_part(task.name)
    for image in task.images(clip, Counter()) if clip.has_images else ():
        counts["images"] += 1
        camera = names[image.view]
        path = folder / IMAGES / camera / f"{camera}_{image.number:08d}.{task.suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(image.encoded(task.suffix))
    calibration = folder / f"calibration_{file_part(clip.id)}.json"
    write_calibration(replace(clip.rig, names=tuple(names)), calibration, "panoptic")
    first = clip.provenance.get("first_frame", 0)
    write_poses(convert(clip.truth, task.skeleton), clip.fps, folder, first, task.every)
    if physical := physical_arrays(task.folder, task.every):
        np.savez_compressed(folder / PHYSICS, **physical)
    return counts
