"""No completion: poses as they were measured, to compare methods with."""

from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D


@completion_method("measured", smooths=True)
def fill_nothing(poses: Poses3D, fps: float) -> Poses3D:
    """Fill nothing."""
    return poses
