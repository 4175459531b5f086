"""Linear interpolation in the world."""

from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D
from dmae.numerics.filling import fill_world
from dmae.numerics.paths import linear


@completion_method("linear")
def fill_linear(poses: Poses3D, fps: float) -> Poses3D:
    """Straight lines through the world.

    See `dmae.numerics.filling.fill_world`.
    """
    return fill_world(poses, fps, linear)
