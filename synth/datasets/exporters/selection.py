"""What a layout is given: the clips of an export by split, their images, and files of the processes that write."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from dmae.data.clip import Clip
from dmae.data.skeleton import Skeleton
from dmae.data.store import load_clip
from dmae.formats.labelled_images import DEPTH, LabelledImage, file_part, joint_labels, read_labelled_images
from dmae.parallel import in_parallel
from dmae.progress import progress
from dmae.registry import from_outside

Made = TypeVar("Made")
PARTS = ".parts"
"""Folder for temporary files of the processes, within the export. It is removed at the end."""


@dataclass(frozen=True)
class ClipTask:
    """The task to export one clip, for one process."""

    folder: Path  # Folder of the clip
    name: str  # Name of the clip in the data set
    split: str  # Split of the clip
    skeleton: Skeleton  # Skeleton to write, with J joints
    every: int  # Export one frame in this number; 2 for every second frame
    suffix: str  # Suffix of image files, `jpg` or `png`
    out: Path  # Folder of the export
    robot: str | None = None  # MJCF of the robot, for formats of robots; None to take it from an installed package

    def load(self) -> Clip:
        """Return the clip with its true cameras, which made its images, as `rig`."""
        clip = load_clip(self.folder)
        return clip if clip.true_rig is None else replace(clip, rig=clip.true_rig, true_rig=None)

    def images(
        self, clip: Clip, counts: Counter, *, depth: bool = False, masks: bool = True
    ) -> Iterator[LabelledImage]:
        """Yield the images of the clip with the persons that they show, and with depth if asked for and present.

        `counts` is increased by the numbers of images, persons shown, persons hidden, boxes of visible pixels and,
        for formats with masks, masks and amodal masks.
        """
        assert clip.truth is not None
        labels = joint_labels(clip, clip.truth, self.skeleton)
        for image in read_labelled_images(clip, labels, every=self.every, depth=depth):
            shown = [person for person in image.persons if person.shown]
            counts["images"] += 1
            counts["persons"] += len(shown)
            counts["hidden"] += len(image.persons) - len(shown)
            counts["pixel_boxes"] += sum(person.mask is not None for person in shown)
            if masks:
                counts["masks"] += sum(person.mask is not None for person in shown)
                counts["amodal_masks"] += sum(person.amodal_mask is not None for person in shown)
            yield replace(image, persons=shown)

    def file_name(self, image: LabelledImage) -> str:
        """Return the path of an image in its split, without suffix: `<clip>/<camera>/<frame>`."""
        return f"{file_part(self.name)}/{image.path}"

    def file(self, suffix: str) -> Path:
        """Return the path of a file for the whole clip, `<split>/<clip>.<suffix>`; its folder is made."""
        path = self.out / self.split / f"{file_part(self.name)}.{suffix}"
        path.parent.mkdir(parents=True, exist_ok=True)
        return path

    def write(self, image: LabelledImage, folder: str) -> str:
        """Write the colours of an image into `<folder>/<split>`, and return its path relative to that folder."""
        return self._write(image, folder, self.suffix)

    def write_depth(self, image: LabelledImage, folder: str, key: str) -> dict[str, str]:
        """Write the depth of an image beside its colours, and return its path by `key`; nothing without depth."""
        return {} if image.depth is None else {key: self._write(image, folder, DEPTH)}

    def _write(self, image: LabelledImage, folder: str, suffix: str) -> str:
        name = f"{self.file_name(image)}.{suffix}"
        path = self.out / folder / self.split / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(image.encoded(suffix))
        return name

    def part(self, suffix: str) -> Path:
        """Return the path of a temporary file with results of the process for this clip."""
        path = self.out / PARTS / f"{file_part(self.split)}.{file_part(self.name)}.{suffix}"
        path.parent.mkdir(exist_ok=True)
        return path


@dataclass(frozen=True)
class Selection:
    """Clips of a data set, by split."""

    data: Path  # The data set
    splits: dict[str, list[str]]  # Names of clips, by name of the split
    skeleton: Skeleton  # Skeleton to write, with J joints
    every: int = 1  # Export one frame in this number; 2 for every second frame
    images: str = "jpg"  # Suffix of image files, `jpg` or `png`
    workers: int = 1  # Number of processes; -1 for one per core
    robot: str | None = None  # MJCF of the robot, for formats of robots; None to take it from an installed package

    def tasks(self, out: Path) -> list[ClipTask]:
        """Return the tasks of all clips, split by split, in the order of the clips."""
        how = self.skeleton, self.every, self.images, out, self.robot
        return [ClipTask(self.data / name, name, split, *how) for split, names in self.splits.items() for name in names]

    def each_clip(self, function: Callable[[ClipTask], Made], out: Path) -> Iterator[tuple[ClipTask, Made]]:
        """Yield each task, and what `function` returns for it in some process."""
        tasks = self.tasks(out)
        made = in_parallel(from_outside(function), ((task,) for task in tasks), self.workers)
        yield from zip(tasks, progress(made, "exporting clips", len(tasks)), strict=True)

    def export(self, function: Callable[[ClipTask], Counter], out: Path) -> dict[str, Counter]:
        """Run `function` on each clip, and return the sums of its counts, by split."""
        found = {split: Counter() for split in self.splits}
        for task, counts in self.each_clip(function, out):
            found[task.split] += counts
        return found
