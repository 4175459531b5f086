"""Add physical labels to existing clips. They are computed from the stored body states; nothing is simulated."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dmae.data.store import MANIFEST, clip_folders, load_clip, read_manifest
from dmae.data.typed import check_arguments
from dmae.files.checksums import (
    begin_data_set,
    checksum,
    clip_checksum,
    find_damage,
    read_checksums,
    seal,
    write_checksums,
)
from dmae.parallel import check_workers, in_parallel
from dmae.progress import progress
from synth.datasets.generate import CONFIG
from synth.labels.forces import carry
from synth.labels.physical_labels import (
    FILE,
    KINDS,
    PhysicalLabels,
    check_kinds,
    physical_labels,
    save_physical_labels,
)
from synth.labels.surfaces import surface_labels, surface_points
from synth.physics.body_state import load_state
from synth.physics.simulation import rebuilt_scene


@check_arguments
def label(data: str | Path, labels: Sequence[str] = KINDS, *, workers: int = 1) -> int:
    """Add labels from physics to existing clips, in place. Nothing is simulated again.

    A clip gets the file `physics.safetensors`. Its other files do not change. Checksums are updated.

    Args:
        data: Data set that `generate` made, or one clip of it.
        labels: `contacts` (the touching parts, their places and forces), `forces` (ground reaction of each foot,
            residual at the pelvis), `surface` (512 named points on each person, their visibility, and what they touch).
            Existing labels of a clip are kept.
        workers: Processes; -1 for one per core.

    Returns:
        The number of clips that lacked any of these labels.

    Raises:
        FileNotFoundError: there is no clip, or it contains no body state.
        ValueError: a label is unknown, a clip is damaged, or its frames are too far apart.

    Examples:
        >>> for clip in synth.generate(clips=1, seconds=1, persons=[1, 1], out="walks"): pass
        >>> synth.label("walks", ["forces"])
        1
        >>> forces = synth.physical_labels("walks/000000").forces
        >>> forces.ground_reaction.shape
        (25, 1, 2, 3)
        >>> synth.verify("walks")
        []
    """
    data, kinds = Path(data), check_kinds(labels)
    check_workers(workers)
    folders = clip_folders(data)
    for folder in folders:
        load_state(folder)
    data_set = data if (data / MANIFEST).is_file() else data.parent
    sealed = (data_set / MANIFEST).is_file() and any(clip_checksum(folder) for folder in folders)
    # Their file is removed until the changes are complete.
    checksums = {folder.name: clip_checksum(folder) for folder in clip_folders(data_set)} if sealed else {}
    checksums |= begin_data_set(data_set) if sealed else {}
    made = 0
    try:
        tasks = ((folder, kinds) for folder in folders)
        done = in_parallel(_label, tasks, workers)
        made += sum(progress(done, "labelling clips", len(folders)))
    finally:
        if sealed:
            names = {folder.name for folder in folders}
            seal(data_set, [line for line in read_manifest(data_set) if line["id"] in names], (CONFIG,), checksums)
    return made


def _label(folder: Path, kinds: tuple[str, ...]) -> bool:
    """Add the missing labels of one clip, and return whether any were missing."""
    damage = [what for what in find_damage(folder, fast=True) if not what.startswith(FILE)]
    if damage:
        raise ValueError(f"{folder}: {damage[0]}; make the clip again")
    try:
        before = physical_labels(folder)
    except (FileNotFoundError, ValueError):
        before = PhysicalLabels()
    sums = read_checksums(folder)
    missing = tuple(kind for kind in kinds if kind not in before.kinds)
    if missing:
        found = make_labels(folder, missing)
        kept = {kind: getattr(before, kind) for kind in before.kinds}
        save_physical_labels(PhysicalLabels(**kept | {kind: getattr(found, kind) for kind in missing}), folder)
    if sums is not None and sums.get(FILE) != (now := checksum(folder / FILE)):
        write_checksums(folder, sums | {FILE: now})
    return bool(missing)


def make_labels(folder: Path, kinds: Sequence[str] = KINDS) -> PhysicalLabels:
    """Return the labels of one clip, of these kinds.

    Raises:
        FileNotFoundError: there is no clip, it contains no body states, or a file of its room does not exist.
        ValueError: the clip is damaged, its room has changed, or its frames are too far apart.
    """
    kinds = check_kinds(kinds)
    clip, state = load_clip(folder), load_state(folder)
    scene = rebuilt_scene(clip, state, painted=False)
    contacts = forces = surface = None
    if {"contacts", "forces"} & set(kinds):
        contacts, forces = carry(scene, state, clip.fps)
    if "surface" in kinds:
        points, seconds = surface_points(scene, list(state.shapes)), np.arange(len(state.qpos)) / clip.fps
        surface = surface_labels(scene, points, state.qpos, clip.actual_rig, seconds)
    found: dict = {"contacts": contacts, "forces": forces, "surface": surface}
    return PhysicalLabels(**{kind: found[kind] for kind in kinds})
