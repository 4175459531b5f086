"""A Gaussian process with learned kernels: which joints count, how far, and for how long, differs by limb.

In this order: the kernels and their file; the gaps of limbs and of the torso as regression problems; their solution;
the completion method.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from enum import StrEnum
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from dmae.completion.features import noisiness
from dmae.completion.gaussian_process import Steps, finished, place_limbs
from dmae.completion.methods import completion_method
from dmae.data.clip import Poses3D
from dmae.data.skeleton import Skeleton
from dmae.files.structured import read_json
from dmae.numerics import body
from dmae.numerics.body import Bodies, median_bone_lengths
from dmae.numerics.filling import take_estimate, without_infinite
from dmae.numerics.paths import neighbours, pchip

FORMAT = 1
SHIPPED = Path(__file__).parents[1] / "models" / "gaussian_process" / "kernels.json"

PARAMETERS = (
    "wide", "wide_width", "time", "time_scale", "both", "both_width", "both_time_scale", "noise", "tolerance",
)  # fmt: skip
"""Parameters of a kernel in addition to the weights of joints, all positive, see `covariance` and `noise_of`."""


class Exactness(StrEnum):
    """The poses that a kernel was learned on."""

    exact = "exact"
    """True poses."""
    noisy = "noisy"
    """Perturbed and captured poses."""


@dataclass(frozen=True)
class Kernel:
    """What was learned for the joints of a limb that hang, hidden, from one joint, or for a joint of the torso.

    Attributes:
        anchor: Name of the joint from which they hang, of the left side or the middle; for a joint of the torso
            `neck-l_hip`, of the joint that it is placed from and its own.
        exactness: The poses that it is for.
        weights: 1/m; how much the offset of each joint from its parent counts in the distance between poses.
        parameters: One for each of `PARAMETERS`.
    """

    anchor: str
    exactness: Exactness
    weights: dict[str, float]
    parameters: dict[str, float]


@dataclass(frozen=True)
class KernelSet:
    """All kernels, and the bones by which people are brought to one size.

    Attributes:
        kernels: By anchor and exactness.
        bones: m; usual lengths of bones, by `parent-joint`.
        recipe: How the kernels were made.
    """

    kernels: dict[tuple[str, Exactness], Kernel]
    bones: dict[str, float]
    recipe: dict

    def save(self, path: Path) -> None:
        """Write the kernels as JSON."""
        rounded = [_rounded(asdict(kernel)) for kernel in self.kernels.values()]
        content = {"format": FORMAT, "recipe": self.recipe, "bones": _rounded(self.bones), "kernels": rounded}
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content, indent=1) + "\n")


def load_kernels(path: Path) -> KernelSet:
    """Read the kernels that `KernelSet.save` wrote.

    Raises:
        FileNotFoundError: no such file.
        ValueError: it is not of this format.
    """
    content = read_json(path)
    try:
        if content["format"] != FORMAT:
            raise ValueError(f"expected format {FORMAT}, found {content['format']!r}")
        kernels = [Kernel(**kernel) for kernel in content["kernels"]]
        for kernel in kernels:
            _check(kernel)
        return KernelSet({(k.anchor, Exactness(k.exactness)): k for k in kernels}, content["bones"], content["recipe"])
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path}: not a file of kernels of this version of dmae: {error}") from None


@cache
def shipped_kernels() -> KernelSet:
    """Return the kernels that come with the package."""
    return load_kernels(SHIPPED)


def covariance(
    squared: np.ndarray, seconds: np.ndarray, parameters: dict[str, float], exp: Callable = np.exp
) -> np.ndarray:
    """Return the covariance (...) of poses at a weighted squared distance and a distance in time, s.

    It is the sum of a squared exponential of the distance, a wider one, a Matern kernel (nu = 5/2) of the time between
    poses, and a product of the two kinds; Rasmussen & Williams 2006, (4.9) and (4.17). Works on tensors with their
    `exp`.

    Args:
        squared: (...) squared distance.
        seconds: (...) s, not negative.
        parameters: Of the kernel.
    """
    p = parameters
    return (
        exp(-squared / 2)
        + p["wide"] * exp(-squared / (2 * p["wide_width"] ** 2))
        + p["time"] * _matern(seconds / p["time_scale"], exp)
        + p["both"] * exp(-squared / (2 * p["both_width"] ** 2)) * _matern(seconds / p["both_time_scale"], exp)
    )


def noise_of(residuals: np.ndarray, scale: np.ndarray, parameters: dict[str, float]) -> np.ndarray:
    """Return the variance of the noise of each training pose, in the unit of `covariance`.

    Poses that the others contradict are noisier, as by the weights of Student's t.

    Args:
        residuals: (...) squared distance of each training pose from what the others predict, and `scale`, their usual
            squared distance.
    """
    return parameters["noise"] * (1 + residuals / (parameters["tolerance"] * scale))


def _matern(distance: np.ndarray, exp: Callable) -> np.ndarray:
    scaled = 5**0.5 * distance
    return (1 + scaled + scaled**2 / 3) * exp(-scaled)


def _check(kernel: Kernel) -> None:
    numbers = [*kernel.weights.values(), *(kernel.parameters[name] for name in PARAMETERS)]
    if not (np.isfinite(numbers).all() and min(kernel.parameters.values()) > 0):
        raise ValueError(f"the numbers of {kernel.anchor!r} must be finite, and its parameters positive")


def _rounded(values):
    if isinstance(values, dict):
        return {name: _rounded(value) for name, value in values.items()}
    return float(f"{values:.5g}") if isinstance(values, float) else values


# Limbs in gaps: which hidden joints are predicted together, from which joint they hang, and by which others.

NEAR = 0.8
"""s; training poses are dense so far from a gap."""
SPAN = 12.0
"""s; and are taken from so far from it."""
DENSEST = 25.0
"""Training poses a second, near a gap."""


@dataclass(frozen=True)
class Gap:
    """Frames in a row in which a joint of a person is hidden, and the same of its ancestors.

    Attributes:
        person: Index.
        joint: Index.
        anchor: The nearest ancestor that is measured or on a ray, or the joint of the torso that the limb hangs from.
        hidden_ancestors: Number of joints between the two.
        frames: (Q,)
        whole: First and last frame in which the joint is hidden, whatever its ancestors are.
    """

    person: int
    joint: int
    anchor: int
    hidden_ancestors: int
    frames: np.ndarray
    whole: tuple[int, int]


def limb_joints(bodies: Bodies) -> list[int]:
    """Return the joints that hang from the torso, parents first."""
    return [joint for joint in bodies.attached if joint not in bodies.torso]


def ancestors(bodies: Bodies, joint: int) -> list[int]:
    """Return the joints above a joint of a limb, nearest first; the last one is of the torso."""
    above = [bodies.parents[joint]]
    while above[-1] not in bodies.torso and bodies.parents[above[-1]] >= 0:
        above.append(bodies.parents[above[-1]])
    return above


def gaps_of(bodies: Bodies, joint: int, hidden: np.ndarray, unseen: np.ndarray) -> Iterator[Gap]:
    """Yield the gaps of one joint of a limb.

    Args:
        hidden: (F, P, J) True where joints are hidden.
        unseen: (F, P, J) True where they are not on the ray of a single camera either.
    """
    above = ancestors(bodies, joint)
    # The joint of the torso is the anchor even if hidden: the torso is placed by itself.
    covered = np.cumprod(unseen[:, :, above[:-1]], -1).sum(-1) if len(above) > 1 else 0 * hidden[:, :, joint]
    for person in range(hidden.shape[1]):
        for first, end in runs(hidden[:, person, joint]):
            level = covered[first:end, person]
            cuts = [first, *(first + 1 + np.flatnonzero(np.diff(level))), end]
            for start, stop in pairwise(cuts):
                count = int(level[start - first])
                yield Gap(person, joint, above[count], count, np.arange(start, stop), (first, end - 1))


def input_joints(bodies: Bodies, gap: Gap) -> list[int]:
    """Return the joints by which a gap is filled: all but those hidden with it in its limb, and those below it."""
    limb = ancestors(bodies, gap.joint)[: gap.hidden_ancestors]
    return [
        other
        for other in bodies.attached
        if other != gap.joint and other not in limb and not _hangs_from(bodies, other, gap.joint)
    ]


def mirrored(skeleton: Skeleton, joint: int) -> bool:
    """Return whether a joint is of the right side, for which left and right are exchanged."""
    return skeleton.joints[joint].rpartition(".")[2].startswith("r_")


def name_of(skeleton: Skeleton, joint: int, other_side: bool) -> str:
    """Return the name of a joint, or of its partner of the other side."""
    return skeleton.joints[skeleton.mirror[joint] if other_side else joint].rpartition(".")[2]


def training_frames(usable: np.ndarray, gap: Gap, fps: float, most: int) -> np.ndarray:
    """Return frames (N,) to learn from, of those usable (F,): dense near the gap, evenly spaced farther away."""
    first, last = gap.whole
    frames = np.flatnonzero(usable)
    away = np.maximum(np.maximum(first - frames, frames - last), 0) / fps
    close = frames[(away <= NEAR) & (away > 0)]
    close = close[:: max(round(fps / DENSEST), 1)]
    far = frames[(away > NEAR) & (away <= SPAN)]
    count = min(len(far), max(most - len(close), 0))
    return np.sort(np.concatenate([close, far[np.linspace(0, len(far) - 1, count).round().astype(int)]]))


def body_sizes(xyz: np.ndarray, skeleton: Skeleton, bones: dict[str, float]) -> np.ndarray:
    """Return the size of each person of (F, P, J, 3), (P,), as a multiple of the person of usual `bones`."""
    known = [
        (pair, bones[name])
        for pair in skeleton.bones
        if (name := "-".join(skeleton.joints[joint].rpartition(".")[2] for joint in pair)) in bones
    ]
    if not known:
        return np.ones(xyz.shape[1])
    ratio = median_bone_lengths(xyz, [pair for pair, _ in known]) / [length for _, length in known]
    sizes = np.array([np.median(row[~np.isnan(row)]) if (~np.isnan(row)).any() else 1.0 for row in ratio])
    return sizes.clip(0.3, 2.0)


def _hangs_from(bodies: Bodies, joint: int, ancestor: int) -> bool:
    return joint not in bodies.torso and ancestor in ancestors(bodies, joint)


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Return the first frames and the ends of runs of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


# Problems: gaps of joints as tables of numbers, that a Gaussian process fills by regression.

FEWEST = 20
"""Training poses; with fewer nothing is predicted."""


@dataclass(frozen=True)
class GapProblem:
    """One gap of one joint, to be filled by regression. N training poses, Q frames, C input joints.

    Attributes:
        gap: The gap.
        kernel: Name of the kernel that was learned for gaps like this one.
        inputs: (C,) indices of the input joints; `names`: their names, sides exchanged for joints of the right.
        known: (N, C, 3) m / size; offsets of the inputs from their parents in the frame of the body.
        wanted: (Q, C, 3) the same of the frames of the gap.
        targets: (N, 3) m / size; measured offsets of the joint from its parent, or from the anchor of the gap.
        seconds: (N,) and `wanted_seconds`: (Q,) s.
        size: Of the person.
        noisy: From 0 for exact poses to 1 for captured ones.
        frames: (N,) frames of the training poses.
    """

    gap: Gap
    kernel: str
    inputs: list[int]
    names: list[str]
    known: np.ndarray
    wanted: np.ndarray
    targets: np.ndarray
    seconds: np.ndarray
    wanted_seconds: np.ndarray
    size: float
    noisy: float
    frames: np.ndarray


class BodyParts:
    """All people of a recording, and what is known of them: what problems are made of."""

    def __init__(self, poses: Poses3D, bodies: Bodies, fps: float, bones: dict[str, float]):
        self.skeleton, self.bodies, self.fps = poses.skeleton, bodies, fps
        self.measured = ~np.isnan(bodies.xyz).any(-1)
        # As they were interpolated, whatever is predicted later.
        self.filled = bodies.filled.copy()
        self.placed = ~np.isnan(self.filled).any(-1)
        self.sizes = body_sizes(poses.xyz.astype(np.float64), poses.skeleton, bones)
        self.noisy = noisiness(poses)[..., 0]

    def targets(self, xyz: np.ndarray, gap: Gap, origin: int) -> np.ndarray:
        """Return offsets (F, 3) m of a gap's joint from a joint in (F, P, J, 3), in the frame of the body."""
        offset = xyz[:, gap.person, gap.joint] - xyz[:, gap.person, origin]
        return np.einsum("fji,fj->fi", self.bodies.world_from_body[:, gap.person], offset)

    def problem(
        self, gap: Gap, kernel: str, inputs: list[int], offsets: np.ndarray, origin: int, most: int
    ) -> GapProblem | None:
        """Return a problem of inputs with offsets (F, C, 3) m; None where too little is known."""
        complete = ~np.isnan(offsets).any((1, 2))
        usable = complete & self.measured[:, gap.person, [gap.joint, origin]].all(-1)
        frames = training_frames(usable, gap, self.fps, most)
        if len(frames) < FEWEST or not complete[gap.frames].all():
            return None
        size, side = self.sizes[gap.person], mirrored(self.skeleton, gap.joint)
        return GapProblem(
            gap,
            kernel,
            inputs,
            [name_of(self.skeleton, joint, side) for joint in inputs],
            offsets[frames] / size,
            offsets[gap.frames] / size,
            self.targets(self.bodies.xyz, gap, origin)[frames] / size,
            frames / self.fps,
            gap.frames / self.fps,
            size,
            float(self.noisy[np.r_[frames, gap.frames], gap.person].mean()),
            frames,
        )


