"""Gaussian process with learned kernels: which joints count, how far, and for how long, differs by limb."""

from copy import copy

import numpy as np

from dmae.completion.blending import noisiness
from dmae.completion.gaussian_process.kernels import Exactness, KernelSet, shipped_kernels
from dmae.completion.gaussian_process.limbs import limb_joints
from dmae.completion.gaussian_process.problems import GapProblem, Limbs
from dmae.completion.gaussian_process.regression import blending_weight, predict
from dmae.completion.gaussian_process.torso import Torsos
from dmae.completion.methods.gaussian_process import fill_gaussian_process, place_limbs
from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D
from dmae.numerics import body_frame
from dmae.numerics.body_frame import Bodies
from dmae.numerics.filling import take_estimate, without_infinite
from dmae.numerics.gaps import neighbours
from dmae.numerics.interpolation import pchip

_MOST = 160
"""Training poses of a gap."""
_SHARE = 0.5
"""Of the learned kernels of limbs beside the kernel that is the same for all joints: processes with other errors."""


@completion_method("gaussian_process_learned")
def fill_gaussian_process_learned(poses: Poses3D, fps: float) -> Poses3D:
    """The torso by learned kernels; limbs by the mean of gaussian_process and of learned kernels.

    The learned kernels are of poses and of time. They count as far as they predict the person's other frames, the less
    the noisier poses are, and not in gaps in which single cameras see the joint, where its ray says more.
    """
    poses = without_infinite(poses, fps)
    counts = _without_rays(poses) * (1 - noisiness(poses))
    if not counts.any():
        return fill_gaussian_process(poses, fps)
    kernels = shipped_kernels()
    bodies = body_frame.interpolate(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    _place_torso(poses, fps, bodies, kernels, counts)
    plain = copy(bodies)
    plain.filled = bodies.filled.copy()
    place_limbs(plain, fps)
    share = _SHARE * counts
    learned = _place_limbs(poses, fps, bodies, kernels, share > 0)
    change = (share * learned)[..., None] * np.nan_to_num(bodies.filled - plain.filled)
    return take_estimate(poses, fps, plain.filled + change)


def fill_with(poses: Poses3D, fps: float, kernels: KernelSet) -> Poses3D:
    """Fill by given kernels alone, where they predict the person's other frames; elsewhere by interpolation."""
    poses = without_infinite(poses, fps)
    bodies = body_frame.interpolate(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    _place_torso(poses, fps, bodies, kernels, _without_rays(poses))
    _place_limbs(poses, fps, bodies, kernels, np.ones(poses.xyz.shape[:3], bool))
    return take_estimate(poses, fps, bodies.filled)


def _without_rays(poses: Poses3D) -> np.ndarray:
    """Return the share of the frames of each joint's gap in which no ray is known, (F, P, J); 1 where measured."""
    observed = ~np.isnan(poses.xyz).any(-1)
    before, after = neighbours(observed)
    on_ray = np.cumsum(~observed & ~np.isnan(poses.rays[..., 0, 0]), 0)
    on_ray = np.concatenate([np.zeros_like(on_ray[:1]), on_ray])
    found = np.take_along_axis(on_ray, after, 0) - np.take_along_axis(on_ray, before + 1, 0)
    return 1 - found / np.maximum(after - before - 1, 1)


def _place_torso(poses: Poses3D, fps: float, bodies: Bodies, kernels: KernelSet, counts: np.ndarray) -> None:
    """Replace the interpolated estimates of the torso where a Gaussian process has one; what hangs from it follows."""
    torsos = Torsos(poses, bodies, fps, kernels.bones)
    for joint in bodies.torso:
        for problem in torsos.problems(joint, _MOST):
            at = problem.gap.frames, problem.gap.person
            predicted = _predict(problem, kernels) if counts[(*at, joint)].any() else None
            if predicted is not None:
                offset, weight = predicted
                turned = np.einsum("fij,fj->fi", bodies.world_from_body[at], offset)
                change = bodies.xyz[(*at, problem.gap.anchor)] + turned - torsos.filled[(*at, joint)]
                bodies.filled[(*at, joint)] += weight * counts[(*at, joint)][:, None] * change
    free = ~torsos.measured & np.isnan(poses.rays[..., 0, 0])
    for joint in limb_joints(bodies):
        parent = bodies.parents[joint]
        moved = bodies.filled[:, :, parent] - torsos.filled[:, :, parent]
        bodies.filled[:, :, joint] += np.where(free[:, :, joint, None], np.nan_to_num(moved), 0)


def _place_limbs(poses: Poses3D, fps: float, bodies: Bodies, kernels: KernelSet, wanted: np.ndarray) -> np.ndarray:
    """Replace the interpolated estimates of limbs where a Gaussian process has one; return where, (F, P, J)."""
    limbs = Limbs(poses, bodies, fps, kernels.bones)
    found = np.zeros(wanted.shape, bool)
    for joint in limb_joints(bodies):
        found[:, :, joint] = _place(bodies, limbs, joint, kernels, wanted[:, :, joint])
    return found


def _place(bodies: Bodies, limbs: Limbs, joint: int, kernels: KernelSet, wanted: np.ndarray) -> np.ndarray:
    """Do so for one joint, in gaps of which any of (F, P) is wanted; return where, (F, P)."""
    done = np.zeros(wanted.shape, bool)
    if not wanted.any():
        return done
    parent = bodies.parents[joint]
    # A joint moves along with its parent.
    first = limbs.filled[:, :, joint] + np.nan_to_num(bodies.filled[:, :, parent] - limbs.filled[:, :, parent])
    estimate, weight = np.full_like(first, np.nan), np.zeros((*first.shape[:2], 1))
    for problem in limbs.problems(joint, _MOST):
        at = problem.gap.frames, problem.gap.person
        predicted = _predict(problem, kernels) if wanted[at].any() else None
        if predicted is not None:
            offset, weight[at] = predicted
            turned = np.einsum("fij,fj->fi", bodies.world_from_body[at], offset)
            estimate[at] = bodies.filled[(*at, parent)] + turned
            done[at] = True
    measured = ~np.isnan(bodies.xyz[:, :, joint])
    # Unlike other estimates it is not bent to meet the measurements beside a gap: it knows how noisy they are.
    estimate = np.where(measured, bodies.xyz[:, :, joint], np.where(np.isnan(estimate), first, estimate))
    bodies.filled[:, :, joint] = bodies.xyz[:, :, joint]
    bodies.place(joint, estimate, parent)
    found = bodies.filled[:, :, joint]
    blended = np.where(np.isnan(found), first, weight * np.nan_to_num(found) + (1 - weight) * first)
    bodies.filled[:, :, joint] = np.where(measured, bodies.xyz[:, :, joint], blended)
    return done


def _predict(problem: GapProblem, kernels: KernelSet) -> tuple[np.ndarray, float] | None:
    """Return the offset (Q, 3) m by the kernel of exact poses, that of noisy ones, or between them; and its weight."""
    offset, weight = 0.0, 0.0
    for exactness, share in ((Exactness.exact, 1 - problem.noisy), (Exactness.noisy, problem.noisy)):
        if share > 0:
            kernel = kernels.kernels.get((problem.kernel, exactness))
            if kernel is None:
                return None
            found = predict(problem, kernel)
            offset = offset + share * found.offset
            weight += share * blending_weight(problem, found)
    return offset * problem.size, weight
