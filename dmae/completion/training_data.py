"""What a network learns from: pairs of true and captured poses, masked, augmented, and cut into batches."""

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from dmae.completion.config import AugmentConfig, ExamplesConfig, MaskingConfig, ModelConfig, TrainConfig
from dmae.completion.fusion import true_pair
from dmae.completion.windows import Rows, join_rows, make_rows
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import Skeleton
from dmae.data.typed import REQUIRED
from dmae.formats.reading import camera_subsets
from dmae.metrics.comparison import match, take_matched
from dmae.numerics.body import rotate_z
from dmae.numerics.filling import resample
from dmae.numerics.noise import ar1_filter
from dmae.progress import progress
from dmae.reconstruction.pipeline import capture

_ARM = ("shoulder", "elbow", "wrist", "thumb", "index_finger", "little_finger")
_LEG = ("knee", "ankle", "big_toe", "small_toe", "heel")
_FACE = ("eye", "ear", "eye_inner", "eye_outer", "mouth")
_PARTS = (
    *(
        tuple(f"{side}_{joint}" for joint in limb)
        for limb in (_ARM[2:], _ARM[1:], _ARM, _LEG[1:], _LEG)
        for side in "lr"
    ),
    ("nose", *(f"{side}_{joint}" for side in "lr" for joint in _FACE), "head_top", "top_head", "bottom_head"),
    ("mid_hip", "l_hip", "r_hip"),
)
"""Joints that are masked together."""


def mask(
    frames: int, persons: int, skeleton: Skeleton, fps: float, config: MaskingConfig, *, rng: np.random.Generator
) -> np.ndarray:
    """Return (F, P, J) True where a joint is masked: with probability `scattered` at random, else in bursts."""
    if rng.random() < config.scattered:
        return mask_scattered((frames, persons, len(skeleton)), config.joints, config.frames, rng=rng)
    return mask_bursts(frames, persons, skeleton, fps, config, rng=rng)


def mask_scattered(
    shape: tuple[int, int, int], joints: float, frames: float, released: bool = False, *, rng: np.random.Generator
) -> np.ndarray:
    """Return (F, P, J) True for all joints of a share of the frames, and a share of the joints of every other frame.

    The numbers of both are exact, for each person. With `released`, as in the paper's released code, that share of the
    joints is masked in the masked frames alone.
    """
    whole = _least(rng.random((*shape[:2], 1)), int(frames * shape[0] + 0.5), axis=0)
    some = _least(rng.random(shape), int(joints * shape[2] + 0.5), axis=2)
    return whole & some if released else whole | some


def _least(values: np.ndarray, count: int, axis: int) -> np.ndarray:
    return values.argsort(axis).argsort(axis) < count


_WHOLE_JOINT = 0.3  # Greatest share of the joints that are masked in all frames of a captured window


def mask_captured(shape: tuple[int, int, int], config: MaskingConfig, *, rng: np.random.Generator) -> np.ndarray:
    """Return (F, P, J) True at random, of captured windows: by joint, by frame, and joints in all frames.

    Each share is uniform for each person, up to `joints`, `frames` and 0.3: many joints are missing already.
    """
    frames, people, joints = shape
    most = rng.random((3, 1, people, 1)) * np.array((config.joints, config.frames, _WHOLE_JOINT))[:, None, None, None]
    return (
        (rng.random(shape) < most[0])
        | (rng.random((frames, people, 1)) < most[1])
        | (rng.random((1, people, joints)) < most[2])
    )


def mask_bursts(
    frames: int, persons: int, skeleton: Skeleton, fps: float, config: MaskingConfig, *, rng: np.random.Generator
) -> np.ndarray:
    """Return (F, P, J) True where body parts, and in one burst of forty whole persons, are masked for some frames."""
    masked = np.zeros((frames, persons, len(skeleton)), bool)
    parts = body_parts(skeleton)
    for person in range(persons):
        for _ in range(rng.poisson(config.bursts * frames / fps)):
            whole = rng.random() < 1 / 40
            longest = config.absence if whole else config.longest
            length = max(int(np.exp(rng.uniform(np.log(2), np.log(longest + 1))) * fps / 25), 1)
            start = int(rng.integers(1 - length, frames))
            joints = slice(None) if whole else parts[rng.integers(len(parts))]
            masked[max(start, 0) : start + length, person, joints] = True
    return masked


