"""Cubic interpolation in the world."""

from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D
from dmae.numerics.filling import fill_world
from dmae.numerics.paths import pchip


@completion_method("pchip")
def fill_pchip(poses: Poses3D, fps: float) -> Poses3D:
    """Monotone cubics through the world.

    See `dmae.numerics.filling.fill_world`.
    """
    return fill_world(poses, fps, pchip)
