"""A data set of windows of motion: one person for a fixed number of frames."""

from pathlib import Path
from typing import Literal, TypedDict

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from dmae.data.clip import Clip, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import Skeleton, get_skeleton
from dmae.datasets.clip_files import ClipFile, clip_files


class Window(TypedDict):
    """One person with J joints over T frames. It contains no NaN."""

    xyz: Tensor
    """(T, J, 3) float32, m, world; zeros where a joint is absent."""
    observed: Tensor
    """(T, J) bool, True where the joint is known, completed joints included."""
    source: Tensor
    """(T, J) uint8 `Source`."""
    views: Tensor
    """(T, J) uint8 number of cameras that see the joint (labelled truth) or that measured it (poses)."""
    clip: int
    """Number of the clip in `WindowDataset.files`."""
    person: int
    """Index of the person in the clip."""
    start: int
    """First frame in the clip."""


class WindowDataset(Dataset):
    """Windows of each person in each clip. Only the frames of the requested window are read.

        windows = WindowDataset("runs/data", frames=30, every=15, skeleton="body25")
        loader = DataLoader(windows, batch_size=64, shuffle=True, num_workers=2)

    Args:
        path: Path of a data set or of a clip.
        frames: Number of frames T of a window. Shorter clips have no window.
        every: Number of frames from the start of one window to the start of the next.
        of: `truth` for the true poses, `poses` for the captured or completed poses.
        skeleton: Name of the skeleton of the joints; by default the first skeleton of the clip.

    Raises:
        FileNotFoundError: the path is neither a clip nor a data set.
        ValueError: no clip has these poses in enough frames, or a number is below 1.
        KeyError: there is no skeleton of this name.
    """

    def __init__(
        self,
        path: str | Path,
        frames: int = 30,
        every: int = 15,
        of: Literal["truth", "poses"] = "truth",
        skeleton: str | None = None,
    ):
        if frames < 1 or every < 1:
            raise ValueError(f"expected 1 frame or more, got frames={frames}, every={every}")
        self.frames, self.every, self.of = frames, every, of
        self.skeleton: Skeleton | None = None if skeleton is None else get_skeleton(skeleton)
        self.files: list[ClipFile] = list(clip_files(Path(path)))
        starts = [max(0, (file.frames - frames) // every + 1) for file in self.files]
        counts = [count * file.persons.get(of, 0) for count, file in zip(starts, self.files, strict=True)]
        self._starts, self._ends = starts, np.cumsum(counts)
        if not sum(counts):
            longest = max((file.frames for file in self.files), default=0)
            raise ValueError(
                f"{path}: no {of} of {frames} frames in {len(self.files)} clips; the longest has {longest} frames"
            )

    def __len__(self) -> int:
        return int(self._ends[-1])

    def place(self, index: int) -> tuple[int, int, int]:
        """Return the number of the clip, the index of the person and the first frame of a window.

        Raises:
            IndexError: there is no window with this index.
        """
        if not -len(self) <= index < len(self):
            raise IndexError(f"window {index}: there are {len(self)}")
        index %= len(self)
        clip = int(np.searchsorted(self._ends, index, side="right"))
        within = index - (int(self._ends[clip - 1]) if clip else 0)
        person, start = divmod(within, self._starts[clip])
        return clip, person, start * self.every

    def clip(self, index: int) -> Clip:
        """Return the frames of a window as a clip, with cameras, detections, labels and all persons."""
        clip, _, start = self.place(index)
        return self.files[clip].read(start, start + self.frames)

    def __getitem__(self, index: int) -> Window:
        number, person, start = self.place(index)
        poses = self.files[number].person(self.of, person, start, start + self.frames)
        poses = convert(poses, self.skeleton or poses.skeleton.parts[0])
        observed = poses.source[:, 0] != Source.ABSENT
        return Window(
            xyz=torch.from_numpy(np.where(observed[..., None], poses.xyz[:, 0], np.float32(0))),
            observed=torch.from_numpy(observed),
            source=torch.from_numpy(poses.source[:, 0].copy()),
            views=torch.from_numpy(np.where(observed, poses.views[:, 0], 0).astype(np.uint8)),
            clip=number,
            person=person,
            start=start,
        )
