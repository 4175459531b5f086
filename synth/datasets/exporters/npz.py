"""NumPy: one `.npz` per clip with its cameras, truth and labels, for programs without this package."""

from collections import Counter
from dataclasses import fields
from pathlib import Path

import numpy as np

from dmae.data.conversion import convert
from dmae.formats.labelled_images.joints import joint_labels
from dmae.formats.labelled_images.pictures import file_part
from synth.datasets.exporters.registry import exporter
from synth.datasets.exporters.selection import ClipTask, Selection
from synth.labels.physical_labels import FILE, PhysicalLabels, load_physical_labels


@exporter("npz", pictures=False, skeleton="body25")
def export_npz(selection: Selection, out: Path) -> dict[str, Counter]:
    """One numpy file per clip: cameras, joints, visibility, and physical labels if there are any."""
    found = {split: Counter() for split in selection.splits}
    for task, counts in selection.each_clip(_write_clip, out):
        found[task.split] += counts
    return found


def _write_clip(task: ClipTask) -> Counter:
    clip, counts = task.load(), Counter(clips=1)
    for _ in task.pictures(clip, counts) if clip.images is not None else ():
        # Pictures are only counted for the README of the export, not written.
        pass
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
        **({} if labels.cause is None else {"visibility": labels.cause[frames], "hidden_by": labels.occluder[frames]}),
        "objects": np.array(clip.occlusion.objects if clip.occlusion else (), dtype=str),
        **physical_arrays(task.folder, task.every),
    }
    path = task.out / task.split / f"{file_part(task.name)}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(path, **arrays)
    return counts


def physical_arrays(folder: Path, every: int = 1) -> dict[str, np.ndarray]:
    """Return arrays of the physical labels of a clip, for one frame in `every`: `contacts.*`, `forces.*`, `surface.*`.

    Frame numbers of contacts are those of the clip. The result is empty if the clip has no physical labels.
    """
    labels = load_physical_labels(folder) if (folder / FILE).is_file() else PhysicalLabels()
    found = {}
    for kind in labels.kinds:
        part = getattr(labels, kind)
        values = {field.name: np.array(getattr(part, field.name)) for field in fields(part)}
        if kind == "contacts":
            kept = part.frame % every == 0
            values = {name: each if name == "names" else each[kept] for name, each in values.items()}
        else:
            single = ("names", "weights")
            values = {name: each if name in single else each[::every] for name, each in values.items()}
        found |= {f"{kind}.{name}": each for name, each in values.items()}
    return found