def body_parts(skeleton: Skeleton) -> list[list[int]]:
    """Return the joints that are masked together: those the skeleton has of each part, or each joint on its own."""
    short = [joint.rpartition(".")[2] for joint in skeleton.joints]
    parts = [[i for i, joint in enumerate(short) if joint in part] for part in _PARTS]
    return [part for part in parts if part] or [[i] for i in range(len(skeleton))]


# Pairs of true and captured poses of the same persons: what a model learns from.


@dataclass(frozen=True)
class PosePair:
    """True poses, and the same persons as cameras captured them."""

    truth: Poses3D  # F frames, P persons, J joints
    # The same persons in the same order, with gaps and errors; None where nothing was captured. On the skeleton of the
    # truth; of two side by side on the first.
    captured: Poses3D | None = None


def pose_pair(clip: Clip, skeleton: Skeleton, fps: float) -> PosePair:
    """Return the true poses of a clip and, if it has `poses`, the captured poses of the same persons, at another rate.

    Raises:
        ValueError: the clip has no truth, or infinite coordinates, or for two skeletons side by side
            (`dmae.completion.fusion`) no truth on the second.
        KeyError: the skeleton cannot be derived from the clip's.
    """
    if clip.truth is None:
        raise ValueError(f"clip {clip.id!r} has no truth to learn from")
    for name, poses in (("truth", clip.truth), ("poses", clip.poses)):
        if poses is not None and np.isinf(poses.xyz).any():
            raise ValueError(f"clip {clip.id!r}: {name} has infinite coordinates; unknown joints must be NaN")
    source, target = skeleton.parts[0], skeleton.parts[-1]
    truth = convert(clip.truth, skeleton) if source is target else true_pair(clip.truth, skeleton)
    if clip.poses is None:
        return PosePair(resample(truth, clip.fps, fps))
    poses = convert(clip.poses, source)
    measured = Poses3D(source, np.where(poses.measured[..., None], poses.xyz, np.nan), rays=poses.rays)
    matches = match(convert(measured, target).xyz, convert(truth, target).xyz)
    captured = Poses3D(source, take_matched(measured.xyz, matches), rays=take_matched(measured.rays, matches))
    return PosePair(resample(truth, clip.fps, fps), resample(captured, clip.fps, fps))


# Augmentation: pairs of poses varied in speed, direction, heading, side and size; and noise for true poses.

_CORRELATION = 0.75  # Correlation of errors in neighbouring frames at 25 frames/s, similar to OpenPose's


def augment(pair: PosePair, config: AugmentConfig, fps: float, *, rng: np.random.Generator) -> PosePair:
    """Return a pair at another speed, perhaps backwards; its persons rotated, mirrored and scaled.

    Args:
        fps: Frames per second of the poses, and of those returned.
    """
    # Recordings that last `longer` times as long are as many times slower.
    longer, backwards = np.exp(rng.uniform(-config.speed, config.speed)), rng.random() < config.reverse
    persons = pair.truth.xyz.shape[1]
    mirrored = rng.random((persons,)) < config.mirror
    size = np.exp(rng.normal(0, config.scale, (persons, 1, 1)))
    angle = rng.uniform(-np.pi, np.pi, (persons, 1))

    def varied(poses: Poses3D) -> Poses3D:
        new = resample(poses, fps, fps * longer)

        def move(points: np.ndarray, size: np.ndarray | float) -> np.ndarray:
            points = points.astype(np.float64)[:: -1 if backwards else 1]
            swapped = points[:, :, list(poses.skeleton.mirror)] * (1, -1, 1)
            return rotate_z(np.where(mirrored[:, None, None], swapped, points) * size, angle)

        rays = np.stack([move(new.rays[..., 0, :], size), move(new.rays[..., 1, :], 1)], -2)
        return Poses3D(poses.skeleton, move(new.xyz, size), rays=rays)

    return PosePair(varied(pair.truth), pair.captured and varied(pair.captured))


