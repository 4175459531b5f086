"""The quality of images, and how light becomes colour."""

from dataclasses import dataclass
from enum import Enum
from math import inf

from dmae.data.typed import Configuration
from synth.checks import check_range


class ImageQuality(Enum):
    """Quality of images, and their cost."""

    draft = "draft"
    """No shadows, jagged edges, coarse round shapes; one ray for four pixels where rays are cast."""
    standard = "standard"
    high = "high"


@dataclass(frozen=True)
class ImagingConfig(Configuration):
    """Light and camera of colour images. Labels and all other kinds of images do not depend on it."""

    lamp: float = 0.2
    """Radius of the lamps that cast shadows, m; the sun is as large as in the sky. With 0, all shadows are sharp."""
    ambient_occlusion: float = 0.5
    """Distance up to which surfaces keep ambient light from each other, m; 0 for none. Light that casts no soft shadows
    counts as ambient."""
    exposure: float = 0.25
    """Standard deviation of the exposure of cameras, stops; one value for each camera."""
    white_balance: float = 0.05
    """Standard deviation of the gains of red and blue against green, stops; one value each for each camera."""
    electrons: float = 8000.0
    """Electrons of a white pixel, whose number is Poisson distributed; 0 for a camera without noise."""
    read_noise: float = 6.0
    """Standard deviation of noise that does not depend on light, electrons."""
    shutter: float = 0.0
    """Time of exposure, s, at most that from frame to frame, with the frame in its middle; what moves is blurred. 0 for
    sharp images."""
    jpeg: int = 0
    """Quality of JPEG, 1 to 100, that the camera compresses images with before they are stored; 0 for none."""

    def __post_init__(self):
        super().__post_init__()
        check_range("imaging", self, 0, inf, *vars(self))
        check_range("imaging", self, 0, 100, "jpeg")
