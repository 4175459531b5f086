"""Corrupt a clip: apply corruptions, each at a level, with random numbers that depend on the clip's id and a seed."""

from collections.abc import Mapping
from dataclasses import replace
from zlib import crc32

import numpy as np

from dmae.data.clip import Clip, Poses3D
from dmae.data.rng import Stream
from dmae.evaluation.corruption.people import people_of
from dmae.evaluation.corruption.registry import Corruption, find_corruption
from dmae.reconstruction.config import CaptureConfig


def corrupt(clip: Clip, levels: Mapping[str, float], *, seed: int = 0, people: Poses3D | None = None) -> Clip:
    """Return the clip with corruptions applied; the clip itself if all levels are 0.

    The truth does not change, except that some frames may be removed. Images and poses are removed, because they do not
    belong to the new detections.

    Args:
        clip: Simulated or real.
        levels: Level of each corruption by name (`dmae.evaluation.corruption.registry`), or by `module:function`.
        seed: Seed of random numbers. A corruption draws the same numbers with and without other corruptions.
        people: People of the clip, by default `people_of`.

    Raises:
        ValueError: there is no such corruption or level, or the clip has too few cameras or people for it.
    """
    found = {find_corruption(name): level for name, level in levels.items()}
    for entry, level in found.items():
        check(entry, level, clip)
    active = sorted(((entry, level) for entry, level in found.items() if level), key=lambda each: each[0].order)
    if not active:
        return clip
    corrupted = replace(clip, poses=people or people_of(clip, CaptureConfig()), images=None)
    for entry, level in active:
        key = (int(Stream.STRESS), crc32(clip.id.encode()), crc32(entry.name.encode()))
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=key))
        corrupted = entry.function(corrupted, level, rng=rng)
    return replace(corrupted, poses=None)


def check(entry: Corruption, level: float, clip: Clip) -> None:
    """Raise ValueError where a corruption has no such level, or cannot be applied to a clip at that level."""
    entry.check(level)
    if not level:
        return
    if entry.fewer_cameras and len(clip.rig) - level < 2:
        raise ValueError(
            f"{entry.name}={level:g}: clip {clip.id!r} has {len(clip.rig)} cameras, and two must be left; expected "
            f"levels up to {len(clip.rig) - 2}"
        )
    most = int(clip.detections.observed.any(-1).sum(-1).max(initial=0))
    if most < entry.people:
        raise ValueError(
            f"{entry.name}={level:g}: expected {entry.people} people or more in an image, clip {clip.id!r} has at most "
            f"{most}; leave this corruption out"
        )
