"""Scores of a hand-in over all clips: means over levels with their intervals, and figures by cause, length and part."""

import numpy as np

from dmae.evaluation.benchmark.cells import AXES, SHAPE
from dmae.metrics.intervals import Interval, bootstrap_ratio
from dmae.metrics.time_blocks import BlockSums

_COUNTS = ("holes", "filled", "mm", "stated", "held", "near")


def completion_summary(levels: dict[str, int], cells: dict[str, dict]) -> dict:
    """Return the scores of completed poses.

    Args:
        levels: The index of the level of each clip, by id.
        cells: What `completion_cells` returned for each clip, by id.

    Returns:
        JSON-able; None stands for "not measured". `mm`, the mean error of holes, is the mean over levels with its 95 %
        interval over clips; `levels`, `cause`, `frames`, `part` and `cells` (flat, in the order of `AXES`) split it.
        `filled`, % of the holes that were filled. `held`, % of the filled holes with a covariance that are within their
        90 % region, and `held_cause`, `held_frames`. `seen`, mm, the error of measured joints.
    """
    sums = _sums(cells)
    if not sums["filled"].sum():
        none = dict.fromkeys(("mm", "levels", "cause", "frames", "part", "cells", "held", "held_cause", "held_frames"))
        return none | {"filled": 0.0, "seen": _ratio(sums["seen_mm"], sums["seen"])}
    of_level = [_sums({name: cells[name] for name in cells if levels[name] == level}) for level in _numbers(levels)]
    return {
        "mm": interval_json(bootstrap_ratio(clip_sums(levels, cells))),
        "levels": [_ratio(each["mm"].sum(), each["holes"].sum()) for each in of_level],
        **{axis: _by_axis(sums, axis, "mm", "holes") for axis in AXES},
        "cells": [_ratio(mm, count, 1) for mm, count in zip(sums["mm"].ravel(), sums["holes"].ravel(), strict=True)],
        "filled": _ratio(100 * sums["filled"].sum(), sums["holes"].sum()),
        "held": _ratio(100 * sums["held"].sum(), sums["stated"].sum()),
        "held_cause": _by_axis(sums, "cause", "held", "stated", 100),
        "held_frames": _by_axis(sums, "frames", "held", "stated", 100),
        "seen": _ratio(sums["seen_mm"], sums["seen"]),
    }


def capture_summary(levels: dict[str, int], cells: dict[str, dict]) -> dict:
    """Return the scores of poses of any capture.

    Arguments are as for `completion_summary`, of what `capture_cells` returned.

    Returns:
        JSON-able; None stands for "not measured". `pcp`, strict, %. Of joints that fewer than two cameras saw `near`, %
        within 0.1 m, `found`, %, and `mm`, the error of those found; `cause` and `levels` split `near`. `seen_near`,
        `seen_found` and `seen_mm` are the same of the other joints. `extra`, % of persons in a frame that match no true
        person.
    """
    sums = _sums(cells)
    names = ("pcp", "near", "found", "mm", "cause", "levels", "seen_near", "seen_found", "seen_mm", "extra")
    if not sums["persons"]:
        return dict.fromkeys(names)
    of_level = [_sums({name: cells[name] for name in cells if levels[name] == level}) for level in _numbers(levels)]
    holes = sums["holes"].sum()
    return {
        "pcp": _ratio(100 * sums["correct"], sums["limbs"]),
        "near": _ratio(100 * sums["near"].sum(), holes),
        "found": _ratio(100 * sums["filled"].sum(), holes),
        "mm": _ratio(sums["mm"].sum(), sums["filled"].sum()),
        "cause": _by_axis(sums, "cause", "near", "holes", 100),
        "levels": [_ratio(100 * each["near"].sum(), each["holes"].sum()) for each in of_level],
        "seen_near": _ratio(100 * sums["seen_near"], sums["seen"]),
        "seen_found": _ratio(100 * sums["seen_found"], sums["seen"]),
        "seen_mm": _ratio(sums["seen_mm"], sums["seen_found"]),
        "extra": _ratio(100 * sums["extra"], sums["persons"]),
    }


def clip_sums(levels: dict[str, int], cells: dict[str, dict]) -> BlockSums:
    """Return errors and numbers of holes, one ratio for each level; the bootstrap draws the clips of a level."""
    groups = [[cells[name] for name in cells if levels[name] == level] for level in _numbers(levels)]
    longest = max(map(len, groups))
    total, count = (
        np.array([[sum(each[key]) for each in group] + [0] * (longest - len(group)) for group in groups], float)
        for key in ("mm", "holes")
    )
    number = len(groups)
    blocks = np.array([len(group) for group in groups])
    return BlockSums(total, count, np.arange(number), np.full(number, 1 / number), blocks)


def interval_json(interval: Interval) -> dict:
    """Return an interval as JSON, None where it is unknown."""
    return {name: _rounded(value) for name, value in vars(interval).items()}


def _numbers(levels: dict[str, int]) -> list[int]:
    return sorted(set(levels.values()))


def _sums(cells: dict[str, dict]) -> dict:
    """Return sums over clips: arrays of `SHAPE`, and numbers."""
    first = next(iter(cells.values()))
    return {
        key: np.sum([each[key] for each in cells.values()], 0).reshape(SHAPE)
        if key in _COUNTS
        else sum(each[key] for each in cells.values())
        for key in first
    }


def _by_axis(sums: dict, axis: str, numerator: str, denominator: str, scale: float = 1) -> dict[str, float | None]:
    others = tuple(number for number, name in enumerate(AXES) if name != axis)
    total, count = (sums[key].sum(others) for key in (numerator, denominator))
    return {name: _ratio(scale * total[i], count[i]) for i, name in enumerate(AXES[axis])}


def _ratio(total: float, count: float, digits: int = 2) -> float | None:
    return _rounded(total / count, digits) if count else None


def _rounded(value: float, digits: int = 2) -> float | None:
    return None if np.isnan(value) else round(float(value), digits)
