"""Corrections: hypotheses with one fault undone, for faults that are either present or absent."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np

from dmae.calibration.faults import Fault
from dmae.calibration.hypothesis import Hypothesis


@dataclass(frozen=True)
class Correction:
    """A hypothesis with one fault undone.

    Attributes:
        fault: The fault.
        views: Cameras that had it.
        hypothesis: Cameras and detections without it.
        amount: Its amount, for faults that have one: scale of the detections, k1.
    """

    fault: Fault
    views: tuple[int, ...]
    hypothesis: Hypothesis
    amount: float = 1.0


Correct = Callable[[Hypothesis, list[int]], Hypothesis]
"""A function that undoes a fault of some views."""


def binary_corrections(hypothesis: Hypothesis) -> Iterator[Correction]:
    """Undo each fault that is present or absent, of all cameras and of each one; then exchange pairs of cameras."""
    views = list(range(len(hypothesis.rig)))
    for fault, correct in (*_CORRECTIONS.items(), (Fault.mirrored, _unmirrored_image)):
        for part in [views, *([view] for view in views)]:
            corrected = correct(hypothesis, part)
            if corrected.xy is not hypothesis.xy:
                yield Correction(fault, tuple(part), corrected)
                continue
            # The correction changes nothing, for example with equal focal lengths or without distortion.
            parts = [
                (getattr(hypothesis.rig, name), getattr(corrected.rig, name))
                for name in ("K", "dist", "fisheye", "cam_from_world")
            ]
            differ = np.any([~np.isclose(x, y).reshape(len(x), -1).all(-1) for x, y in parts], 0)
            if differ.sum() > 1 or differ[part].all():
                yield Correction(fault, tuple(int(view) for view in np.flatnonzero(differ)), corrected)
    for a, b in combinations(views, 2):
        order = views.copy()
        order[a], order[b] = b, a
        exchanged = replace(
            hypothesis, xy=hypothesis.xy[:, order], score=hypothesis.score[:, order], offsets=hypothesis.offsets[order]
        )
        yield Correction(Fault.order, (a, b), exchanged)


def rescale(hypothesis: Hypothesis, views: list[int], scale: float) -> Hypothesis:
    """Divide the detections of some views by a scale."""
    xy = hypothesis.xy.copy()
    xy[:, views] /= scale
    return replace(hypothesis, xy=xy)


def change_distortion(
    hypothesis: Hypothesis, views: list[int], change: Callable[[np.ndarray], np.ndarray]
) -> Hypothesis:
    """Change the distortion (n, 5..8) of some views."""
    dist = hypothesis.rig.dist.copy()
    dist[views] = change(dist[views])
    return replace(hypothesis, rig=replace(hypothesis.rig, dist=dist))


def _extrinsics(change: Callable[[np.ndarray], np.ndarray]) -> Correct:
    """Change poses (n, 4, 4) in the convention of the files."""

    def correct(hypothesis: Hypothesis, views: list[int]) -> Hypothesis:
        written = hypothesis.convention.written_rig(hypothesis.rig)
        pose = written.cam_from_world.copy()
        pose[views] = change(pose[views])
        return replace(hypothesis, rig=hypothesis.convention.rig(replace(written, cam_from_world=pose)))

    return correct


def _translation_from_centre(pose: np.ndarray) -> np.ndarray:
    pose = pose.copy()
    pose[:, :3, 3] = -np.einsum("vij,vj->vi", pose[:, :3, :3], pose[:, :3, 3])
    return pose


def _transposed_rotation(pose: np.ndarray) -> np.ndarray:
    pose = pose.copy()
    pose[:, :3, :3] = pose[:, :3, :3].swapaxes(-1, -2)
    return pose


def _intrinsics(x: tuple[int, int], y: tuple[int, int]) -> Correct:
    """Swap two entries of K, given as row and column."""

    def correct(hypothesis: Hypothesis, views: list[int]) -> Hypothesis:
        K = hypothesis.rig.K.copy()
        K[views, *x], K[views, *y] = K[views, *y], K[views, *x]
        return replace(hypothesis, rig=replace(hypothesis.rig, K=K))

    return correct


def _pixels(change: Callable[[np.ndarray, np.ndarray, float, float], tuple]) -> Correct:
    """Change x and y of detections, given the last column and row of the image according to the calibration."""

    def correct(hypothesis: Hypothesis, views: list[int]) -> Hypothesis:
        xy = hypothesis.xy.copy()
        for view in views:
            right, bottom = hypothesis.rig.size[view] - 1
            xy[:, view] = np.stack(change(xy[:, view, ..., 0], xy[:, view, ..., 1], right, bottom), -1)
        return replace(hypothesis, xy=xy)

    return correct


def _without_distortion(hypothesis: Hypothesis, views: list[int]) -> Hypothesis:
    corrected = change_distortion(hypothesis, views, np.zeros_like)
    fisheye = corrected.rig.fisheye & ~np.isin(np.arange(len(corrected.rig)), views)
    return replace(corrected, rig=replace(corrected.rig, fisheye=fisheye))


def _unmirrored_image(hypothesis: Hypothesis, views: list[int]) -> Hypothesis:
    """Undo mirroring of the images in which people were detected: left and right joints are exchanged too."""
    corrected = _CORRECTIONS[Fault.mirrored](hypothesis, views)
    xy = corrected.xy.copy()
    score, mirror = corrected.score.copy(), list(hypothesis.skeleton.mirror)
    xy[:, views], score[:, views] = xy[:, views][..., mirror, :], score[:, views][..., mirror]
    return replace(corrected, xy=xy, score=score)


_CORRECTIONS: dict[Fault, Correct] = {
    Fault.inverse: _extrinsics(np.linalg.inv),
    Fault.centre: _extrinsics(_translation_from_centre),
    Fault.transposed_rotation: _extrinsics(_transposed_rotation),
    Fault.focal: _intrinsics((0, 0), (1, 1)),
    Fault.principal: _intrinsics((0, 2), (1, 2)),
    Fault.mirrored: _pixels(lambda x, y, right, bottom: (right - x, y)),
    Fault.flipped: _pixels(lambda x, y, right, bottom: (x, bottom - y)),
    Fault.upside_down: _pixels(lambda x, y, right, bottom: (right - x, bottom - y)),
    Fault.turned_left: _pixels(lambda x, y, right, bottom: (right - y, x)),
    Fault.turned_right: _pixels(lambda x, y, right, bottom: (y, bottom - x)),
    Fault.swapped_axes: _pixels(lambda x, y, right, bottom: (y, x)),
    Fault.undistorted: _without_distortion,
    Fault.distortion_sign: partial(change_distortion, change=np.negative),
}
