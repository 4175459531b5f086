"""Gaussian process with learned kernels: which joints count, how far, and for how long, differs by limb."""

import numpy as np

from dmae.completion.blending import noisiness
from dmae.completion.gaussian_process.kernels import Exactness, KernelSet, shipped_kernels
from dmae.completion.gaussian_process.limbs import limb_joints
from dmae.completion.gaussian_process.problems import GapProblem, Limbs
from dmae.completion.gaussian_process.regression import blending_weight, predict
from dmae.completion.gaussian_process.steps import Steps, finished
from dmae.completion.gaussian_process.torso import Torsos
from dmae.completion.methods.gaussian_process import place_limbs
from dmae.completion.methods.registry import completion_method
from dmae.data.clip import Poses3D
from dmae.numerics.body import Bodies, interpolate_bodies
from dmae.numerics.filling import take_estimate, without_infinite
from dmae.numerics.paths import neighbours, pchip

_MOST = 160
"""Training poses of a gap."""
_SHARE = 0.5
"""Of the learned kernels of limbs, relative to the kernel that all joints share: processes with other errors."""
_COST, _START_COST, _LIMBS_COST = 1.5, 5.0, 4.0
"""Of a gap, of interpolation, and of preparing and of joining limbs, see `Steps`."""


@completion_method("gaussian_process_learned")
def fill_gaussian_process_learned(poses: Poses3D, fps: float) -> Poses3D:
    """The torso by learned kernels; limbs by the mean of gaussian_process and of learned kernels.

    The learned kernels are of poses and of time. They count as far as they predict the person's other frames, the less
    the noisier poses are, and not in gaps in which single cameras see the joint, where its ray says more.
    """
    return finished(fill_both(poses, fps))[1]


