"""What do I train on? Torch data sets of clips, windows of motion, and images. Items are read on demand."""

from dmae.datasets.clips import ClipDataset as ClipDataset
from dmae.datasets.frames import FrameDataset as FrameDataset
from dmae.datasets.windows import WindowDataset as WindowDataset
