"""The mistakes that calibrations and detections usually come with, and recordings with one of them undone."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import partial
from itertools import combinations

import numpy as np

from dmae.epipolar import Reading, agree, look


class Fault(StrEnum):
    """What can be wrong."""

    inverse = "extrinsics are inverse"
    centre = "translation is the camera's centre"
    transposed_rotation = "rotation is transposed"
    focal = "focal lengths are swapped"
    principal = "principal point is swapped"
    mirrored = "x is mirrored"
    flipped = "y is flipped"
    upside_down = "image is upside down"
    turned_left = "image is turned left"
    turned_right = "image is turned right"
    swapped_axes = "x and y are swapped"
    scale = "detections are of another resolution"
    distorted = "distortion is ignored"
    undistorted = "distortion was removed already"
    distortion_sign = "distortion has the wrong sign"
    order = "cameras are exchanged"
    delay = "cameras are out of step"
    unit = "unit of length is wrong"
    up = "another axis is up"
    size = "image size is transposed"
    unexplained = "calibration and detections disagree"


@dataclass(frozen=True)
class Mending:
    """A reading with one fault undone.

    Attributes:
        fault: Which.
        views: Cameras that had it.
        reading: Without it.
        amount: By how much, where that is a number: scale of the detections, k1.
    """

    fault: Fault
    views: tuple[int, ...]
    reading: Reading
    amount: float = 1.0


Scores = dict[tuple[int, int], np.ndarray]
"""Of pairs of views: (2, S) the sum of their detections' agreement in a frame, and how many these are."""


def scores(reading: Reading, frames: np.ndarray, pairs: list[tuple[int, int]]) -> Scores:
    """How pairs of views agree in frames (S,)."""
    views = sorted({view for pair in pairs for view in pair})
    found = agree(look(reading, frames, views), [(views.index(a), views.index(b)) for a, b in pairs])
    return dict(zip(pairs, np.stack([found.total, found.detections], 1), strict=True))


def mean_agreement(found: Scores) -> float:
    """Mean agreement, from 0 to 1, of the detections in pairs of views; 0 where there are none."""
    total, detections = sum(found.values()).sum(-1)
    return float(total / max(detections, 1))


def _extrinsics(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Reading, list[int]], Reading]:
    """Change poses (n, 4, 4) as the file writes them."""

    def mend(reading: Reading, views: list[int]) -> Reading:
        file = reading.convention.written_rig(reading.rig)
        pose = file.cam_from_world.copy()
        pose[views] = change(pose[views])
        return replace(reading, rig=reading.convention.rig(replace(file, cam_from_world=pose)))

    return mend


def _from_centre(pose: np.ndarray) -> np.ndarray:
    pose = pose.copy()
    pose[:, :3, 3] = -np.einsum("vij,vj->vi", pose[:, :3, :3], pose[:, :3, 3])
    return pose


def _transposed(pose: np.ndarray) -> np.ndarray:
    pose = pose.copy()
    pose[:, :3, :3] = pose[:, :3, :3].swapaxes(-1, -2)
    return pose


def _intrinsics(column: int | None) -> Callable[[Reading, list[int]], Reading]:
    """Swap the two focal lengths, or with column 2 the principal point's coordinates."""

    def mend(reading: Reading, views: list[int]) -> Reading:
        K = reading.rig.K.copy()
        x, y = (0, 1) if column is None else (column, column)
        K[views, 0, x], K[views, 1, y] = K[views, 1, y], K[views, 0, x]
        return replace(reading, rig=replace(reading.rig, K=K))

    return mend


def _pixels(change: Callable[[np.ndarray, np.ndarray, float, float], tuple]) -> Callable[[Reading, list[int]], Reading]:
    """Change x and y of detections, given the last column and row of the calibration's image."""

    def mend(reading: Reading, views: list[int]) -> Reading:
        xy = reading.xy.copy()
        for view in views:
            right, bottom = reading.rig.size[view] - 1
            xy[:, view] = np.stack(change(xy[:, view, ..., 0], xy[:, view, ..., 1], right, bottom), -1)
        return replace(reading, xy=xy)

    return mend


def lens(reading: Reading, views: list[int], change: Callable[[np.ndarray], np.ndarray]) -> Reading:
    """Change the distortion (n, 5..8) of some views."""
    dist = reading.rig.dist.copy()
    dist[views] = change(dist[views])
    return replace(reading, rig=replace(reading.rig, dist=dist))


def _without_lens(reading: Reading, views: list[int]) -> Reading:
    mended = lens(reading, views, np.zeros_like)
    fisheye = mended.rig.fisheye & ~np.isin(np.arange(len(mended.rig)), views)
    return replace(mended, rig=replace(mended.rig, fisheye=fisheye))


def _mirrored(reading: Reading, views: list[int]) -> Reading:
    """As a detector sees a mirrored image: its left is the right."""
    mended = _MENDINGS[Fault.mirrored](reading, views)
    xy = mended.xy.copy()
    xy[:, views] = xy[:, views][..., list(reading.skeleton.mirror), :]
    return replace(mended, xy=xy)


def scaled(reading: Reading, views: list[int], scale: float) -> Reading:
    """Detections of some views as they were before being scaled."""
    xy = reading.xy.copy()
    xy[:, views] /= scale
    return replace(reading, xy=xy)


_MENDINGS = {
    Fault.inverse: _extrinsics(np.linalg.inv),
    Fault.centre: _extrinsics(_from_centre),
    Fault.transposed_rotation: _extrinsics(_transposed),
    Fault.focal: _intrinsics(None),
    Fault.principal: _intrinsics(2),
    Fault.mirrored: _pixels(lambda x, y, right, bottom: (right - x, y)),
    Fault.flipped: _pixels(lambda x, y, right, bottom: (x, bottom - y)),
    Fault.upside_down: _pixels(lambda x, y, right, bottom: (right - x, bottom - y)),
    Fault.turned_left: _pixels(lambda x, y, right, bottom: (right - y, x)),
    Fault.turned_right: _pixels(lambda x, y, right, bottom: (y, bottom - x)),
    Fault.swapped_axes: _pixels(lambda x, y, right, bottom: (y, x)),
    Fault.undistorted: _without_lens,
    Fault.distortion_sign: partial(lens, change=np.negative),
}


# The same fault twice: coordinates alone mirrored, or images mirrored before people were detected in them.
_ALL_MENDINGS = [*_MENDINGS.items(), (Fault.mirrored, _mirrored)]


def simple_mendings(reading: Reading) -> Iterator[Mending]:
    """The faults of all cameras, or of one, that are there or not, each undone; and any two cameras exchanged."""
    views = list(range(len(reading.rig)))
    for fault, mend in _ALL_MENDINGS:
        for some in [views, *([view] for view in views)]:
            mended = mend(reading, some)
            if mended.xy is not reading.xy:
                yield Mending(fault, tuple(some), mended)
                continue
            # Focal lengths that are equal, lenses that do not distort: there is nothing to mend.
            parts = [
                (getattr(reading.rig, name), getattr(mended.rig, name))
                for name in ("K", "dist", "fisheye", "cam_from_world")
            ]
            differ = np.any([~np.isclose(x, y).reshape(len(x), -1).all(-1) for x, y in parts], 0)
            if differ.sum() > 1 or differ[some].all():
                yield Mending(fault, tuple(int(view) for view in np.flatnonzero(differ)), mended)
    for a, b in combinations(views, 2):
        order = views.copy()
        order[a], order[b] = b, a
        yield Mending(Fault.order, (a, b), replace(reading, xy=reading.xy[:, order], delay=reading.delay[order]))
