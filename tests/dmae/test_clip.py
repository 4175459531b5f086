from dataclasses import replace

import numpy as np
import pytest

from dmae.clip import OF_DETECTIONS, OF_TRUE_PERSONS, Clip, Detections2D, Poses3D, Source, Visibility
from dmae.skeleton import BODY25, SHELF14

from .examples import full_clip, walkers


def test_poses_know_what_is_absent():
    xyz = walkers().xyz.copy()
    xyz[3, 1, 5] = np.nan
    poses = Poses3D(BODY25, xyz)
    assert poses.xyz.dtype == np.float32
    assert (poses.source == Source.ABSENT).sum() == 1
    assert poses.source[3, 1, 5] == Source.ABSENT
    assert (~poses.measured).sum() == 1
    assert np.isnan(poses.cov).all()
    assert poses.cov.shape == (12, 2, 25, 3, 3)
    assert (poses.views == 0).all()


def test_a_completed_joint_is_not_measured():
    source = np.full((12, 2, 25), Source.MEASURED)
    source[0, 0, 0], source[0, 0, 1] = Source.COMPLETED, Source.DENOISED
    assert Poses3D(BODY25, walkers().xyz, source).measured.sum() == 12 * 2 * 25 - 1


def test_source_and_coordinates_must_agree():
    xyz = walkers().xyz.copy()
    xyz[0, 0, 0, 2] = np.nan
    with pytest.raises(ValueError, match="ABSENT exactly where"):
        Poses3D(BODY25, xyz, np.full((12, 2, 25), Source.MEASURED))
    with pytest.raises(ValueError, match="ABSENT exactly where"):
        Poses3D(BODY25, walkers().xyz, np.zeros((12, 2, 25)))


def test_score_and_pixels_must_agree():
    xy, score = np.zeros((2, 3, 1, 25, 2)), np.zeros((2, 3, 1, 25))
    score[0, 0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="NaN exactly where"):
        Detections2D(BODY25, xy, score)
    xy[0, 0, 0, 0, 1] = np.nan
    assert Detections2D(BODY25, xy, score).observed.sum() == 2 * 3 * 25 - 1


def test_wrong_shapes_are_refused_with_the_right_ones():
    with pytest.raises(
        ValueError, match=r"Poses3D.xyz: expected shape \('any', 'any', 14, 3\), found \(12, 2, 25, 3\)"
    ):
        Poses3D(SHELF14, walkers().xyz)
    with pytest.raises(ValueError, match=r"Detections2D.score: expected shape \(2, 3, 1, 25\)"):
        Detections2D(BODY25, np.zeros((2, 3, 1, 25, 2)), np.zeros((2, 3, 25)))


def test_nobody_is_a_number_of_persons():
    assert Poses3D(BODY25, np.empty((5, 0, 25, 3))).source.shape == (5, 0, 25)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fps": 0.0}, "fps must be positive"),
        ({"truth": walkers(frames=11)}, "12 frames of detections but 11 of truth"),
        ({"poses": walkers(frames=13)}, "13 of poses"),
        ({"truth": None}, "there is no truth"),
        ({"visibility": np.zeros((12, 4, 3, 25))}, r"Clip.visibility: expected shape \(12, 4, 2, 25\)"),
        ({"depth_margin": np.zeros((12, 4, 2))}, r"Clip.depth_margin: expected shape \(12, 4, 2, 25\)"),
        ({"amodal_pixels": np.zeros((12, 4, 3))}, r"Clip.amodal_pixels: expected shape \(12, 4, 2\)"),
        ({"detected_person": np.zeros((12, 4))}, r"Clip.detected_person: expected shape \(12, 4, 2\)"),
        ({"detected_off": np.zeros((12, 4, 2))}, r"Clip.detected_off: expected shape \(12, 4, 2, 25\)"),
    ],
)
def test_a_clip_s_fields_must_fit_together(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(full_clip(), **changes)


def test_a_clip_needs_a_camera_for_every_view():
    clip = full_clip()
    with pytest.raises(ValueError, match="3 cameras but detections in 4 views"):
        Clip("odd", 25.0, clip.rig[:3], clip.detections)


def test_how_many_cameras_see_a_joint_and_how_much_shows_of_a_person():
    clip = full_clip()
    assert clip.seen_by.shape == (12, 2, 25)
    assert clip.seen_by[3, 1, 5] == sum(clip.visibility[3, view, 1, 5] == Visibility.VISIBLE for view in range(4))
    assert (clip.visible_share == 0.75).all()
    unseen = replace(clip, visible_pixels=np.zeros((12, 4, 2)), amodal_pixels=np.zeros((12, 4, 2)))
    assert np.isnan(unseen.visible_share).all()
    bare = replace(clip, visibility=None, amodal_pixels=None)
    assert bare.seen_by is None
    assert bare.visible_share is None


def test_select_cuts_every_field_alike():
    clip = replace(full_clip(), poses=walkers())
    frames, views = [7, 2, 3], [3, 1]
    part = clip.select(frames, views)
    assert len(part) == 3
    assert part.rig.names == ("cam3", "cam1")
    for name in (*OF_TRUE_PERSONS, *OF_DETECTIONS):
        np.testing.assert_array_equal(getattr(part, name), getattr(clip, name)[frames][:, views])
    np.testing.assert_array_equal(part.detections.xy, clip.detections.xy[frames][:, views])
    np.testing.assert_array_equal(part.detections.score, clip.detections.score[frames][:, views])
    np.testing.assert_array_equal(part.truth.xyz, clip.truth.xyz[frames])
    assert part.id == clip.id
    assert part.objects == clip.objects


def test_select_keeps_poses_only_with_all_views():
    clip = replace(full_clip(), poses=walkers())
    np.testing.assert_array_equal(clip.select(slice(2, 5)).poses.xyz, clip.poses.xyz[2:5])
    assert clip.select(views=[0, 1]).poses is None
    assert clip.select(views=[3, 2, 1, 0]).poses is not None


def test_select_of_all_is_the_clip():
    clip = full_clip()
    np.testing.assert_array_equal(clip.select().detections.xy, clip.detections.xy)
