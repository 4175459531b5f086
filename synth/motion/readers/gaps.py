"""Gaps in recordings: short gaps are interpolated, long gaps are cut out."""

from pathlib import Path

import numpy as np

from dmae.numerics.paths import neighbours, pchip

_LONGEST = 0.25
"""Longest gap that is interpolated, s; for the wrist of a walking person the error is about 2 cm."""


def fill_gaps(values: np.ndarray, names: list[str], fps: float, path: Path) -> tuple[np.ndarray, tuple[str, ...]]:
    """Fill short gaps and return the longest stretch without gaps.

    Gaps of up to a quarter of a second are filled by monotone cubic interpolation (Fritsch and Carlson, SIAM Journal on
    Numerical Analysis 17, 1980).

    Args:
        values: (F, K, C), NaN where missing.
        names: Names of the K recorded quantities, for messages.
        fps: Frames per second.
        path: The file, for messages.

    Returns:
        values: (n, K, C) values of the longest stretch.
        notes: Descriptions of the filled values and the omitted frames.

    Raises:
        ValueError: less than half of the recording is left.
    """
    values = np.where(np.isfinite(values), values, np.nan)
    lost = np.isnan(values).any(2)
    if not lost.any():
        return values, ()
    before, after = neighbours(~lost)
    short = lost & (before >= 0) & (after < len(values)) & (after - before - 1 <= _LONGEST * fps)
    filled = np.where(short[..., None], pchip(values), values)
    whole = ~np.isnan(filled).any((1, 2))
    edges = np.flatnonzero(np.diff(whole, prepend=False, append=False))
    first, end = max(zip(edges[::2], edges[1::2], strict=True), key=lambda run: run[1] - run[0], default=(0, 0))
    if end - first < 0.5 * len(values):
        share = lost.mean(0)
        worst = ", ".join(f"{names[k]} in {100 * share[k]:.0f} %" for k in share.argsort()[::-1][:5] if share[k])
        raise ValueError(
            f"{path}: expected at least half of {len(values)} frames in a row without gaps of more than {_LONGEST} s, "
            f"found {end - first}; missing are {worst}"
        )
    notes = [f"{short.sum()} values interpolated"] if short.any() else []
    if end - first < len(values):
        notes.append(f"frames {first + 1}-{end} of {len(values)}")
    return filled[first:end], tuple(notes)
