"""Fit the learned kernels: by gradient through the Cholesky factor, on gaps of clips of known truth."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dmae.completion.config import MaskingConfig
from dmae.completion.learned_kernels import (
    PARAMETERS,
    Exactness,
    GapProblem,
    Kernel,
    KernelSet,
    Limbs,
    Torsos,
    covariance,
    limb_joints,
    noise_of,
)
from dmae.completion.training_data import PosePair, mask_bursts, pose_pair
from dmae.data.clip import Poses3D
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import BODY25
from dmae.data.store import clip_folders, load_clip
from dmae.metrics.position import GAPS
from dmae.numerics import body
from dmae.numerics.body import median_bone_lengths
from dmae.numerics.paths import pchip
from dmae.progress import progress


@dataclass(frozen=True)
class Episode:
    """A problem and its solution.

    Attributes:
        truth: (Q, 3) m / size; NaN where unknown.
        interpolated: (Q, 3) m / size, by interpolation in the body.
        length: Index in `GAPS` of the length of the gap.
    """

    problem: GapProblem
    truth: np.ndarray
    interpolated: np.ndarray
    length: int


def episodes_of(
    poses: Poses3D, truth: Poses3D, fps: float, bones: dict[str, float], most: int, torso: bool = False
) -> Iterator[Episode]:
    """Yield the gaps of all limbs, or of the torso, of poses of which the truth is known, in the same order."""
    bodies = body.interpolate_bodies(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
    if torso:
        parts = Torsos(poses, bodies, fps, bones)
        problems = (problem for joint in bodies.torso for problem in parts.problems(joint, most))
    else:
        parts = Limbs(poses, bodies, fps, bones)
        joints = limb_joints(bodies)
        problems = (problem for joint in joints for problem in parts.problems(joint, most, from_anchor=True))
    for problem in problems:
        gap = problem.gap
        right = parts.targets(truth.xyz.astype(np.float64), gap, gap.anchor)[gap.frames] / problem.size
        if np.isnan(right).any():
            continue
        frames = (gap.whole[1] - gap.whole[0] + 1) * 25 / fps
        length = int(np.searchsorted([low for low, _ in GAPS], frames, side="right") - 1)
        interpolated = parts.targets(bodies.filled, gap, gap.anchor)[gap.frames] / problem.size
        yield Episode(problem, right, interpolated, max(length, 0))


FPS = 25.0
Perturb = Callable[..., Poses3D]
_START = {
    "wide": 1.0, "wide_width": 3.0, "time": 1.0, "time_scale": 0.4, "both": 0.5, "both_width": 2.0,
    "both_time_scale": 1.5, "noise": 0.01, "tolerance": 10.0,
}  # fmt: skip
_LEAST_NOISE = 1e-4
_FEWEST_GROUPS = 3
_FEWEST_GAPS = 100
"""Kinds of poses and classes of lengths of the gaps of a joint of the torso, and those gaps; with fewer no kernel is
learned."""
_CLOSENESS = 10.0
"""1/m; what the weights of all joints begin with, divided by the square root of their number."""


@dataclass(frozen=True)
class FitConfig:
    """How kernels are learned."""

    passes: int = 2
    """Times that gaps are cut into each clip."""
    training_poses: int = 112
    """Of each gap, at most."""
    queries: int = 20
    """Frames of each gap, at most."""
    kept: int = 40
    """Gaps of each joint, kind of poses and class of lengths, at most."""
    steps: int = 250
    batch: int = 16
    """Gaps in a batch."""
    lr: float = 0.06
    seed: int = 0


@dataclass(frozen=True)
class EpisodeTable:
    """Episodes of one kernel, as tensors. E episodes, N training poses, Q frames, C inputs."""

    names: list[str]
    known: Tensor
    wanted: Tensor
    seconds: Tensor
    wanted_seconds: Tensor
    targets: Tensor
    truth: Tensor
    used: Tensor
    asked: Tensor
    importance: Tensor

    def double(self) -> EpisodeTable:
        """Return the same in double precision."""
        parts = {name: getattr(self, name) for name in (field.name for field in fields(self) if field.name != "names")}
        return EpisodeTable(self.names, **{k: v if v.dtype == torch.bool else v.double() for k, v in parts.items()})


def collect(
    pairs: Iterable[tuple[str, PosePair]],
    bones: dict[str, float],
    config: FitConfig,
    perturb: Perturb,
    torso: bool = False,
) -> dict:
    """Return gaps cut into true, perturbed and captured poses, by kernel, then by kind, joint and class of lengths.

    They are the gaps of limbs, or of the torso.
    """
    found: dict[tuple[str, Exactness], dict[tuple, list[Episode]]] = defaultdict(lambda: defaultdict(list))
    seen: dict = defaultdict(int)
    for number, (_, pair) in enumerate(progress(list(pairs), "cutting gaps")):
        rng = generator(config.seed, number, Stream.MASKING if torso else Stream.STRESS)
        for _ in range(config.passes):
            for kind in ("true", "perturbed", "captured"):
                given = pair.captured if kind == "captured" else pair.truth
                if given is None:
                    continue
                xyz = given.xyz.astype(np.float64)
                masked = mask_bursts(*xyz.shape[:2], BODY25, FPS, MaskingConfig(), rng=rng)
                poses = Poses3D(BODY25, np.where(masked[..., None], np.nan, xyz), rays=given.rays)
                if kind == "perturbed":
                    poses = perturb(poses, FPS, rng=rng)
                for episode in episodes_of(poses, pair.truth, FPS, bones, config.training_poses, torso):
                    exactness = Exactness.exact if kind == "true" else Exactness.noisy
                    joint = BODY25.joints[episode.problem.gap.joint][2:]
                    key, group = (episode.problem.kernel, exactness), (kind, joint, episode.length)
                    seen[key, group] += 1
                    kept = found[key][group]
                    if len(kept) < config.kept:
                        kept.append(episode)
                    elif (place := int(rng.integers(seen[key, group]))) < config.kept:
                        kept[place] = episode
    return found


def table_of(groups: dict[tuple, list[Episode]], config: FitConfig, *, rng: np.random.Generator) -> EpisodeTable:
    """Return episodes as tensors; each group of kind, joint and length counts by its error of interpolation."""
    names = sorted({name for episodes in groups.values() for e in episodes for name in e.problem.names})
    rows = []
    for episodes in groups.values():
        error = np.mean([np.linalg.norm(e.interpolated - e.truth, axis=-1).mean() for e in episodes])
        rows += [(episode, 1 / (error + 0.02)) for episode in episodes]
    count, most, asked = len(rows), config.training_poses, config.queries
    arrays = {
        "known": np.zeros((count, most, len(names), 3)), "wanted": np.zeros((count, asked, len(names), 3)),
        "seconds": np.zeros((count, most)), "wanted_seconds": np.zeros((count, asked)),
        "targets": np.zeros((count, most, 3)), "truth": np.zeros((count, asked, 3)),
        "used": np.zeros((count, most), bool), "asked": np.zeros((count, asked), bool),
        "importance": np.zeros(count),
    }  # fmt: skip
    for i, (episode, importance) in enumerate(rows):
        problem = episode.problem
        n = len(problem.seconds)
        chosen = np.arange(len(problem.wanted_seconds))
        if len(chosen) > asked:
            chosen = np.sort(rng.choice(len(chosen), asked, replace=False))
        columns = [names.index(name) for name in problem.names]
        arrays["known"][i, :n, columns] = problem.known.swapaxes(0, 1)
        arrays["wanted"][i, : len(chosen), columns] = problem.wanted[chosen].swapaxes(0, 1)
        arrays["seconds"][i, :n] = problem.seconds
        arrays["wanted_seconds"][i, : len(chosen)] = problem.wanted_seconds[chosen]
        arrays["targets"][i, :n] = problem.targets
        arrays["truth"][i, : len(chosen)] = episode.truth[chosen]
        arrays["used"][i, :n], arrays["asked"][i, : len(chosen)] = True, True
        arrays["importance"][i] = importance
    tensors = {k: torch.from_numpy(v if v.dtype == bool else v.astype(np.float32)) for k, v in arrays.items()}
    return EpisodeTable(names, **tensors)


def predictions(table: EpisodeTable, rows: Tensor, weights: Tensor, parameters: dict[str, Tensor]) -> Tensor:
    """Return what the process predicts, (B, Q, 3); equation (2.25) of Rasmussen & Williams 2006."""
    known, wanted = ((part[rows] * weights[:, None]).flatten(2) for part in (table.known, table.wanted))
    seconds, asked, used = table.seconds[rows], table.wanted_seconds[rows], table.used[rows]
    among = covariance(_squared(known, known), _apart(seconds, seconds), parameters, torch.exp)
    across = covariance(_squared(wanted, known), _apart(asked, seconds), parameters, torch.exp)
    # Rows that are not used are far from all others, and predict nothing.
    among = torch.where(used[:, :, None] & used[:, None], among, 0)
    targets = table.targets[rows]

    def solve(variance: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        share = used / variance
        mean = ((targets * share[..., None]).sum(1) / share.sum(1, keepdim=True))[:, None]
        factor = torch.linalg.cholesky(among + torch.diag_embed(torch.where(used, variance, 1.0)))
        return mean, factor, (targets - mean) * used[..., None]

    _, factor, centred = solve(parameters["noise"].expand(used.shape))
    inverse = torch.cholesky_inverse(factor)
    residuals = (inverse @ centred / inverse.diagonal(dim1=1, dim2=2)[..., None]).square().sum(-1)
    usual = torch.where(used, residuals, torch.nan).nanmedian(1, keepdim=True).values + 1e-12
    mean, factor, centred = solve(noise_of(residuals, usual, parameters))
    return mean + torch.where(used[:, None], across, 0) @ torch.cholesky_solve(centred, factor)


def fit(table: EpisodeTable, which: tuple[str, Exactness], config: FitConfig) -> tuple[Kernel, list[float]]:
    """Learn one kernel; return it and its loss over the steps."""
    torch.manual_seed(config.seed)
    count = len(table.names)
    dtype = table.known.dtype
    weights = torch.full((count,), float(np.log(_CLOSENESS / count**0.5)), dtype=dtype, requires_grad=True)
    logs = torch.tensor([float(np.log(_START[name])) for name in PARAMETERS], dtype=dtype, requires_grad=True)
    optimizer = torch.optim.Adam([weights, logs], config.lr, betas=(0.9, 0.98))
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimizer, config.lr, config.steps, pct_start=0.1)
    losses = []
    for _ in range(config.steps):
        rows = torch.randint(len(table.importance), (config.batch,))
        parameters = dict(zip(PARAMETERS, logs.exp(), strict=True))
        parameters["noise"] = parameters["noise"] + _LEAST_NOISE
        error = predictions(table, rows, weights.exp(), parameters) - table.truth[rows]
        distance = (error.square().sum(-1) + 1e-6).sqrt()
        asked = table.asked[rows]
        per_gap = (distance * asked).sum(1) / asked.sum(1)
        loss = (per_gap * table.importance[rows]).mean()
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_([weights, logs], 1.0)
        optimizer.step()
        schedule.step()
        losses.append(float(loss.detach()))
    learned = dict(zip(PARAMETERS, logs.detach().exp().tolist(), strict=True))
    learned["noise"] += _LEAST_NOISE
    return Kernel(*which, dict(zip(table.names, weights.detach().exp().tolist(), strict=True)), learned), losses


def usual_bones(pairs: list[PosePair]) -> dict[str, float]:
    """Return the median length of each bone over all people, m, by `parent-joint`."""
    lengths = np.concatenate([median_bone_lengths(pair.truth.xyz.astype(np.float64), BODY25.bones) for pair in pairs])
    names = ("-".join(BODY25.joints[joint] for joint in bone) for bone in BODY25.bones)
    return {name: float(length) for name, length in zip(names, np.nanmedian(lengths, 0), strict=True)}


def read_pairs(folders: Iterable[Path]) -> dict[str, PosePair]:
    """Return true and captured poses of all clips of data sets, by folder and clip."""
    found = {}
    for folder in folders:
        for clip in clip_folders(folder):
            pair = pose_pair(load_clip(clip), BODY25, FPS)
            if not np.isnan(pair.truth.xyz).all():
                found[f"{folder.name}/{clip.name}"] = pair
    return found


def fit_all(pairs: dict[str, PosePair], config: FitConfig, perturb: Perturb) -> KernelSet:
    """Learn the kernels of all limbs.

    Args:
        pairs: True and captured poses at `FPS`, by name.
        perturb: Adds errors like those of capture to poses of a frame rate, by `rng`.
    """
    bones = usual_bones(list(pairs.values()))
    limbs, torsos = (collect(pairs.items(), bones, config, perturb, torso) for torso in (False, True))
    usual = sorted(key for key, groups in torsos.items() if len(groups) >= _FEWEST_GROUPS)
    kernels = {}
    for number, key in enumerate(progress([*sorted(limbs), *usual], "learning kernels")):
        rng = generator(config.seed, number, Stream.VALIDATION)
        table = table_of((limbs | torsos)[key], config, rng=rng)
        if key in limbs:
            kernels[key], _ = fit(table, key, config)
        elif len(table.importance) >= _FEWEST_GAPS:
            # The torso is so regular that its noise vanishes relative to the process, in single precision.
            kernels[key], _ = fit(table.double(), key, config)
    recipe = {"clips": len(pairs), "seed": config.seed, "steps": config.steps}
    return KernelSet(kernels, bones, recipe)


def _squared(one: Tensor, other: Tensor) -> Tensor:
    squared = one.square().sum(-1)[:, :, None] + other.square().sum(-1)[:, None] - 2 * one @ other.transpose(1, 2)
    return squared.clamp_min(0)


def _apart(one: Tensor, other: Tensor) -> Tensor:
    return (one[:, :, None] - other[:, None]).abs()
