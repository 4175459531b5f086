"""CMU Panoptic Studio: one folder per sequence, with calibration, poses and images."""

import re
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from dmae.data.conversion import convert
from dmae.formats.labelled_images.pictures import file_part
from dmae.formats.panoptic import write_panoptic
from synth.datasets.exporters.npz import physical_arrays
from synth.datasets.exporters.registry import exporter
from synth.datasets.exporters.selection import ClipTask, Selection

IMAGES = "hdImgs"
PHYSICS = "physics.npz"


@exporter("panoptic", pictures=False, skeleton="panoptic19", only=True)
def export_panoptic(selection: Selection, out: Path) -> dict[str, Counter]:
    """One folder per clip in the layout of CMU Panoptic: calibration, poses in 3D, and images if there are any."""
    found = {split: Counter() for split in selection.splits}
    for task, counts in selection.each_clip(_write_clip, out):
        found[task.split] += counts
    return found


def _write_clip(task: ClipTask) -> Counter:
    """Write one sequence, and return counts. Cameras without a name <panel>_<node> become nodes of panel 0."""
    clip, counts = task.load(), Counter(clips=1)
    names = [name if re.fullmatch(r"\d\d_\d\d", name) else f"00_{view:02}" for view, name in enumerate(clip.rig.names)]
    folder = task.out / task.split / file_part(task.name)
    pictured = clip.images is not None and "rgb" in clip.images.kinds
    for picture in task.pictures(clip, counts) if pictured else ():
        camera = names[picture.view]
        path = folder / IMAGES / camera / f"{camera}_{picture.number:08d}.{task.suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(picture.encoded(task.suffix))
    named = replace(clip, id=file_part(clip.id), rig=replace(clip.rig, names=tuple(names)), images=None)
    write_panoptic(convert(clip.truth, task.skeleton), named, folder)
    if physical := physical_arrays(task.folder):
        np.savez_compressed(folder / PHYSICS, **physical)
    return counts
