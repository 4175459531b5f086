"""Reading: clips to pairs of poses to learn from, and which of them are held back for validation."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from dmae.completion.training.config import ExamplesConfig, TrainConfig
from dmae.completion.training.pose_pairs import PosePair, pose_pair
from dmae.data.clip import Clip
from dmae.data.rng import Stream, generator
from dmae.data.skeleton import Skeleton
from dmae.formats.reading import camera_subsets
from dmae.progress import progress
from dmae.reconstruction.pipeline import capture

_BY = " by "
"""Between the name of a clip and the cameras that captured it."""


@dataclass(frozen=True)
class TrainingSet:
    """Pairs of poses by the names of their clips.

    Attributes:
        pairs: To learn from.
        extra: Those that `examples.replay` is a share of; none without it.
        validation: To validate and calibrate on.
    """

    pairs: dict[str, PosePair]
    extra: dict[str, PosePair]
    validation: dict[str, PosePair]

    @property
    def all(self) -> dict[str, PosePair]:
        return self.pairs | self.extra | self.validation


def read_training_set(
    clips: Iterable[Clip], extra: Iterable[Clip], validation: Iterable[Clip], skeleton: Skeleton, config: TrainConfig
) -> TrainingSet:
    """Read clips to learn from and to validate on.

    Raises:
        ValueError: a clip has no truth, two clips have one name, or no clip has a person in it.
    """
    pairs, more, held_back = (_read(found, skeleton, config) for found in (clips, extra, validation))
    twice = sorted(pairs.keys() & more.keys())
    if twice:
        raise ValueError(_same_name(twice[0]))
    if not pairs:
        raise ValueError(f"{config.data.path}: nothing to learn from, no clip has a person in it")
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
    """Return pairs of poses by the names of their clips; clips without people are left out."""
    found = {}
    for clip in progress(_captured(clips, skeleton, config), "reading"):
        if clip.id in found:
            raise ValueError(_same_name(clip.id))
        found[clip.id] = pose_pair(clip, skeleton, config.model.fps)
    return {name: pair for name, pair in found.items() if not np.isnan(pair.truth.xyz).all()}


def _captured(clips: Iterable[Clip], skeleton: Skeleton, config: TrainConfig) -> Iterator[Clip]:
    """Yield clips; those without poses are captured if `views` asks for it, or the skeleton lacks truth."""
    for clip in clips:
        lacking = clip.truth is not None and clip.truth.skeleton in skeleton.parts[1:]
        if clip.poses is not None or not (config.examples.views or lacking):
            yield clip
            continue
        for cameras in camera_subsets(clip, config.examples.views):
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
