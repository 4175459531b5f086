"""Pool the statistics of several clips."""

from collections.abc import Iterable, Sequence
from dataclasses import fields, replace

import numpy as np

from dmae.data.clip import Clip
from dmae.parallel import in_parallel
from dmae.progress import progress
from synth.detector.statistics import DetectorStatistics, ErrorReference, measure

_SAMPLES = ("kind", "error", "inverted", "score", "miss_seconds")
"""Fields of `DetectorStatistics` that are concatenated. The other fields are averaged."""


def measure_all(
    clips: Iterable[Clip], count: int, workers: int = 1, reference: ErrorReference = ErrorReference.others
) -> DetectorStatistics:
    """Return the statistics of `count` clips as one: samples are concatenated, fractions averaged by clip length."""
    jobs = in_parallel(_measure, ((clip, reference) for clip in clips), workers)
    parts, frames = zip(*progress(jobs, "measuring", count), strict=True)
    return pool(parts, frames)


def _measure(clip: Clip, reference: ErrorReference) -> tuple[DetectorStatistics, int]:
    return measure(clip, reference), len(clip)


def pool(parts: Sequence[DetectorStatistics], frames: Sequence[int]) -> DetectorStatistics:
    """Return the pooled statistics of several clips; clip k has `frames[k]` frames.

    If clips have different numbers of cameras, shares by camera are replaced by their mean over all cameras, and
    `views` is empty.

    Raises:
        ValueError: the clips have several skeletons.
    """
    if len({part.kinds for part in parts}) > 1:
        raise ValueError("clips of several skeletons cannot be measured as one")
    if len({len(part.ghosts) for part in parts}) > 1:
        parts = [_over_views(part) for part in parts]
    values = {f.name: [getattr(part, f.name) for part in parts] for f in fields(DetectorStatistics)}

    def mean(name: str):
        if isinstance(values[name][0], dict):
            return {key: _mean([part[key] for part in values[name]], frames) for key in values[name][0]}
        return _mean(values[name], frames)

    shared = {"name": values["name"][0], "fps": values["fps"][0], "kinds": values["kinds"][0]}
    pooled = {name: np.concatenate(values[name]) for name in _SAMPLES}
    return DetectorStatistics(
        **shared, **pooled, **{name: mean(name) for name in values if name not in shared | pooled}
    )


def _over_views(part: DetectorStatistics) -> DetectorStatistics:
    """Return the statistics for a single camera: the mean of the known values over cameras."""
    shares = {}
    for name in ("missed", "person_missed", "ghosts", "fragments"):
        value = getattr(part, name)
        known = ~np.isnan(value)
        count = known.sum(0, keepdims=True)
        total = np.where(known, value, 0).sum(0, keepdims=True)
        shares[name] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    return replace(part, **shares, views=np.empty((len(part.kinds), 0)))


def _mean(values: list, weights: Sequence[int]):
    array = np.array(values, float)
    known = ~np.isnan(array)
    weight = np.where(known, np.reshape(np.asarray(weights, float), (-1, *(1,) * (array.ndim - 1))), 0)
    total = weight.sum(0)
    mean = np.where(total > 0, (weight * np.nan_to_num(array)).sum(0) / np.maximum(total, 1e-9), np.nan)
    return mean if mean.ndim else float(mean)
