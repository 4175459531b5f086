"""The exported clips, and the partial results of the processes that export them."""

import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path
from typing import NamedTuple

from dmae.data.clip import Clip
from dmae.data.skeleton import Skeleton
from dmae.data.store import load_clip
from dmae.formats.labelled_images.joints import joint_labels
from dmae.formats.labelled_images.pictures import PersonLabel, Picture, file_part, read_pictures
from dmae.parallel import in_parallel
from dmae.progress import progress

PARTS = ".parts"
"""Folder for partial results of processes, inside the written folder. It is removed at the end."""


class PictureFormat(Enum):
    """File format of images."""

    jpg = "jpg"
    """JPEG with quality 95."""
    png = "png"


@dataclass(frozen=True)
class ClipTask:
    """A clip to export in a separate process.

    Attributes:
        folder: Folder of the clip.
        name: Name of the clip in the data set.
        split: Name of its split.
        skeleton: Skeleton of the J joints to write.
        every: Number of frames from one image to the next; 2 for every other frame.
        suffix: Suffix of images, `jpg` or `png`.
        out: Folder of the export.
    """

    folder: Path
    name: str
    split: str
    skeleton: Skeleton
    every: int
    suffix: str
    out: Path

    def load(self) -> Clip:
        """Return the clip with its true cameras, because its images come from these."""
        clip = load_clip(self.folder)
        return clip if clip.true_rig is None else replace(clip, rig=clip.true_rig, true_rig=None)

    def pictures(self, clip: Clip, counts: Counter) -> Iterator[Picture]:
        """Yield the images of the clip with the persons in them, and add their numbers to `counts`."""
        labels = joint_labels(clip, clip.truth, self.skeleton)
        for picture in read_pictures(clip, labels, every=self.every):
            shown = [person for person in picture.persons if person.shown]
            counts["pictures"] += 1
            counts["persons"] += len(shown)
            counts["hidden"] += len(picture.persons) - len(shown)
            counts["masks"] += sum(person.mask is not None for person in shown)
            counts["amodal_masks"] += sum(person.amodal_mask is not None for person in shown)
            yield replace(picture, persons=shown)

    def file_name(self, picture: Picture) -> str:
        """Return the path of an image in its split, without suffix: `<clip>/<camera>/<frame>`."""
        return f"{file_part(self.name)}/{picture.path}"

    def write(self, picture: Picture, folder: str) -> str:
        """Write an image into `<folder>/<split>`, and return its path relative to that folder."""
        name = f"{self.file_name(picture)}.{self.suffix}"
        path = self.out / folder / self.split / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(picture.encoded(self.suffix))
        return name

    def part(self, suffix: str) -> Path:
        """Return the path of the file with the partial result of this clip."""
        path = self.out / PARTS / f"{file_part(self.split)}.{file_part(self.name)}.{suffix}"
        path.parent.mkdir(exist_ok=True)
        return path


class Written(NamedTuple):
    """The result of the export of a clip."""

    task: ClipTask
    counts: Counter


@dataclass(frozen=True)
class Selection:
    """Clips of a data set, by split.

    Attributes:
        data: The data set.
        splits: Names of the clips of each split, by its name.
        skeleton: Skeleton of the J joints to write.
        every: Number of frames from one image to the next; 2 for every other frame.
        pictures: File format of images.
        workers: Processes; -1 for one per core.
    """

    data: Path
    splits: dict[str, list[str]]
    skeleton: Skeleton
    every: int = 1
    pictures: PictureFormat = PictureFormat.jpg
    workers: int = 1

    def each_clip(self, function: Callable[[ClipTask], Counter], out: Path) -> Iterator[Written]:
        """Yield the result of `function` for each clip, split by split, in the order of the clips."""
        how = {"skeleton": self.skeleton, "every": self.every, "suffix": self.pictures.value, "out": out}
        tasks = [
            ClipTask(self.data / name, name, split, **how) for split, names in self.splits.items() for name in names
        ]
        made = in_parallel(function, ((task,) for task in tasks), self.workers)
        for task, counts in zip(tasks, progress(made, "exporting clips", len(tasks)), strict=True):
            yield Written(task, counts)


def write_lines(path: Path, lines: list[dict]) -> None:
    """Write JSON Lines: one object per line."""
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))


def world_joints(person: PersonLabel) -> list[list[float] | None]:
    """Return the joints, m, world, rounded to 0.1 mm; None for absent joints, because JSON has no NaN."""
    known = [[round(value, 4) for value in joint] for joint in person.xyz.tolist()]
    return [None if joint[0] != joint[0] else joint for joint in known]
