"""WebDataset: tar shards of images and their labels, which are read sequentially."""

import io
import json
import tarfile
from collections import Counter
from pathlib import Path

from dmae.data.cameras import CameraRig
from dmae.formats.labelled_images.coco_entries import annotation_entry, clip_entry
from dmae.formats.recordings.coco_categories import joint_names
from synth.datasets.exporters.physical_entries import PhysicalEntries
from synth.datasets.exporters.registry import exporter
from synth.datasets.exporters.selection import ClipTask, Selection, world_joints

SHARD_BYTES = 10**9
"""A new shard begins after this number of bytes. All images of a clip are in the same shard."""


@exporter("webdataset")
def export_webdataset(selection: Selection, out: Path) -> dict[str, Counter]:
    """Tar shards `<split>-000000.tar` of `<clip>/<camera>/<frame>.jpg` and `.json`."""
    found = {split: Counter() for split in selection.splits}
    shard = None
    try:
        for task, counts in selection.each_clip(_write_clip, out):
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


def _write_clip(task: ClipTask) -> Counter:
    clip, counts = task.load(), Counter(clips=1)
    about = clip_entry(clip) | {"clip": task.name, "joints": joint_names(task.skeleton)}
    physical = PhysicalEntries(task.folder, clip.rig)
    with tarfile.open(task.part("tar"), "w") as tar:
        for picture in task.pictures(clip, counts):
            persons = []
            for number, person in enumerate(picture.persons, 1):
                entry = annotation_entry(person, number, 0)
                persons.append(
                    {key: value for key, value in entry.items() if not key.endswith("id") or key == "track_id"}
                )
                persons[-1] |= {"xyz": world_joints(person)} | physical.of(picture, person)
            label = about | {
                "camera": camera_entry(clip.rig, picture.view),
                "frame": picture.number,
                "persons": persons,
            }
            for suffix, data in ((task.suffix, picture.encoded(task.suffix)), ("json", json.dumps(label).encode())):
                member = tarfile.TarInfo(f"{task.file_name(picture)}.{suffix}")
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
