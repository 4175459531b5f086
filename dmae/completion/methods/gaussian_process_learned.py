"""Gaussian process with learned kernels: which joints count, how far, and for how long, differs by limb."""

from dataclasses import replace

import numpy as np

from dmae.completion.gaussian_process.episodes import GapProblem, Limbs, anchor_of
from dmae.completion.gaussian_process.kernels import Exactness, KernelSet, shipped_kernels
from dmae.completion.gaussian_process.limbs import limb_joints
from dmae.completion.gaussian_process.regression import blending_weight, predict
from dmae.completion.methods.gaussian_process import fill_gaussian_process
from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D, Source
from dmae.numerics import body_frame
from dmae.numerics.body_frame import Bodies
from dmae.numerics.filling import take_estimate, without_infinite
from dmae.numerics.gaps import neighbours
from dmae.numerics.interpolation import pchip

_MOST = 160
"""Training poses of a gap."""


_SHARE = 0.5
"""Of the learned kernels beside the kernel that is the same for all joints: processes with other errors."""


@completion_method("gaussian_process_learned")
def fill_gaussian_process_learned(poses: Poses3D, fps: float) -> Poses3D:
    """The mean of gaussian_process and of one with kernels learned for each limb.

    The learned kernels are of poses and of time. They count as far as they predict the person's other frames, and not
    in gaps in which single cameras see the joint, where its ray says more.
    """
    plain, learned = fill_gaussian_process(poses, fps), fill_with(poses, fps, shipped_kernels())
    share = _SHARE * _without_rays(poses)[..., None]
    xyz = plain.xyz + share * np.nan_to_num(learned.xyz.astype(np.float64) - plain.xyz)
    return replace(plain, xyz=np.where((plain.source == Source.COMPLETED)[..., None], xyz, plain.xyz))


def fill_with(poses: Poses3D, fps: float, kernels: KernelSet) -> Poses3D:
    """Fill by given kernels alone, where they predict the person's other frames; elsewhere by interpolation."""
    poses = without_infinite(poses, fps)
    bodies = body_frame.interpolate(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    limbs = Limbs(poses, bodies, fps, kernels.bones)
    interpolated = bodies.filled.copy()
    for joint in limb_joints(bodies):
        _place(bodies, limbs, joint, kernels, interpolated)
    return take_estimate(poses, fps, bodies.filled)


def _without_rays(poses: Poses3D) -> np.ndarray:
    """Return the share of the frames of each joint's gap in which no ray is known, (F, P, J); 1 where measured."""
    observed = ~np.isnan(poses.xyz).any(-1)
    before, after = neighbours(observed)
    on_ray = np.cumsum(~observed & ~np.isnan(poses.rays[..., 0, 0]), 0)
    on_ray = np.concatenate([np.zeros_like(on_ray[:1]), on_ray])
    found = np.take_along_axis(on_ray, after, 0) - np.take_along_axis(on_ray, before + 1, 0)
    return 1 - found / np.maximum(after - before - 1, 1)


def _place(bodies: Bodies, limbs: Limbs, joint: int, kernels: KernelSet, interpolated: np.ndarray) -> None:
    """Replace the interpolated estimate of a joint of a limb where a Gaussian process has one."""
    parent = bodies.parents[joint]
    # A joint moves along with its parent.
    first = interpolated[:, :, joint] + np.nan_to_num(bodies.filled[:, :, parent] - interpolated[:, :, parent])
    estimate, weight = np.full_like(first, np.nan), np.zeros((*first.shape[:2], 1))
    for problem in limbs.problems(joint, _MOST):
        gap = problem.gap
        predicted = _predict(problem, anchor_of(limbs.skeleton, gap), kernels)
        if predicted is not None:
            offset, weight[gap.frames, gap.person] = predicted
            turned = np.einsum("fij,fj->fi", bodies.world_from_body[gap.frames, gap.person], offset)
            estimate[gap.frames, gap.person] = bodies.filled[gap.frames, gap.person, parent] + turned
    measured = ~np.isnan(bodies.xyz[:, :, joint])
    # Unlike other estimates it is not bent to meet the measurements beside a gap: it knows how noisy they are.
    estimate = np.where(measured, bodies.xyz[:, :, joint], np.where(np.isnan(estimate), first, estimate))
    bodies.filled[:, :, joint] = bodies.xyz[:, :, joint]
    bodies.place(joint, estimate, parent)
    found = bodies.filled[:, :, joint]
    blended = np.where(np.isnan(found), first, weight * np.nan_to_num(found) + (1 - weight) * first)
    bodies.filled[:, :, joint] = np.where(measured, bodies.xyz[:, :, joint], blended)


def _predict(problem: GapProblem, anchor: str, kernels: KernelSet) -> tuple[np.ndarray, float] | None:
    """Return the offset (Q, 3) m by the kernel of exact poses, that of noisy ones, or between them; and its weight."""
    offset, weight = 0.0, 0.0
    for exactness, share in ((Exactness.exact, 1 - problem.noisy), (Exactness.noisy, problem.noisy)):
        if share > 0:
            kernel = kernels.kernels.get((anchor, exactness))
            if kernel is None:
                return None
            found = predict(problem, kernel)
            offset = offset + share * found.offset
            weight += share * blending_weight(problem, found)
    return offset * problem.size, weight
