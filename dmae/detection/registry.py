"""The registry of 2D detectors, each a function under the decorator `pose_detector`; options of detection.

A detector function takes a `PoseDetectorConfig` and returns an `ImageDetector` for the images of one camera, which
come in order. A user's own detector, `detector=module:function`, is the same kind of function without the decorator.
"""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Protocol

import numpy as np

from dmae.data.skeleton import Skeleton
from dmae.data.typed import Configuration
from dmae.registry import Entry, Registry

pose_detector = Registry("pose_detector", Entry, f"{__package__}.detectors", option="detector", arguments=("config",))


@dataclass(frozen=True)
class PoseDetectorConfig(Configuration):
    """How people are found in images."""

    name: str = field(default="blazepose", metadata={"choices": pose_detector})
    """Detector, or module:function of your own."""
    path: str | None = field(default=None, metadata={"reads": "path"})
    """Model file of the detector `onnx`."""
    skeleton: str | None = field(default=None, metadata={"reads": "skeleton"})
    """Skeleton of that model; by default known by its number of joints."""
    windows: list[float] | None = None
    """Sides of the windows in which people are searched, relative to the longer side of the image; smaller windows
    find smaller people, and take longer. By default [1, 0.6, 0.35]; in photographs [1.5, 1, 0.6, 0.36, ...], down to
    240 px or 0.12."""
    search_every: int = 10
    """Number of frames over which all windows are searched once, some in each frame; around a lost person, windows are
    searched immediately."""
    photographs: bool = False
    """Whether each image is searched by itself, also for small people and people cut off by its border, in two to
    three times the time. With `photos=` always so."""
    across_views: bool = True
    """With a calibration: search people that a camera missed where the other cameras see them, and remove detections
    that are parts of people."""

    def __post_init__(self):
        super().__post_init__()
        if self.windows is not None and not (self.windows and all(0.05 <= share <= 2 for share in self.windows)):
            raise ValueError(f"detector.windows={self.windows}: expected shares of the image from 0.05 to 2")
        if self.search_every < 1:
            raise ValueError(f"detector.search_every={self.search_every}: expected 1 frame or more")


class FlatFormat(StrEnum):
    """Format of 2D keypoints."""

    openpose = "openpose"
    """A folder for each camera, a file for each of its frames; a file for each photograph."""
    coco = "coco"
    """A file for each camera, or for all photographs, keypoints of COCO."""


@dataclass(frozen=True)
class OutputConfig(Configuration):
    """How detections are written."""

    skeleton: str | None = field(default=None, metadata={"reads": "skeleton"})
    """Skeleton to convert detections to, as body25; by default the detector's own."""
    images: bool = True
    """Whether the clip contains the images: the videos are linked, or encoded again if their size or frames differ from
    the clip's. For photographs: whether they are also written with the people drawn over them."""
    format: FlatFormat = FlatFormat.openpose
    """Format of 2D keypoints, which are written without a calibration."""


class ImageDetector(Protocol):
    """Finds the people in the images of one camera.

    A detector may also have a method `found_late()`, which is called after each image. It returns earlier images in
    which people were found by means of this image: the number of images before, and xy (D, J, 2) and score (D, J) of
    all people in that image, which replace those found before.

    A detector may also have a method `find_at(image, expected, known)`. It searches n people where other cameras see
    their joints, at `expected` (n, J, 2) px. `known` (D, J, 2) px are the people found before in this image. Both are
    NaN where unknown. Like a call, it returns xy and score of the people that it finds.

    Attributes:
        skeleton: J joints.
    """

    skeleton: Skeleton

    def __call__(self, image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the people of the next image.

        Args:
            image: (H, W, 3) uint8, RGB.

        Returns:
            xy: (D, J, 2) px, pixel (0, 0) is the centre of the first pixel; NaN where a joint is absent.
            score: (D, J) confidence from 0 to 1; NaN where a joint is absent.
        """
