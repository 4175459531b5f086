"""Count the pictures that several processes render."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

FILE = ".pictures"
"""The file of the numbers, in the folder of a data set while it is made."""


class PixelTally:
    """Two numbers of pictures of each clip, in a file that processes share: done, and in all.

    Args:
        folder: Of the data set.
        clips: Number of clips.
    """

    def __init__(self, folder: Path, clips: int):
        self._path, self._shape = Path(folder) / FILE, (clips, 2)

    def begin(self, pictures: Sequence[int]) -> None:
        """Begin with the number of pictures in each clip."""
        np.stack([np.zeros(self._shape[0]), pictures], axis=1).astype(np.int64).tofile(self._path)

    def count(self) -> tuple[int, int]:
        """Return how many pictures are done, and how many there are."""
        return tuple(np.fromfile(self._path, np.int64).reshape(self._shape).sum(0).tolist())

    @contextmanager
    def clip(self, index: int, pictures: int) -> Iterator[Callable[[], None]]:
        """Say how many pictures a clip has, and yield a function to be called after each.

        Without the file, which begins with `begin`, nothing is counted.
        """
        if not self._path.is_file():
            yield lambda: None
            return
        numbers = np.memmap(self._path, np.int64, "r+", shape=self._shape)
        numbers[index] = 0, pictures

        def seen() -> None:
            numbers[index, 0] += 1

        yield seen
