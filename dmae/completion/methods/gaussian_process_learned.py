"""Gaussian process with learned kernels: which joints count, how far, and for how long, differs by joint."""

import numpy as np

from dmae.completion.gaussian_process.episodes import Limbs, joint_of
from dmae.completion.gaussian_process.kernels import KernelSet, shipped_kernels
from dmae.completion.gaussian_process.limbs import limb_joints
from dmae.completion.gaussian_process.regression import predict
from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D
from dmae.numerics import body_frame
from dmae.numerics.body_frame import Bodies
from dmae.numerics.filling import take_estimate, without_infinite
from dmae.numerics.interpolation import pchip

_MOST = 192
"""Training poses of a gap."""


@completion_method("gaussian_process_learned")
def fill_gaussian_process_learned(poses: Poses3D, fps: float) -> Poses3D:
    """As gaussian_process, with kernels that were learned for each joint.

    Limbs are placed by Gaussian processes over the person's poses in other frames, and over time.
    """
    return fill_with(poses, fps, shipped_kernels())


def fill_with(poses: Poses3D, fps: float, kernels: KernelSet) -> Poses3D:
    """Fill by given kernels."""
    poses = without_infinite(poses, fps)
    bodies = body_frame.interpolate(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    limbs = Limbs(poses, bodies, fps, kernels.bones)
    for joint in limb_joints(bodies):
        _place(bodies, limbs, joint, kernels)
    return take_estimate(poses, fps, bodies.filled)


def _place(bodies: Bodies, limbs: Limbs, joint: int, kernels: KernelSet) -> None:
    """Replace the interpolated estimate of a joint of a limb where a Gaussian process has one."""
    first = bodies.filled[:, :, joint].copy()
    estimate = np.full_like(first, np.nan)
    for problem in limbs.problems(joint, _MOST):
        gap = problem.gap
        kernel = kernels.kernels.get(joint_of(limbs.skeleton, gap))
        if kernel is not None:
            offset, _ = predict(problem, kernel)
            turned = np.einsum("fij,fj->fi", bodies.world_from_body[gap.frames, gap.person], offset)
            estimate[gap.frames, gap.person] = bodies.filled[gap.frames, gap.person, gap.anchor] + turned
    bodies.filled[:, :, joint] = bodies.xyz[:, :, joint]
    bodies.place(joint, estimate, bodies.parents[joint])
    bodies.filled[:, :, joint] = np.where(np.isnan(bodies.filled[:, :, joint]), first, bodies.filled[:, :, joint])
