"""Truth to training batches: vary it, hide some of it, cut windows."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import torch
from scipy.signal import lfilter
from torch import Tensor
from torch.utils.data import Dataset

from dmae.bodyframe import turn
from dmae.clip import Clip, Poses3D
from dmae.fusion import true_pair
from dmae.hiding import HidingConfig, hide
from dmae.mapping import convert
from dmae.metrics import match, take_matched
from dmae.model import ModelConfig
from dmae.resample import resample
from dmae.rng import Stream, generator
from dmae.skeleton import Skeleton
from dmae.windows import Rows, Windows, join_rows, make_rows

_LASTING = 0.75
"""How errors of neighbouring frames at 25 frames/s correlate, about as those of OpenPose do."""


_DRAWS = 5
"""How often holes are made in a true recording, for uncertainty to be calibrated by."""

_SEEN = 0.5
"""Share of the joints that are hidden for the sake of the example and yet keep their rays."""


class Examples(NamedTuple):
    """Windows and what is true in them."""

    windows: Windows
    truth: Tensor
    """(B, T, J, 3) m, zero where unknown."""
    hidden: Tensor
    """(B, T, J) True where the truth is known and the network was not shown the joint of a person who is there."""
    shown: Tensor
    """(B, T, J) True where the truth is known and the network was shown the joint, errors included."""


@dataclass(frozen=True)
class AugmentConfig:
    """How recordings are varied each time they are drawn."""

    turn: float = 3.141592653589793
    """rad; each person is turned about the vertical by up to this much either way."""
    mirror: float = 0.5
    """Share of the persons that swap left and right."""
    reverse: float = 0.5
    """Share of the recordings that run backwards."""
    scale: float = 0.1
    """Standard deviation of the logarithm of a person's size."""
    speed: float = 0.2
    """The logarithm of a recording's speed is uniform within this much either way."""
    clean: float = 0.3
    """Share of the times a captured recording is drawn at which its truth is given in place of what was captured: or
    else the network mistrusts all that lies beside a hole."""
    noise: float = 0.0
    """m; where there is only truth, joints shown have errors whose deviation is, by person, uniform up to this."""


@dataclass(frozen=True)
class Recording:
    """What there is to learn from.

    Attributes:
        truth: F frames, P persons, J joints.
        captured: The same persons in the same order as cameras measured them, holes and errors included;
            None where nobody captured them. On the skeleton of the truth, of two side by side on the first.
    """

    truth: Poses3D
    captured: Poses3D | None = None


@dataclass(frozen=True)
class Recipe:
    """How examples are made of true poses."""

    model: ModelConfig
    rest: np.ndarray
    hiding: HidingConfig = field(default_factory=HidingConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)


def record(clip: Clip, skeleton: Skeleton, fps: float) -> Recording:
    """What there is to learn from a clip: its truth, and its `poses` as measurements of it, where it has any.

    Raises:
        ValueError: the clip has no truth, or for two skeletons side by side (`dmae.fusion`) no truth on the second.
        KeyError: the skeleton cannot be had from those of the clip.
    """
    if clip.truth is None:
        raise ValueError(f"clip {clip.id!r} has no truth to learn from")
    source, target = skeleton.parts[0], skeleton.parts[-1]
    truth = convert(clip.truth, skeleton) if source is target else true_pair(clip.truth, skeleton)
    if clip.poses is None:
        return Recording(resample(truth, clip.fps, fps))
    poses = convert(clip.poses, source)
    measured = Poses3D(source, np.where(poses.measured[..., None], poses.xyz, np.nan), rays=poses.rays)
    matches = match(convert(measured, target).xyz, convert(truth, target).xyz)
    captured = Poses3D(source, take_matched(measured.xyz, matches), rays=take_matched(measured.rays, matches))
    return Recording(resample(truth, clip.fps, fps), resample(captured, clip.fps, fps))


class TrainingBatches(Dataset):
    """The batches of one epoch. Batch i is the same whenever and by whichever worker it is asked for.

    Recordings are varied, hidden and interpolated whole, anew in every epoch, so that gaps may be longer
    than windows; then windows are drawn from all of them.
    """

    def __init__(
        self,
        recordings: list[Recording],
        recipe: Recipe,
        *,
        seed: int,
        epoch: int,
        steps: int,
        batch: int,
        replayed: list[Recording] | None = None,
        replay: float = 0.0,
    ):
        """
        Args:
            replayed: Recordings that a share `replay` of the windows is drawn from.
        """
        self.recipe, self.seed, self.first, self.steps, self.batch = recipe, seed, epoch * steps, steps, batch
        rng = generator(seed, epoch, Stream.HIDING)
        pool = []
        for group, share in ((recordings, 1 - replay), (replayed, replay)):
            size, order = 0, []
            # Twice as many rows as windows are drawn: neighbouring windows differ little.
            while size < 2 * steps * batch * share:
                order = order or list(rng.permutation(len(group)))
                recording = group[order.pop()]
                if rng.random() < recipe.augment.clean:
                    recording = Recording(recording.truth)
                pool.append(hidden_rows(vary(recording, recipe, rng=rng), recipe, rng=rng))
                size += max(len(pool[-1].starts), 1)
        self.rows = join_rows(pool)

    def __len__(self) -> int:
        return self.steps

    def __getitem__(self, step: int) -> Examples:
        if not 0 <= step < self.steps:
            raise IndexError(step)
        rng = generator(self.seed, self.first + step, Stream.WINDOWS)
        return examples(self.rows, rng.choice(self.rows.starts, self.batch), self.recipe.model)