class Limbs(BodyParts):
    """The gaps of the limbs."""

    def __init__(self, poses: Poses3D, bodies: Bodies, fps: float, bones: dict[str, float]):
        super().__init__(poses, bodies, fps, bones)
        self.unseen = ~self.measured & np.isnan(poses.rays[..., 0, 0])
        self.offsets = bodies.in_body(self.filled - self.filled[:, :, bodies.parents])

    def problems(self, joint: int, most: int, *anywhere: np.ndarray, from_anchor: bool = False) -> Iterator[GapProblem]:
        """Yield the gaps of a joint that enough was measured for.

        Args:
            most: Training poses of each gap.
            anywhere: (F, P) each; gaps in which one of them is nowhere True are left out.
            from_anchor: Predict offsets from anchors; by default from parents. A process is linear in its targets, so
                that both come to the same, but joints that hang from others move with these onto rays.
        """
        side = mirrored(self.skeleton, joint)
        for gap in gaps_of(self.bodies, joint, ~self.measured & self.placed, self.unseen):
            if not all(true[gap.frames, gap.person].any() for true in anywhere):
                continue
            inputs = [other for other in input_joints(self.bodies, gap) if self.placed[:, gap.person, other].any()]
            offsets = self.offsets[:, gap.person][:, inputs]
            kernel = name_of(self.skeleton, gap.anchor, side)
            origin = gap.anchor if from_anchor else self.bodies.parents[joint]
            problem = self.problem(gap, kernel, inputs, offsets, origin, most)
            if problem is not None:
                yield problem


