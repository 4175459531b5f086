"""tests.dmae.numerics.test_body."""

import numpy as np

from dmae.data.skeleton import SHELF14, Skeleton
from dmae.numerics.body import bone_lengths, median_bone_lengths, parent_bone_lengths, symmetric_bone_lengths
from dmae.numerics.statistics import median_over_frames

ARM = ((0, 1), (1, 2))


def growing_arm() -> np.ndarray:
    """(5, 1, 3, 3): a bone of 0.3 m, and one of 0.1, 0.2, ... m of which the last frame is unknown."""
    xyz = np.zeros((5, 1, 3, 3))
    xyz[:, 0, 1, 0] = 0.3
    xyz[:, 0, 2] = xyz[:, 0, 1]
    xyz[:, 0, 2, 1] = 0.1 * np.arange(1, 6)
    xyz[4, 0, 2] = np.nan
    return xyz


def test_lengths_are_distances_and_unknown_ends_are_nan():
    found = bone_lengths(growing_arm(), ARM)[:, 0]
    np.testing.assert_allclose(found, [[0.3, 0.1], [0.3, 0.2], [0.3, 0.3], [0.3, 0.4], [0.3, np.nan]])
    by_joint = parent_bone_lengths(growing_arm(), ARM)[:, 0]
    assert np.isnan(by_joint[:, 0]).all()
    np.testing.assert_array_equal(by_joint[:, 1:], found)


def test_medians_ignore_unknown_values():
    np.testing.assert_allclose(median_bone_lengths(growing_arm(), ARM), [[0.3, 0.25]])
    assert np.isnan(median_bone_lengths(np.full((4, 2, 3, 3), np.nan), ARM)).all()
    assert median_over_frames(np.empty((0, 2))).shape == (2,)


def test_left_and_right_are_pooled():
    left, right = SHELF14.index("l_wrist", "r_wrist")
    xyz = np.zeros((3, 1, 14, 3))
    xyz[:, 0, left, 0], xyz[:, 0, right, 0] = 0.2, 0.4
    found = symmetric_bone_lengths(xyz, SHELF14)[0]
    forearms = [i for i, (_, joint) in enumerate(SHELF14.bones) if joint in (left, right)]
    np.testing.assert_allclose(found[forearms], 0.3)
    xyz[:, 0, left] = np.nan
    np.testing.assert_allclose(symmetric_bone_lengths(xyz, SHELF14)[0, forearms], 0.4)


def test_a_skeleton_without_bones_has_no_lengths():
    assert bone_lengths(np.zeros((4, 1, 1, 3)), ()).shape == (4, 1, 0)
    assert symmetric_bone_lengths(np.zeros((4, 1, 1, 3)), Skeleton("point", ("a",), (-1,))).shape == (1, 0)