def with_noise(truth: Poses3D, deviation: float, *, rng: np.random.Generator) -> Poses3D:
    """Return true poses with correlated errors: stationary AR(1) noise.

    Args:
        deviation: m; a person's standard deviation is uniform up to this.
    """
    deviations = rng.uniform(0, deviation, (truth.xyz.shape[1], 1, 1))
    noise = ar1_filter(rng.normal(size=truth.xyz.shape), _CORRELATION)
    return Poses3D(truth.skeleton, truth.xyz + deviations * noise)


# Examples: windows of masked poses, and the truth in them.

_KEPT_RAYS = 0.5  # Share of the masked joints that keep their rays


@dataclass(frozen=True)
class Recipe:
    """How examples are made of true poses."""

    model: ModelConfig
    rest: np.ndarray  # (J, 3) m, see `dmae.completion.windows.rest_pose`
    masking: MaskingConfig = field(default_factory=MaskingConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)


class Examples(NamedTuple):
    """Windows and the truth in them."""

    windows: Any
    """Windows of the default network, or of the paper's."""
    truth: Tensor
    """(B, T, J, 3) m, zero where unknown."""
    hidden: Tensor
    """(B, T, J) True where the truth is known, the person is present, and the joint is not observed."""
    observed: Tensor
    """(B, T, J) True where the truth is known and the joint is observed, errors included."""


def masked_poses(pair: PosePair, recipe: Recipe, *, rng: np.random.Generator) -> Poses3D:
    """Return the captured poses of a pair, or else the true ones with noise, with joints masked."""
    source = pair.truth.skeleton.parts[0]
    measured = pair.captured or with_noise(convert(pair.truth, source), recipe.augment.noise, rng=rng)
    frames, persons = measured.xyz.shape[:2]
    masked = mask(frames, persons, source, recipe.model.fps, recipe.masking, rng=rng)
    # A single camera still detects some masked joints, as it does many joints that capture leaves out.
    detected = rng.random((1, *measured.xyz.shape[1:3])) < _KEPT_RAYS
    rays = np.where((masked & ~detected)[..., None, None], np.nan, measured.rays)
    return Poses3D(source, np.where(masked[..., None], np.nan, measured.xyz), rays=rays)


def masked_rows(pair: PosePair, recipe: Recipe, *, rng: np.random.Generator) -> Rows:
    """Return the masked poses of a pair, and the truth, ready to be cut into windows."""
    measured = masked_poses(pair, recipe, rng=rng)
    truth, target = pair.truth.xyz, None
    if pair.truth.skeleton != measured.skeleton:
        target = pair.truth.skeleton.parts[-1]
        truth = np.where(np.arange(truth.shape[2])[:, None] < len(measured.skeleton), np.nan, truth)
    return make_rows(measured, recipe.model.fps, recipe.rest, recipe.model.frames, truth, target)


def cut_examples(rows: Rows, starts: np.ndarray, model: ModelConfig) -> Examples:
    """Return the windows that begin at `starts` and the truth in them."""
    windows, truth, _ = rows.cut(starts, model.frames, model.align_heading)
    known = ~np.isnan(truth).any(-1)
    present = rows.present[starts[:, None] + np.arange(model.frames)]
    known_present = torch.from_numpy(known & present[..., None])
    return Examples(
        windows,
        torch.from_numpy(np.nan_to_num(truth)),
        known_present & ~windows.observed,
        known_present & windows.observed,
    )


# Reading: clips to pairs of poses to learn from, and which of them are held back for validation.

_BY = " by "  # Between the name of a clip and the cameras that captured it