# Torso: gaps of its joints, filled by where they were relative to the joints of it that are measured.


class Torsos(BodyParts):
    """The gaps of the joints of the torso, in which another joint of it, the anchor, is measured throughout.

    Where a limb hangs from a hidden joint, its first measured joint says where that is: it is an input, by its offset
    from the anchor.
    """

    def problems(self, joint: int, most: int, *anywhere: np.ndarray) -> Iterator[GapProblem]:
        """Yield the gaps of a joint that enough was measured for.

        Args:
            most: Training poses of each gap.
            anywhere: (F, P) each; gaps in which one of them is nowhere True are left out.
        """
        hidden = ~self.measured & self.placed
        for person in range(hidden.shape[1]):
            for first, end in runs(hidden[:, person, joint]):
                if not all(true[first:end, person].any() for true in anywhere):
                    continue
                seen = self.measured[first:end, person].all(0)
                anchor = self._anchor(joint, seen)
                if anchor is not None:
                    gap = Gap(person, joint, anchor, 0, np.arange(first, end), (first, end - 1))
                    problem = self._problem(gap, seen, most)
                    if problem is not None:
                        yield problem

    def _anchor(self, joint: int, seen: np.ndarray) -> int | None:
        """Return the joint of the torso nearest to a joint, of those seen (J,) throughout; None without any."""
        bodies = self.bodies
        always = [other for other in bodies.torso if seen[other]]
        near = [other for other in always if other == bodies.parents[joint] or bodies.parents[other] == joint]
        return next(iter([*near, *always]), None)

    def _problem(self, gap: Gap, seen: np.ndarray, most: int) -> GapProblem | None:
        bodies = self.bodies
        unseen = {joint for joint in bodies.torso if not seen[joint]}
        inputs, origins = [], []
        for other in bodies.attached:
            hangs = bodies.parents[other] in unseen
            if other not in unseen and other != gap.anchor and (seen[other] or not hangs):
                inputs.append(other)
                origins.append(gap.anchor if hangs else bodies.parents[other])
        filled = self.filled[:, gap.person]
        offsets = (filled[:, inputs] - filled[:, origins]) @ bodies.world_from_body[:, gap.person]
        side = mirrored(self.skeleton, gap.joint)
        kernel = "-".join(name_of(self.skeleton, joint, side) for joint in (gap.anchor, gap.joint))
        return self.problem(gap, kernel, inputs, offsets, gap.anchor, most)


