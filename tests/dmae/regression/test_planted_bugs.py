"""Bugs that triangulations have, planted in two that have none: each is caught, by the cases made for it."""

from functools import partial

import numpy as np
import pytest

from dmae.regression import solvers
from tests.support.plain_solver import EVERY, OUTLIERS, broken, plain

JOINTS = 15
"""Of every frame of the case `moving`."""


# What a solver may be given or give wrongly, whatever it does in between.


def transposed_rotation(solver, *, cam_from_world, **given):
    turned = cam_from_world.copy()
    turned[:, :3, :3] = cam_from_world[:, :3, :3].swapaxes(1, 2)
    return solver(cam_from_world=turned, **given)


def ignored_distortion(solver, *, dist, **given):
    return solver(dist=np.zeros_like(dist), **given)


def half_pixel_shift(solver, *, xy, **given):
    return solver(xy=xy + 0.5, **given)


def swapped_views(solver, *, xy, **given):
    return solver(xy=xy[:, [1, 0, *range(2, xy.shape[1])]], **given)


def shifted_frames(solver, **given):
    return np.roll(solver(**given), JOINTS, axis=0)


def one_camera_a_frame_late(solver, *, xy, **given):
    xy = xy.copy()
    xy[JOINTS:, 0] = xy[:-JOINTS, 0]
    return solver(xy=xy, **given)


def dropped_joint(solver, **given):
    xyz = solver(**given)
    xyz[4::JOINTS] = np.nan
    return xyz


def dropped_joint_others_move_up(solver, **given):
    xyz = solver(**given)
    left = np.delete(xyz, np.arange(4, len(xyz), JOINTS), axis=0)
    return np.concatenate([left, np.full((len(xyz) - len(left), 3), np.nan)])


def dropped_below_a_half(solver, *, xy, confidence, **given):
    sure = confidence >= 0.5
    return solver(xy=np.where(sure[..., None], xy, np.nan), confidence=np.where(sure, confidence, np.nan), **given)


def nan_confidence_taken_for_sure(solver, *, confidence, **given):
    return solver(confidence=np.where(np.isnan(confidence), 1, confidence), **given)


def ignored_skew(solver, *, K, **given):
    straight = K.copy()
    straight[:, 0, 1] = 0
    return solver(K=straight, **given)


def clipped_to_the_image(solver, *, xy, size, **given):
    return solver(xy=np.clip(xy, 0, size - 1), size=size, **given)


@pytest.mark.parametrize("solver", [plain, solvers.ours], ids=["plain", "ours"])
@pytest.mark.parametrize(
    ("bug", "at_least", "at_most"),
    [
        (transposed_rotation, {"clean", "moving", "views-2", "crowd-5"}, EVERY),
        (ignored_distortion, {"distorted-5", "distorted-8"}, {"distorted-5", "distorted-8"}),
        (half_pixel_shift, {"clean", "off-centre", "far-world", "moving", "absent", "views-12"}, EVERY),
        (swapped_views, {"clean", "moving", "views-2"}, EVERY),
        (shifted_frames, {"moving"}, EVERY),
        (one_camera_a_frame_late, {"moving"}, EVERY),
        (dropped_joint, {"moving"}, EVERY),
        (dropped_joint_others_move_up, {"moving"}, EVERY),
        (dropped_below_a_half, {"unsure", "unrated"}, {"unsure", "unrated", "crowd-5", "crowd-3"}),
        (nan_confidence_taken_for_sure, {"unrated"}, {"unrated"}),
        (ignored_skew, {"skewed"}, {"skewed"}),
        (clipped_to_the_image, {"outside"}, {"outside", "crowd-5", "crowd-3"}),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_what_goes_in_or_out_wrongly_is_caught(solver, bug, at_least, at_most):
    assert at_least <= broken(partial(bug, solver)) <= at_most


FROM_WITHIN = [
    ("unweighted outliers", OUTLIERS | {"doubted", "crowd-5"}, OUTLIERS | {"doubted", "crowd-5", "crowd-3"}),
    ("behind-camera points", {"behind"}, {"behind"}),
    ("float32 normal equations", {"far-world"}, EVERY),
    ("wrong homogeneous divide", {"clean", "moving"}, EVERY),
]


@pytest.mark.parametrize(("bug", "at_least", "at_most"), FROM_WITHIN, ids=[bug for bug, *_ in FROM_WITHIN])
def test_what_a_solver_does_wrongly_is_caught(bug, at_least, at_most):
    assert at_least <= broken(partial(plain, bug=bug)) <= at_most