@dataclass(frozen=True)
class TrainingSet:
    """Pairs of poses by the names of their clips."""

    pairs: dict[str, PosePair]  # To learn from
    extra: dict[str, PosePair]  # Those that `examples.replay` is a share of; none without it
    validation: dict[str, PosePair]  # To validate and calibrate on

    @property
    def all(self) -> dict[str, PosePair]:
        return self.pairs | self.extra | self.validation


def source_of(config: TrainConfig) -> str:
    """Return where the clips come from, to begin a message with; in Python they are given, and no path is."""
    return "" if config.data.path == REQUIRED else f"{config.data.path}: "


def read_training_set(
    clips: Iterable[Clip], extra: Iterable[Clip], validation: Iterable[Clip], skeleton: Skeleton, config: TrainConfig
) -> TrainingSet:
    """Read clips to learn from and to validate on.

    Raises ValueError if a clip has no truth, two clips have one name, or no clip has a person in it.
    """
    pairs, more, held_back = (_read(found, skeleton, config) for found in (clips, extra, validation))
    twice = sorted(pairs.keys() & more.keys())
    if twice:
        raise ValueError(_same_name(twice[0]))
    if not pairs:
        raise ValueError(f"{source_of(config)}nothing to learn from, no clip has a person in it")
    if config.examples.replay is not None and not more:
        raise ValueError(f"extra_data={config.extra_data}: nothing to replay, no clip has a person in it")
    return TrainingSet(pairs, more, {f"validation {name}": pair for name, pair in held_back.items()})


def split(found: TrainingSet, config: ExamplesConfig, *, seed: int) -> TrainingSet:
    """Return the set with extra clips among the others unless they are replayed, and some held back if none are."""
    pairs, extra, validation = found.pairs, found.extra, found.validation
    if config.replay is None:
        pairs, extra = pairs | extra, {}
    if not validation:
        names = _held_back(list(pairs if config.replay is None else extra), config.held_back, seed=seed)
        validation = {name: pair for name, pair in (pairs | extra).items() if name in names}
        validation = {name: validation[name] for name in names}
        pairs, extra = ({name: pair for name, pair in part.items() if name not in names} for part in (pairs, extra))
    return TrainingSet(pairs, extra, validation)


def _same_name(name: str) -> str:
    return f"two clips are called {name!r}; a model's record names the clips that it learned from"


def _read(clips: Iterable[Clip], skeleton: Skeleton, config: TrainConfig) -> dict[str, PosePair]:
    found = {}
    for clip in _captured(clips, skeleton, config):
        if clip.id in found:
            raise ValueError(_same_name(clip.id))
        found[clip.id] = pose_pair(clip, skeleton, config.model.fps)
    return {name: pair for name, pair in found.items() if not np.isnan(pair.truth.xyz).all()}


def _captured(clips: Iterable[Clip], skeleton: Skeleton, config: TrainConfig) -> Iterator[Clip]:
    """Yield clips; those without poses are captured if `views` asks for it, or the skeleton lacks truth."""
    for clip in progress(clips, "reading clips"):
        lacking = clip.truth is not None and clip.truth.skeleton in skeleton.parts[1:]
        if clip.poses is not None or not (config.examples.views or lacking):
            yield clip
            continue
        subsets = camera_subsets(clip, config.examples.views, "examples.views")
        for cameras in progress(subsets, f"capturing {clip.id}"):
            part = clip.select(views=cameras)
            yield replace(part, id=f"{clip.id}{_BY}{cameras}", poses=capture(part, config.capture))


def _held_back(names: list[str], share: float, *, seed: int) -> list[str]:
    """Return the names to validate on: whole clips, through all their cameras, so that no motion is in both sets."""
    clips = sorted({name.partition(_BY)[0] for name in names})
    if len(clips) < 2 or share == 0:
        return []
    count = min(max(1, round(share * len(clips))), len(clips) - 1)
    chosen = generator(seed, len(clips), Stream.VALIDATION).choice(clips, count, replace=False).tolist()
    return sorted(name for name in names if name.partition(_BY)[0] in chosen)


# Batches of examples for training and validation, and poses for calibration.

_DRAWS = 5  # Masks drawn for each true recording that uncertainty is calibrated on