# Regression: what Gaussian processes predict for a gap, how sure they are, and how well they do without a gap.

_BLOCKS = 6
"""Stretches of training poses, at most, that are left out to see how well they are predicted."""
_PRIOR = 2.0
"""Frames of such a stretch, with errors as usual, that the belief in the process is worth beforehand."""


@dataclass(frozen=True)
class GapPrediction:
    """What one process predicts for a gap of Q frames, from N training poses.

    Attributes:
        offset: (Q, 3) m / size.
        deviation: (Q,) m / size, along each axis.
        inverse: (N, N) inverse of the covariance of the training poses, noise included.
        centred: (N, 3) m / size, the targets less their mean.
    """

    offset: np.ndarray
    deviation: np.ndarray
    inverse: np.ndarray
    centred: np.ndarray


def predict(problem: GapProblem, kernel: Kernel) -> GapPrediction:
    """Predict the offset of the joint of a gap from its anchor.

    Equations (2.25) and (2.26) of Rasmussen & Williams 2006, twice: residuals of the first time, each pose left out by
    (5.12), say which training poses are wrong. The variance of the process is that under which they are most likely.
    """
    weights = np.array([kernel.weights.get(name, 0.0) for name in problem.names])[:, None]
    known, wanted = ((part * weights).reshape(len(part), -1) for part in (problem.known, problem.wanted))
    among = _covariance(known, known, problem.seconds, problem.seconds, kernel)
    across = _covariance(wanted, known, problem.wanted_seconds, problem.seconds, kernel)
    centred = problem.targets - problem.targets.mean(0)
    inverse = _inverse(among, np.full(len(among), kernel.parameters["noise"]))
    residuals = ((inverse @ centred / np.diag(inverse)[:, None]) ** 2).sum(1)
    variance = noise_of(residuals, np.median(residuals) + 1e-12, kernel.parameters)
    mean = np.average(problem.targets, 0, 1 / variance)
    centred = problem.targets - mean
    inverse = _inverse(among, variance)
    solved = inverse @ centred
    size = (centred * solved).sum() / centred.size
    left = covariance(0.0, 0.0, kernel.parameters) + kernel.parameters["noise"] - ((across @ inverse) * across).sum(1)
    return GapPrediction(mean + across @ solved, np.sqrt(np.maximum(size * left, 0)), inverse, centred)