def fill_both(poses: Poses3D, fps: float, frames: slice = slice(None)) -> Steps[tuple[Poses3D, Poses3D]]:
    """Fill by `gaussian_process` and by `gaussian_process_learned`, in steps; much of their work is the same.

    Args:
        frames: Those in which the second is asked for; in others it may be anything between the two.
    """
    poses = without_infinite(poses, fps)
    bodies = interpolate_bodies(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    yield _START_COST
    plain = bodies.copy()
    yield from place_limbs(plain, fps)
    filled = take_estimate(poses, fps, plain.filled)
    counts = _without_rays(poses) * (1 - noisiness(poses))
    if not counts.any():
        return filled, filled
    kernels = shipped_kernels()
    if (yield from _place_torso(poses, fps, bodies, kernels, counts)):
        plain = bodies.copy()
        yield from place_limbs(plain, fps)
    share = _SHARE * counts
    asked = np.zeros(counts.shape[:2], bool)
    asked[frames] = True
    learned = yield from _place_limbs(poses, fps, bodies, kernels, share > 0, asked)
    change = (share * learned)[..., None] * np.nan_to_num(bodies.filled - plain.filled)
    return filled, take_estimate(poses, fps, plain.filled + change)


def fill_with(poses: Poses3D, fps: float, kernels: KernelSet) -> Poses3D:
    """Fill by given kernels alone, where they predict the person's other frames; elsewhere by interpolation."""
    poses = without_infinite(poses, fps)
    bodies = interpolate_bodies(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    finished(_place_torso(poses, fps, bodies, kernels, _without_rays(poses)))
    everywhere = np.ones(poses.xyz.shape[:3], bool)
    finished(_place_limbs(poses, fps, bodies, kernels, everywhere, everywhere[..., 0]))
    return take_estimate(poses, fps, bodies.filled)


def _without_rays(poses: Poses3D) -> np.ndarray:
    """Return the share of the frames of each joint's gap in which no ray is known, (F, P, J); 1 where measured."""
    observed = ~np.isnan(poses.xyz).any(-1)
    before, after = neighbours(observed)
    on_ray = np.cumsum(~observed & ~np.isnan(poses.rays[..., 0, 0]), 0)
    on_ray = np.concatenate([np.zeros_like(on_ray[:1]), on_ray])
    found = np.take_along_axis(on_ray, after, 0) - np.take_along_axis(on_ray, before + 1, 0)
    return 1 - found / np.maximum(after - before - 1, 1)


def _place_torso(poses: Poses3D, fps: float, bodies: Bodies, kernels: KernelSet, counts: np.ndarray) -> Steps[bool]:
    """Replace the interpolated estimates of the torso where a Gaussian process has one; what hangs from it follows.

    Return whether there was one.
    """
    replaced = False
    torsos = Torsos(poses, bodies, fps, kernels.bones)
    for joint in bodies.torso:
        for problem in torsos.problems(joint, _MOST, counts[:, :, joint] > 0):
            at = problem.gap.frames, problem.gap.person
            predicted = _predict(problem, kernels)
            yield _COST
            if predicted is not None:
                replaced, (offset, weight) = True, predicted
                turned = np.einsum("fij,fj->fi", bodies.world_from_body[at], offset)
                change = bodies.xyz[(*at, problem.gap.anchor)] + turned - torsos.filled[(*at, joint)]
                bodies.filled[(*at, joint)] += weight * counts[(*at, joint)][:, None] * change
    if not replaced:
        return False
    free = ~torsos.measured & np.isnan(poses.rays[..., 0, 0])
    for joint in limb_joints(bodies):
        parent = bodies.parents[joint]
        moved = bodies.filled[:, :, parent] - torsos.filled[:, :, parent]
        bodies.filled[:, :, joint] += np.where(free[:, :, joint, None], np.nan_to_num(moved), 0)
    return True


def _place_limbs(
    poses: Poses3D, fps: float, bodies: Bodies, kernels: KernelSet, wanted: np.ndarray, asked: np.ndarray
) -> Steps[np.ndarray]:
    """Replace the interpolated estimates of limbs where a Gaussian process has one; return where, (F, P, J).

    Args:
        wanted: (F, P, J) True where the process counts.
        asked: (F, P) True where estimates are asked for.
    """
    limbs = Limbs(poses, bodies, fps, kernels.bones)
    found = np.zeros(wanted.shape, bool)
    needed = _needed(bodies, ~limbs.measured, asked)
    yield _LIMBS_COST
    for joint in limb_joints(bodies):
        gaps = wanted[:, :, joint], needed[joint]
        found[:, :, joint] = yield from _place(bodies, limbs, joint, kernels, *gaps)
    yield _LIMBS_COST
    return found


def _needed(bodies: Bodies, hidden: np.ndarray, asked: np.ndarray) -> dict[int, np.ndarray]:
    """Return in which frames (F, P) each joint of a limb is needed: those asked for, and the gaps of its children."""
    joints = limb_joints(bodies)
    needed = {joint: asked.copy() for joint in joints}
    for joint in reversed(joints):
        before, after = neighbours(~hidden[:, :, joint])
        total = np.concatenate([np.zeros_like(asked[:1], int), np.cumsum(needed[joint], 0)])
        inside = np.take_along_axis(total, after, 0) - np.take_along_axis(total, before + 1, 0)
        parent = bodies.parents[joint]
        if parent in needed:
            needed[parent] |= hidden[:, :, joint] & (inside > 0)
    return needed


def _place(
    bodies: Bodies, limbs: Limbs, joint: int, kernels: KernelSet, wanted: np.ndarray, needed: np.ndarray
) -> Steps[np.ndarray]:
    """Do so for one joint, in gaps of which any of (F, P) is wanted, and any is needed; return where, (F, P)."""
    done = np.zeros(wanted.shape, bool)
    if not (wanted.any() and needed.any()):
        return done
    parent = bodies.parents[joint]
    # A joint moves along with its parent.
    first = limbs.filled[:, :, joint] + np.nan_to_num(bodies.filled[:, :, parent] - limbs.filled[:, :, parent])
    estimate, weight = np.full_like(first, np.nan), np.zeros((*first.shape[:2], 1))
    for problem in limbs.problems(joint, _MOST, wanted, needed):
        at = problem.gap.frames, problem.gap.person
        predicted = _predict(problem, kernels)
        yield _COST
        if predicted is not None:
            offset, weight[at] = predicted
            turned = np.einsum("fij,fj->fi", bodies.world_from_body[at], offset)
            estimate[at] = bodies.filled[(*at, parent)] + turned
            done[at] = True
    measured = ~np.isnan(bodies.xyz[:, :, joint])
    # Unlike other estimates it is not bent to meet the measurements next to a gap: the process models their noise.
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
