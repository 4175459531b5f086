"""Tracks of no person."""

import numpy as np

from dmae.reconstruction.association import NONE
from dmae.reconstruction.people import coincidental, too_brief, well_measured
from dmae.reconstruction.tracking import Tracks
from tests.support.detected_people import FPS, standing


def tracks_of(xyz: np.ndarray, assigned: np.ndarray | None = None) -> Tracks:
    """Tracks of which the views agree in all frames."""
    assigned = np.zeros((*xyz.shape[:2], 2, 25), int) if assigned is None else assigned
    return Tracks(assigned, xyz, np.ones(xyz.shape[:2], bool))


def test_frames_in_which_views_agree_by_coincidence_do_not_count():
    tracks = tracks_of(standing(persons=2))
    tracks.supported[5:, 1] = False
    assert well_measured(tracks, 4).sum(0).tolist() == [40, 5]


def test_tracks_measured_for_a_moment_are_too_brief():
    xyz = standing(persons=3)
    xyz[5:, 1] = np.nan
    xyz[:, 2, 3:] = np.nan
    assert too_brief(well_measured(tracks_of(xyz), 4).sum(0), len(xyz), FPS, 0.3).tolist() == [False, True, True]


def test_half_of_a_short_clip_is_long_enough():
    assert not too_brief(well_measured(tracks_of(standing(frames=3)), 4).sum(0), 3, FPS, 0.3).any()


def test_views_of_a_coincidence_agree_on_few_joints():
    xyz = standing(persons=3)
    xyz[:, 1, ::2] = np.nan
    xyz[:, 2, :5] = np.nan
    assigned = np.zeros((*xyz.shape[:2], 3, 25), int)
    assigned[:, :, 2] = NONE
    assert coincidental(tracks_of(xyz, assigned), views=2).tolist() == [False, True, False]
    # A joint that a single view detects is not expected to be found.
    assigned[:, 1, 1, ::2] = NONE
    assert not coincidental(tracks_of(xyz, assigned), views=2).any()