def blending_weight(problem: GapProblem, prediction: GapPrediction) -> float:
    """Return the weight of a prediction against interpolation, 0 to 1, from errors of left-out poses.

    Stretches of training poses, as long as the gap, are left out and predicted: by the process from all other poses,
    and by straight lines between their neighbours. The weight is that with which the blend of both has the least
    squared error; it is 1 where too little is known.
    """
    product = square = 0.0
    for block in _blocks(problem):
        inverse = prediction.inverse[np.ix_(block, block)]
        process = np.linalg.solve(inverse, prediction.inverse[block] @ prediction.centred)
        ends, centred, seconds = [block[0] - 1, block[-1] + 1], prediction.centred, problem.seconds
        share = ((seconds[block] - seconds[ends[0]]) / (seconds[ends[1]] - seconds[ends[0]]))[:, None]
        line = centred[block] - (1 - share) * centred[ends[0]] - share * centred[ends[1]]
        product += (line * (line - process)).sum() / len(block)
        square += ((line - process) ** 2).sum() / len(block)
    usual = _PRIOR * square / _BLOCKS + 1e-12
    return float(np.clip((product + usual) / (square + usual), 0, 1))


def _blocks(problem: GapProblem) -> list[np.ndarray]:
    """Return the training poses of stretches as long as the gap, evenly spaced over time."""
    seconds = problem.seconds
    half = (problem.wanted_seconds[-1] - problem.wanted_seconds[0]) / 2
    found = []
    for middle in np.linspace(seconds[0] + half, seconds[-1] - half, _BLOCKS + 2)[1:-1]:
        block = np.flatnonzero(np.abs(seconds - middle) <= half + 1e-9)
        if len(block) and block[0] > 0 and block[-1] < len(seconds) - 1:
            found.append(block)
    return found


def _inverse(among: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Return the inverse of a covariance with noise of those variances."""
    return cho_solve(cho_factor(among + np.diag(variance), check_finite=False), np.eye(len(among)), check_finite=False)


def _covariance(
    one: np.ndarray, other: np.ndarray, one_seconds: np.ndarray, seconds: np.ndarray, kernel: Kernel
) -> np.ndarray:
    squared = (one**2).sum(1)[:, None] + (other**2).sum(1) - 2 * one @ other.T
    return covariance(np.maximum(squared, 0), np.abs(one_seconds[:, None] - seconds), kernel.parameters)


# The completion method.

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
    bodies = body.interpolate_bodies(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
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
    bodies = body.interpolate_bodies(poses.xyz.astype(np.float64), poses.skeleton, fps, pchip, poses.rays)
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
