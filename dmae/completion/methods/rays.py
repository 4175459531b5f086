"""Cubic interpolation in the body, on the rays of single cameras."""

from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D
from dmae.numerics.filling import fill_body_frame
from dmae.numerics.paths import pchip


@completion_method("rays")
def fill_rays(poses: Poses3D, fps: float) -> Poses3D:
    """As pchip_body, with joints that a single camera detected put on its ray.

    See `dmae.numerics.filling.fill_body_frame`.
    """
    return fill_body_frame(poses, fps, pchip, by_rays=True)