def validation_batches(recordings: list[Recording], recipe: Recipe, *, seed: int, batch: int) -> list[Examples]:
    """Every recording once, as it is but for what is hidden; windows overlap by half."""
    found = []
    for number, recording in enumerate(recordings):
        rows = hidden_rows(recording, recipe, rng=generator(seed, number, Stream.VALIDATION))
        starts = rows.starts[:: max(1, recipe.model.frames // 2)]
        found += [examples(rows, starts[i : i + batch], recipe.model) for i in range(0, len(starts), batch)]
    return found


def as_measured(recordings: list[Recording], recipe: Recipe, *, seed: int) -> Iterator[tuple[Poses3D, Poses3D]]:
    """Poses as a model will be given them, and what is true of those it returns: captured ones as they are, and all
    true ones with joints hidden, now these and now those (`_DRAWS`)."""
    for number, recording in enumerate(recordings):
        truth = convert(recording.truth, recording.truth.skeleton.parts[-1])
        if recording.captured:
            yield recording.captured, truth
        rng = generator(seed, number, Stream.VALIDATION)
        yield from ((_hidden(Recording(recording.truth), recipe, rng=rng), truth) for _ in range(_DRAWS))


def vary(recording: Recording, recipe: Recipe, *, rng: np.random.Generator) -> Recording:
    """A recording at another speed, perhaps backwards; its persons turned, mirrored and scaled."""
    augment, fps = recipe.augment, recipe.model.fps
    faster, backwards = np.exp(rng.uniform(-augment.speed, augment.speed)), rng.random() < augment.reverse
    persons = recording.truth.xyz.shape[1]
    mirrored = rng.random(persons) < augment.mirror
    size = np.exp(rng.normal(0, augment.scale, (persons, 1, 1)))
    angle = rng.uniform(-augment.turn, augment.turn, (persons, 1))

    def varied(poses: Poses3D) -> Poses3D:
        new = resample(poses, fps, fps * faster)

        def move(points: np.ndarray, size: np.ndarray) -> np.ndarray:
            points = points.astype(np.float64)[:: -1 if backwards else 1]
            swapped = points[:, :, list(poses.skeleton.mirror)] * (1, -1, 1)
            return turn(np.where(mirrored[:, None, None], swapped, points) * size, angle)

        rays = np.stack([move(new.rays[..., 0, :], size), move(new.rays[..., 1, :], 1)], -2)
        return Poses3D(poses.skeleton, move(new.xyz, size), rays=rays)

    return Recording(varied(recording.truth), recording.captured and varied(recording.captured))


def hidden_rows(recording: Recording, recipe: Recipe, *, rng: np.random.Generator) -> Rows:
    """A recording as it was captured, or with errors made up, and with more joints hidden."""
    measured = _hidden(recording, recipe, rng=rng)
    truth, target = recording.truth.xyz, None
    if recording.truth.skeleton != measured.skeleton:
        target = recording.truth.skeleton.parts[-1]
        truth = np.where(np.arange(truth.shape[2])[:, None] < len(measured.skeleton), np.nan, truth)
    return make_rows(measured, recipe.model.fps, recipe.rest, recipe.model.frames, truth, target)


def _hidden(recording: Recording, recipe: Recipe, *, rng: np.random.Generator) -> Poses3D:
    source = recording.truth.skeleton.parts[0]
    measured = recording.captured or _disturb(convert(recording.truth, source), recipe.augment, rng=rng)
    hidden = hide(*measured.xyz.shape[:2], source, recipe.model.fps, recipe.hiding, rng=rng)
    # Of the joints hidden some are still seen by a camera, as are many of those that capture leaves open.
    seen = rng.random((1, *measured.xyz.shape[1:3])) < _SEEN
    rays = np.where((hidden & ~seen)[..., None, None], np.nan, measured.rays)
    return Poses3D(source, np.where(hidden[..., None], np.nan, measured.xyz), rays=rays)


def _disturb(truth: Poses3D, augment: AugmentConfig, *, rng: np.random.Generator) -> Poses3D:
    """Errors that last: an autoregressive process of stationary deviation."""
    deviation = rng.uniform(0, augment.noise, (truth.xyz.shape[1], 1, 1))
    white = rng.normal(size=truth.xyz.shape)
    white[1:] *= np.sqrt(1 - _LASTING**2)
    return Poses3D(truth.skeleton, truth.xyz + deviation * lfilter([1], [1, -_LASTING], white, axis=0))


def examples(rows: Rows, starts: np.ndarray, model: ModelConfig) -> Examples:
    """The windows that begin at `starts` and what is true in them."""
    windows, truth, _ = rows.cut(starts, model.frames, model.turn_to_front)
    known = ~np.isnan(truth).any(-1)
    there = rows.present[starts[:, None] + np.arange(model.frames)]
    known_there = torch.from_numpy(known & there[..., None])
    return Examples(
        windows,
        torch.from_numpy(np.nan_to_num(truth)),
        known_there & ~windows.observed,
        known_there & windows.observed,
    )
