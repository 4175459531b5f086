"""Cubic interpolation in the body."""

from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D
from dmae.numerics.filling import fill_body_frame
from dmae.numerics.paths import pchip


@completion_method("pchip_body")
def fill_pchip_body(poses: Poses3D, fps: float) -> Poses3D:
    """Monotone cubics of offsets between joints, in a frame that turns with the body.

    See `dmae.numerics.filling.fill_body_frame`.
    """
    return fill_body_frame(poses, fps, pchip)
