"""Masks of persons as COCO's run lengths, and boxes."""

from typing import TypedDict

import numpy as np

Box = tuple[float, float, float, float]
"""x and y of the upper left corner, width, height, px."""


class RunLengths(TypedDict):
    """A mask as COCO's uncompressed run lengths. `pycocotools.mask.frPyObjects` reads it."""

    size: list[int]
    """Height and width, px."""
    counts: list[int]
    """Lengths of the runs of pixels outside, inside, outside, ... the mask, counted down each column."""


def encode_mask(mask: np.ndarray) -> RunLengths:
    """Return the run lengths of a mask (H, W) of bool."""
    down = np.asarray(mask, bool).ravel(order="F")
    changes = np.flatnonzero(down[1:] != down[:-1]) + 1
    ends = np.concatenate([[0] if down.size and down[0] else [], [0], changes, [down.size]]).astype(int)
    return {"size": list(mask.shape), "counts": np.diff(ends).tolist()}


def decode_mask(runs: RunLengths) -> np.ndarray:
    """Return the mask (H, W) of bool that run lengths describe."""
    inside = np.arange(len(runs["counts"])) % 2 == 1
    return np.repeat(inside, runs["counts"]).reshape(runs["size"], order="F")


def mask_box(mask: np.ndarray) -> Box | None:
    """Return the box around the pixels of a mask (H, W), with whole pixels as in COCO; None if the mask is empty."""
    columns, rows = np.flatnonzero(mask.any(0)), np.flatnonzero(mask.any(1))
    if not len(columns):
        return None
    low, high = (columns[0], rows[0]), (columns[-1], rows[-1])
    return int(low[0]), int(low[1]), int(high[0] - low[0] + 1), int(high[1] - low[1] + 1)


def joints_box(xy: np.ndarray, labelled: np.ndarray) -> Box | None:
    """Return the box around the points xy (J, 2) px where `labelled` (J,) is True; None if no joint is labelled."""
    if not labelled.any():
        return None
    points = np.asarray(xy[labelled], np.float64).round(3)
    low, high = points.min(0), points.max(0)
    return (*low.tolist(), *(high - low).round(3).tolist())
