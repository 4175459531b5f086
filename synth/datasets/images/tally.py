"""Count the pictures that several processes render."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

FILE = ".pictures"
"""Name of the file with the numbers, in the folder of a data set while it is made."""


class PixelTally:
    """Two numbers for each clip, in a file that processes share: rendered pictures, and all pictures.

    Args:
        folder: Folder of the data set.
        clips: Number of clips.
    """

    def __init__(self, folder: Path, clips: int):
        self._path, self._shape = Path(folder) / FILE, (clips, 2)

    def begin(self, pictures: Sequence[int]) -> None:
        """Create the file, with the number of pictures of each clip."""
        np.stack([np.zeros(self._shape[0]), pictures], axis=1).astype(np.int64).tofile(self._path)

    def count(self) -> tuple[int, int]:
        """Return the number of rendered pictures, and the number of all pictures."""
        return tuple(np.fromfile(self._path, np.int64).reshape(self._shape).sum(0).tolist())

    @contextmanager
    def clip(self, index: int, pictures: int) -> Iterator[Callable[[], None]]:
        """Store the number of pictures of a clip, and yield a function to call after each picture.

        Nothing is counted if the file does not exist. `begin` creates the file.
        """
        if not self._path.is_file():
            yield lambda: None
            return
        numbers = np.memmap(self._path, np.int64, "r+", shape=self._shape)
        numbers[index] = 0, pictures

        def seen() -> None:
            numbers[index, 0] += 1

        yield seen
