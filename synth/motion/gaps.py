"""What recordings lost: short gaps are bridged, long ones left out."""

from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

_LONGEST = 0.25
"""Gaps up to here are interpolated, s; of a walker's wrist that costs some 2 cm."""


def fill_gaps(values: np.ndarray, names: list[str], fps: float, path: Path) -> tuple[np.ndarray, tuple[str, ...]]:
    """The longest stretch of a recording without gaps, once short gaps are filled.

    Gaps of up to a quarter of a second are bridged by monotone cubic interpolation (Fritsch and Carlson, SIAM Journal
    on Numerical Analysis 17, 1980).

    Args:
        values: (F, K, C) of which NaN is missing.
        names: K names of what is recorded.
        fps: Frames per second.
        path: Of the file, for messages.

    Returns:
        values: (frames, K, C), frames as many as the stretch has.
        notes: What was filled and what left out, for people to read.

    Raises:
        ValueError: less than half of the recording is left.
    """
    values = np.where(np.isfinite(values), values, np.nan)
    lost = np.isnan(values).any(2)
    if not lost.any():
        return values, ()
    filled, frames = values.copy(), np.arange(len(values))
    bridged = 0
    for k in np.flatnonzero(lost.any(0)):
        edges = np.flatnonzero(np.diff(lost[:, k], prepend=False, append=False))
        short = np.zeros(len(values), bool)
        for first, end in zip(edges[::2], edges[1::2], strict=True):
            short[first:end] = first > 0 and end < len(values) and (end - first) <= _LONGEST * fps
        if short.any():
            seen = ~lost[:, k]
            filled[short, k] = PchipInterpolator(frames[seen], values[seen, k])(frames[short])
            bridged += int(short.sum())
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
    notes = [f"{bridged} values interpolated"] if bridged else []
    if end - first < len(values):
        notes.append(f"frames {first + 1}-{end} of {len(values)}")
    return filled[first:end], tuple(notes)
