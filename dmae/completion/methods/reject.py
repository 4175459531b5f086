"""Rejection first: drop measured joints that the frames around contradict, then fill as another method."""

from dmae.completion.methods.gaussian_process import fill_gaussian_process
from dmae.completion.methods.pchip_body import fill_pchip_body
from dmae.completion.methods.registry import completion_method
from dmae.completion.rejection import ACCELERATION, contradicted
from dmae.data.clip import Poses3D
from dmae.numerics.filling import without_infinite


def reject(poses: Poses3D, fps: float) -> Poses3D:
    """Return the poses without measured joints that the frames around contradict (`dmae.completion.rejection`)."""
    poses = without_infinite(poses, fps)
    return poses.without(poses.measured & contradicted(poses.xyz, fps, ACCELERATION / poses.skeleton.scale))


@completion_method("reject_pchip")
def fill_reject_pchip(poses: Poses3D, fps: float) -> Poses3D:
    """Drop joints that the frames around contradict, then fill as pchip_body.

    What was rejected and filled again is `COMPLETED`.
    """
    return fill_pchip_body(reject(poses, fps), fps)


@completion_method("reject_gaussian_process")
def fill_reject_gaussian_process(poses: Poses3D, fps: float) -> Poses3D:
    """Drop joints that the frames around contradict, then fill as gaussian_process.

    What was rejected and filled again is `COMPLETED`.
    """
    return fill_gaussian_process(reject(poses, fps), fps)
