"""Captured people projected into images: people that views missed, and detections that are parts of people."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import BODY25
from dmae.detection.pipeline import missed_people, parts_of_people
from tests.support.detected_people import detected_clip, standing, with_body

FRAMES = 5
NECK, HIP = (int(BODY25.index(name)[0]) for name in ("neck", "mid_hip"))


@pytest.fixture
def clip() -> Clip:
    """Two people in four views. In each view the first detection is of the first person."""
    clip = detected_clip(standing(FRAMES, persons=2), miss=0, noise=1)
    projected, _ = clip.rig.project(clip.truth.xyz)
    return replace(clip, detections=Detections2D(BODY25, projected, np.full(projected.shape[:-1], 0.9)))


def shrunk(clip: Clip, view: int, size: float, shift: float = 0.0) -> np.ndarray:
    """Return the first person of a view, smaller, around its neck, shifted by a share of its torso to the side."""
    body = clip.detections.xy[:, view, 0]
    torso = np.linalg.norm(body[:, NECK] - body[:, HIP], axis=-1)[:, None, None]
    return body[:, [NECK]] + size * (body - body[:, [HIP]]) + shift * torso * [1, 0]


def without(clip: Clip, view: int, person: int) -> Detections2D:
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    xy[:, view, person] = score[:, view, person] = np.nan
    return Detections2D(BODY25, xy, score)


def test_people_are_missed_where_only_other_views_see_them(clip):
    missed = missed_people(clip.truth, clip.rig, without(clip, 2, 1))
    assert set(missed) == {(frame, 2) for frame in range(FRAMES)}
    for (frame, view), expected in missed.items():
        np.testing.assert_allclose(expected, clip.detections.xy[frame, view, 1:], atol=1e-3)


def test_all_people_are_seen(clip):
    assert missed_people(clip.truth, clip.rig, clip.detections) == {}


def test_of_two_people_in_one_place_one_detection_is_one(clip):
    """Two people stand two centimetres apart. One of them is detected."""
    poses = replace(clip.truth, xyz=clip.truth.xyz[:, [0, 0]] + np.float32([[0], [0.02]])[..., None])
    missed = missed_people(poses, clip.rig, without(clip, 1, 1))
    assert [len(missed[frame, 1]) for frame in range(FRAMES)] == [1] * FRAMES


def test_a_small_body_on_a_person_is_a_part(clip):
    parts = parts_of_people(clip.truth, clip.rig, with_body(clip.detections, 1, shrunk(clip, 1, 0.2)))
    assert parts[:, 1, 2].all() and parts.sum() == FRAMES


@pytest.mark.parametrize(("size", "shift"), [(0.7, 0.0), (0.2, 2.0)], ids=["large", "beside"])
def test_bodies_that_are_large_or_beside_the_person_stay(clip, size, shift):
    assert not parts_of_people(clip.truth, clip.rig, with_body(clip.detections, 1, shrunk(clip, 1, size, shift))).any()


def test_a_small_person_that_is_captured_stays(clip):
    """A child in front of an adult: other views see it too."""
    xyz = clip.truth.xyz.copy()
    xyz[:, 1] = xyz[:, 0, [NECK]] + 0.2 * (xyz[:, 0] - xyz[:, 0, [HIP]])
    poses = replace(clip.truth, xyz=xyz)
    projected, _ = clip.rig.project(xyz)
    detections = Detections2D(BODY25, projected, np.full(projected.shape[:-1], 0.9))
    assert not parts_of_people(poses, clip.rig, detections).any()
