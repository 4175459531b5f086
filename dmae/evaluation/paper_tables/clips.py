"""The clips that the paper's tables learn from and score: a recording, or data sets, named, halved and captured."""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dmae.data.clip import Clip
from dmae.data.skeleton import SHELF14
from dmae.evaluation.config import TableConfig
from dmae.formats.reading import Clips, DataConfig
from dmae.progress import progress
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture


class NamedClips(Sequence):
    """Clips of several data sets, named after their folders, because clip ids start at 0 in each set."""

    def __init__(self, members: Sequence[tuple[Clips, int]]):
        self.members = members
        """The set and the index of each clip."""

    def __len__(self) -> int:
        return len(self.members)

    def __getitem__(self, index: int) -> Clip:  # type: ignore[override]  # clips are not read by slices
        clips, number = self.members[index]
        folder = clips.folders[number]
        return replace(clips[number], id=f"{folder.parent.name}/{folder.name}")


def load_sets(paths: Sequence[str]) -> NamedClips:
    """Return the clips of several data sets."""
    sets = [Clips(DataConfig(path=path)) for path in paths]
    return NamedClips([(clips, number) for clips in sets for number in range(len(clips))])


def halves(data: DataConfig, paths: Sequence[str]) -> tuple[NamedClips, NamedClips]:
    """Return the first and the second half of the clips of each data set: to learn from, and to score.

    Raises ValueError if a set has a single clip.
    """
    learned, scored = [], []
    for clips in [Clips(data), *(Clips(DataConfig(path=path)) for path in paths)]:
        if len(clips) < 2:
            raise ValueError(
                f"{clips.config.path}: {len(clips)} clip; expected a data set of two clips or more, half of them to "
                "learn from, half to score; make one by synth generate"
            )
        half = len(clips) // 2
        learned += [(clips, number) for number in range(half)]
        scored += [(clips, number) for number in range(half, len(clips))]
    return NamedClips(learned), NamedClips(scored)


def check_truth(clip: Clip, number: int) -> None:
    """Raise ValueError if a clip has no truth on the joints of Shelf, which a table scores."""
    if clip.truth is None or np.isnan(clip.truth.xyz).all():
        raise ValueError(f"clip {clip.id!r} has no truth; table {number} needs true poses on {SHELF14.name}")
    if SHELF14 not in clip.truth.skeleton.parts:
        raise ValueError(
            f"clip {clip.id!r} has truth on {clip.truth.skeleton.name}; table {number} scores the limbs of "
            f"{SHELF14.name}"
        )


def captured(clips: Sequence[Clip], config: CaptureConfig) -> Iterator[Clip]:
    """Yield clips with poses: their own, or else what all their cameras capture."""
    for clip in progress(clips, "capturing"):
        yield clip if clip.poses else replace(clip, poses=capture(clip, config))


def load_recording(config: TableConfig) -> Clip:
    """Return the one clip that a table is about; ValueError if there are several, or no truth on Shelf's joints."""
    clips = Clips(config.data)
    if len(clips) != 1:
        raise ValueError(
            f"{config.data.path}: {len(clips)} clips; table {config.number} is about the people of one recording. Name "
            "a single clip's folder"
        )
    (clip,) = clips
    check_truth(clip, config.number)
    return clip
