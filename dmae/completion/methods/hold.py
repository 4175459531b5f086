"""Sample and hold."""

from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D
from dmae.numerics.filling import fill_world
from dmae.numerics.paths import hold


@completion_method("hold")
def fill_hold(poses: Poses3D, fps: float) -> Poses3D:
    """Hold each joint where it was last measured.

    See `dmae.numerics.filling.fill_world`.
    """
    return fill_world(poses, fps, hold)
