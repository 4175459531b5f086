"""Linear interpolation in the body."""

from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D
from dmae.numerics.filling import fill_body_frame
from dmae.numerics.paths import linear


@completion_method("linear_body")
def fill_linear_body(poses: Poses3D, fps: float) -> Poses3D:
    """Straight lines of offsets between joints, in a frame that turns with the body.

    See `dmae.numerics.filling.fill_body_frame`.
    """
    return fill_body_frame(poses, fps, linear)