class TrainingBatches(Dataset):
    """The batches of one epoch. Batch i is the same whenever and by whichever worker it is made.

    In every epoch recordings are augmented, masked and interpolated whole, so that gaps may be longer than windows;
    then each window is drawn from the recordings of a pool that is drawn first.
    """

    def __init__(
        self,
        pools: Sequence[tuple[float, list[PosePair]]],
        recipe: Recipe,
        *,
        seed: int,
        epoch: int,
        steps: int,
        batch: int,
        share: slice = slice(None),
        taken: float = float("inf"),
        until: float = float("inf"),
    ):
        """
        Args:
            pools: Groups of recordings: the share of windows taken from each, and its pairs.
            share: Which windows of each batch this process takes.
            taken: Steps after which the training ends, if it ends within the epoch; recordings are made for these.
            until: Time, by `time.monotonic`, after which no more recordings are made.
        """
        self.recipe, self.seed, self.share = recipe, seed, share
        self.first, self.steps, self.batch = epoch * steps, steps, batch
        rng = generator(seed, epoch, Stream.MASKING)
        made, counts, windows = [], [], batch * max(min(steps, taken), 1)
        for part, group in pools:
            size, order, first = 0, [], len(made)
            # Twice as many rows as windows are drawn: neighbouring windows differ little.
            while size < 2 * windows * part:
                order = order or list(rng.permutation(len(group)))
                pair = group[order.pop()]
                if rng.random() < recipe.augment.true_poses:
                    pair = PosePair(pair.truth)
                varied = augment(pair, recipe.augment, recipe.model.fps, rng=rng)
                made.append(masked_rows(varied, recipe, rng=rng))
                size += max(len(made[-1].starts), 1)
                if time.monotonic() > until:
                    break
            counts.append(sum(len(rows.starts) for rows in made[first:]))
        self.rows = join_rows(made)
        starts = np.split(self.rows.starts, np.cumsum(counts)[:-1])
        self.pools = [(part, own) for (part, _), own in zip(pools, starts, strict=True) if len(own)]

    def __len__(self) -> int:
        return self.steps

    def __getitem__(self, step: int) -> Examples:
        if not 0 <= step < self.steps:
            raise IndexError(step)
        rng = generator(self.seed, self.first + step, Stream.WINDOWS)
        shares = np.array([share for share, _ in self.pools])
        starts = np.stack([rng.choice(own, self.batch) for _, own in self.pools])
        pool = rng.choice(len(starts), self.batch, p=shares / shares.sum())
        starts = starts[pool, np.arange(self.batch)]
        return cut_examples(self.rows, starts[self.share], self.recipe.model)


def validation_batches(pairs: list[PosePair], recipe: Recipe, *, seed: int, batch: int) -> list[Examples]:
    """Return examples of every recording once, masked but not augmented; windows overlap by half."""
    found = []
    for number, pair in enumerate(pairs):
        rows = masked_rows(pair, recipe, rng=generator(seed, number, Stream.VALIDATION))
        starts = rows.starts[:: max(1, recipe.model.frames // 2)]
        found += [cut_examples(rows, starts[i : i + batch], recipe.model) for i in range(0, len(starts), batch)]
    return found


def calibration_poses(pairs: list[PosePair], recipe: Recipe, *, seed: int) -> Iterator[tuple[Poses3D, Poses3D]]:
    """Yield poses to complete and their truth: all captured ones, then all true ones under several masks."""
    truths = [convert(pair.truth, pair.truth.skeleton.parts[-1]) for pair in pairs]
    yield from ((pair.captured, truth) for pair, truth in zip(pairs, truths, strict=True) if pair.captured)
    # One mask of every recording before the next, so that many recordings are masked even if time runs out.
    rngs = [generator(seed, number, Stream.VALIDATION) for number in range(len(pairs))]
    for _ in range(_DRAWS):
        for pair, truth, rng in zip(pairs, truths, rngs, strict=True):
            yield masked_poses(PosePair(pair.truth), recipe, rng=rng), truth
