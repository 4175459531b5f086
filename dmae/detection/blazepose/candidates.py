"""Candidates: regions of an image that may show a person. BlazePose's first network finds them in windows."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from dmae.detection.blazepose.landmarks import Person, painted_over
from dmae.detection.blazepose.models import Network
from dmae.detection.blazepose.regions import Region

_GRIDS = ((28, 2), (14, 2), (7, 6))
"""Grids of anchors: number of cells in a row, and number of anchors in a cell."""
_MIN_SCORE = 0.5
_MAX_OVERLAP = 0.3
"""Smallest intersection over union of two boxes of one person."""
_STEP = 0.5
"""Largest step from window to window, relative to the side of a window."""
_BODY_ENDS, _BODY_HALF_WIDTH = 0.9, 0.3
"""Extent of a body from the middle of its hips, relative to the radius of the circle around the body."""
_SAME_HIPS = 0.15
"""Boxes of one body: distance of the hips relative to the radius."""
_SAME_PLACE, _SAME_SIZE = 0.35, 1.6
"""Two regions of one person: distance of the centres relative to the radius, and ratio of the sizes."""


@dataclass(frozen=True)
class Candidate:
    """A region that may show a person.

    Attributes:
        region: The square around the body.
        score: From 0 to 1.
    """

    region: Region
    score: float


def windows_of(width: int, height: int, shares: tuple[float, ...]) -> list[Region]:
    """Return square windows that cover an image.

    Args:
        width: px.
        height: px.
        shares: Sides of the windows relative to the longer side of the image; 1 is the whole image.
    """
    found = []
    for share in shares:
        side = share * max(width, height)
        lefts, tops = _starts(width, side), _starts(height, side)
        found += [Region.upright(left, top, side) for top in tops for left in lefts]
    return found


def _starts(length: float, side: float) -> list[float]:
    """Return where windows begin, px. A window that is longer than the image is centred on it."""
    if side >= length:
        return [(length - side) / 2]
    count = int(np.ceil((length - side) / (_STEP * side))) + 1
    return np.linspace(0, length - side, count).tolist()


def find_candidates(
    network: Network, pyramid: list[np.ndarray], windows: Iterable[Region], without: Sequence[Person] = ()
) -> list[Candidate]:
    """Return the candidates in windows of an image, best first, each person once.

    Args:
        network: BlazePose's first network.
        pyramid: The image (H, W, 3) uint8 and its smaller copies.
        windows: As `windows_of` returns them.
        without: People that are painted over first.
    """
    height, width = pyramid[0].shape[:2]
    found = [
        candidate
        for window in windows
        for candidate in _in_window(network, pyramid, window, without)
        if not _is_cut(candidate.region, window, width, height)
    ]
    kept: list[Candidate] = []
    for candidate in sorted(found, key=lambda each: -each.score):
        if not any(same_region(candidate.region, each.region) for each in kept):
            kept.append(candidate)
    return kept


def same_region(a: Region, b: Region) -> bool:
    """Return whether two regions are of one person."""
    ratio = a.side / b.side
    near = np.hypot(*(a.centre - b.centre)) < _SAME_PLACE * max(a.radius, b.radius)
    return bool(near and 1 / _SAME_SIZE < ratio < _SAME_SIZE)


@cache
def anchors() -> np.ndarray:
    """Return the centres (2254, 2) of the anchors, from 0 to 1."""
    grids = []
    for cells, number in _GRIDS:
        y, x = np.mgrid[:cells, :cells] + 0.5
        grids.append(np.repeat(np.stack([x, y], -1).reshape(-1, 2) / cells, number, axis=0))
    return np.concatenate(grids)


def _in_window(
    network: Network, pyramid: list[np.ndarray], window: Region, without: Sequence[Person]
) -> list[Candidate]:
    pixels = painted_over(window.cut(pyramid, network.size), window, without).astype(np.float32) / 127.5 - 1
    values, logits = network(pixels, "Identity", "Identity_1")
    scores = 1 / (1 + np.exp(-np.clip(logits[:, 0].astype(np.float64), -100, 100)))
    likely = scores >= _MIN_SCORE
    if not likely.any():
        return []
    values = values[likely].reshape(-1, 6, 2).astype(np.float64) / network.size
    # Centre, size and four points; all but the size are relative to the anchor.
    values[:, [0, 2, 3, 4, 5]] += anchors()[likely][:, None]
    candidates = []
    for merged, score in _merged(values, scores[likely]):
        hip, top = window.to_picture(merged[2:4])
        if (region := Region.around(hip, top)) is not None:
            candidates.append(Candidate(region, score))
    return candidates


def _merged(values: np.ndarray, scores: np.ndarray) -> list[tuple[np.ndarray, float]]:
    """Weighted suppression: return the mean, weighted by score, of each group of boxes that overlap the best of it.

    Args:
        values: (n, 6, 2) centre and size of the boxes, and points.
        scores: (n,).
    """
    low, high = values[:, 0] - values[:, 1] / 2, values[:, 0] + values[:, 1] / 2
    area, found = np.prod(np.maximum(high - low, 0), -1), []
    left = np.argsort(-scores, kind="stable")
    while len(left):
        best = left[0]
        overlap = np.minimum(high[left], high[best]) - np.maximum(low[left], low[best])
        both = np.prod(np.maximum(overlap, 0), -1)
        same = both > _MAX_OVERLAP * np.maximum(area[left] + area[best] - both, 1e-12)
        same &= _same_body(values[left], values[best])
        same[0] = True
        group = left[same]
        found.append((np.average(values[group], axis=0, weights=scores[group]), float(scores[best])))
        left = left[~same]
    return found


def _same_body(values: np.ndarray, best: np.ndarray) -> np.ndarray:
    """Return (n,) True for boxes (n, 6, 2) of the same body as another box (6, 2): near hips and a similar size.

    The boxes of two people overlap when one stands in front of the other. Their mean would fit neither person.
    """
    radius, own = (np.maximum(np.hypot(*(each[..., 3, :] - each[..., 2, :]).T), 1e-6) for each in (values, best))
    apart = np.hypot(*(values[:, 2] - best[2]).T)
    return (apart < _SAME_HIPS * own) & (np.abs(np.log(radius / own)) < np.log(_SAME_SIZE))


def _is_cut(region: Region, window: Region, width: int, height: int) -> bool:
    """Return whether a window cuts a body at a side that is not a side of the image.

    A window that cuts a body often yields a smaller body that looks right.
    """
    across = np.array([-region.up[1], region.up[0]])
    body = np.array(
        [
            region.centre + region.radius * (along * region.up + aside * across)
            for along in (-_BODY_ENDS, _BODY_ENDS)
            for aside in (-_BODY_HALF_WIDTH, _BODY_HALF_WIDTH)
        ]
    )
    low, high = np.maximum(body.min(0), 0), np.minimum(body.max(0), (width, height))
    start = window.centre - window.side / 2
    return bool((low < start).any() or (high > start + window.side).any())
