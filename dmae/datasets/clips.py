"""A data set of whole clips."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from torch.utils.data import Dataset

from dmae.data.clip import Clip
from dmae.data.store import clip_folders, load_clip


class ClipDataset(Dataset):
    """The clips of a data set. A clip is read, and its checksum is checked, when the item is requested.

        loader = DataLoader(ClipDataset("runs/data"), batch_size=None, num_workers=2)

    Args:
        path: Path of a data set or of a clip.
        transform: Function that is applied to each clip. Without one the items are clips: use `batch_size=None`.

    Raises:
        FileNotFoundError: the path is neither a clip nor a data set.
    """

    def __init__(self, path: str | Path, transform: Callable[[Clip], Any] | None = None):
        self.folders = clip_folders(Path(path))
        self.transform = transform

    def __len__(self) -> int:
        return len(self.folders)

    def __getitem__(self, index: int) -> Any:
        clip = load_clip(self.folders[index])
        return clip if self.transform is None else self.transform(clip)
