"""What do I train on? Data sets for torch: clips, windows of motion, and images, read on access."""

from dmae.datasets.clips import ClipDataset as ClipDataset
from dmae.datasets.frames import FrameDataset as FrameDataset
from dmae.datasets.windows import WindowDataset as WindowDataset
