"""The quality of images."""

from enum import Enum


class ImageQuality(Enum):
    """Quality of images, and their cost."""

    draft = "draft"
    """No shadows, jagged edges, coarse round shapes; one ray for four pixels where rays are cast."""
    standard = "standard"
    high = "high"
