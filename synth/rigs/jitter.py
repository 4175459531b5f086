"""Jitter: cameras are displaced from their places in the rig, differently in each clip."""

from dataclasses import dataclass

import numpy as np

from dmae.data.cameras import CameraRig
from synth.rigs.displacement import check_deviations, displace


@dataclass(frozen=True)
class JitterConfig:
    """Displacement of the cameras, as if held by hand, constant within a clip.

    Drawn for each clip and camera, normally distributed; the values are standard deviations.

    Attributes:
        position: Along each axis, m.
        rotation: About each axis, rad.
    """

    position: float = 0.0
    rotation: float = 0.0

    def __post_init__(self):
        check_deviations("rig.jitter", self)


def jitter(rig: CameraRig, config: JitterConfig, *, rng: np.random.Generator) -> CameraRig:
    """Return the rig with displaced cameras."""
    return rig if config == JitterConfig() else displace(rig, config.position, config.rotation, rng=rng)
