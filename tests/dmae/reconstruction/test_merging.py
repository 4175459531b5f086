"""Tracks that are of one person, and their merging."""

import numpy as np

from dmae.data.skeleton import BODY25
from dmae.reconstruction.association import NONE
from dmae.reconstruction.people import merge, same_person
from dmae.reconstruction.tracking import Tracks
from tests.support.detected_people import FPS, standing


def test_duplicates_and_re_entries_are_one_person():
    """Track 1 duplicates 0; 3 is a re-entry of 2; 4 re-enters too late; 5 is a child who enters where 2 left."""
    xyz = standing(frames=200, persons=6)
    xyz[:, 1] = xyz[:, 0] + 0.03
    xyz[:, 3] = xyz[:, 4] = xyz[:, 2]
    xyz[:, 5] = standing(frames=200, scale=0.7)[:, 0] + (0, 2, 0)
    for track, (start, end) in enumerate([(0, 200), (50, 90), (0, 40), (60, 80), (180, 200), (82, 120)]):
        xyz[:start, track], xyz[end:, track] = np.nan, np.nan
    assert same_person(xyz, BODY25, FPS, reentry_s=2.0).tolist() == [0, 0, 2, 2, 4, 5]


def test_a_person_too_far_from_the_exit_is_another():
    xyz = standing(frames=60, persons=2)
    xyz[20:, 0], xyz[:25, 1] = np.nan, np.nan
    assert same_person(xyz, BODY25, FPS, 2.0).tolist() == [0, 1]
    xyz[:, 1, :, 1] -= 1
    assert same_person(xyz, BODY25, FPS, 2.0).tolist() == [0, 0]


def test_a_track_is_re_entered_once():
    xyz = standing(frames=60, persons=3)
    xyz[:, 1:, :, 1] -= ((0.9,), (2.1,))
    xyz[20:, 0], xyz[:25, 1:] = np.nan, np.nan
    assert same_person(xyz, BODY25, FPS, 2.0).tolist() == [0, 0, 2]


def test_merging_keeps_the_older_track_and_fills_gaps_from_the_younger():
    xyz = standing(frames=4, persons=3)
    assigned = np.broadcast_to(np.arange(3)[:, None, None], (4, 3, 2, 25)).copy()
    assigned[2:, 0], xyz[2:, 0] = NONE, np.nan
    merged = merge(Tracks(assigned, xyz, ~np.isnan(xyz[..., 0, 0])), np.array([0, 0, 2]))
    assert merged.assigned[:, :, 0, 0].tolist() == [[0, 2], [0, 2], [1, 2], [1, 2]]
    np.testing.assert_array_equal(merged.xyz[1:3, 0], xyz[[1, 2], [0, 1]])
    np.testing.assert_array_equal(merged.xyz[:, 1], xyz[:, 2])
    assert merged.supported.all()
