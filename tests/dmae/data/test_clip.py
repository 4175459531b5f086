from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D, Poses3D, Source
from dmae.data.labels import DetectionLabels, OcclusionLabels
from dmae.data.skeleton import BODY25, SHELF14
from tests.support.clips import full_clip, walkers


def test_joints_of_nan_are_absent():
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


def test_wrong_shapes_are_refused_with_the_expected_ones():
    with pytest.raises(ValueError, match=r"Poses3D.xyz: expected shape \(F, P, 14, 3\), found \(12, 2, 25, 3\)"):
        Poses3D(SHELF14, walkers().xyz)
    with pytest.raises(ValueError, match=r"Detections2D.score: expected shape \(2, 3, 1, 25\)"):
        Detections2D(BODY25, np.zeros((2, 3, 1, 25, 2)), np.zeros((2, 3, 25)))


def test_detections_without_scores_are_sure():
    xy = np.zeros((2, 3, 1, 25, 2))
    xy[0, 0, 0, 0] = np.nan
    score = Detections2D(BODY25, xy).score
    assert np.isnan(score[0, 0, 0, 0]) and np.nansum(score) == 2 * 3 * 25 - 1
    with pytest.raises(ValueError, match=r"Detections2D.xy: expected shape \(F, V, D, 25, 2\), found \(2, 3, 25, 2\)"):
        Detections2D(BODY25, xy[:, :, 0])


def test_zero_persons_are_allowed():
    assert Poses3D(BODY25, np.empty((5, 0, 25, 3))).source.shape == (5, 0, 25)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"fps": 0.0}, "expected frames per second from"),
        ({"truth": walkers(frames=11)}, "12 frames of detections but 11 of truth"),
        ({"poses": walkers(frames=13)}, "13 of poses"),
        ({"truth": None}, "there is no truth"),
        (
            {"occlusion": OcclusionLabels(np.zeros((12, 4, 3, 25)))},
            r"occlusion.visibility: expected shape \(12, 4, 2, 25\), found \(12, 4, 3, 25\)",
        ),
        (
            {"detection_labels": DetectionLabels(np.zeros((12, 4, 1)))},
            r"detection_labels.person: expected shape \(12, 4, 2\), found \(12, 4, 1\)",
        ),
        (
            {"detection_labels": DetectionLabels(np.zeros((12, 4, 2)), offset_px=np.zeros((12, 4, 2, 24)))},
            r"detection_labels.offset_px: expected shape \(12, 4, 2, 25\), found \(12, 4, 2, 24\)",
        ),
    ],
)
def test_fields_of_a_clip_that_do_not_match_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        replace(full_clip(), **changes)


def test_a_clip_needs_a_camera_for_every_view():
    clip = full_clip()
    with pytest.raises(ValueError, match="3 cameras but detections in 4 views"):
        Clip("odd", 25.0, clip.rig[:3], clip.detections)


def test_select_slices_every_field_together():
    clip = replace(full_clip(), poses=walkers())
    frames, views = [7, 2, 3], [3, 1]
    part = clip.select(frames, views)
    assert len(part) == 3
    assert part.rig.names == ("cam3", "cam1")
    for labels in ("occlusion", "detection_labels"):
        for name, array in vars(getattr(clip, labels)).items():
            if name != "objects":
                np.testing.assert_array_equal(getattr(getattr(part, labels), name), array[frames][:, views])
    np.testing.assert_array_equal(part.detections.xy, clip.detections.xy[frames][:, views])
    np.testing.assert_array_equal(part.detections.score, clip.detections.score[frames][:, views])
    np.testing.assert_array_equal(part.truth.xyz, clip.truth.xyz[frames])
    assert part.id == clip.id
    assert part.occlusion.objects == clip.occlusion.objects


def test_select_keeps_poses_only_with_all_views():
    clip = replace(full_clip(), poses=walkers())
    np.testing.assert_array_equal(clip.select(slice(2, 5)).poses.xyz, clip.poses.xyz[2:5])
    assert clip.select(views=[0, 1]).poses is None
    assert clip.select(views=[3, 2, 1, 0]).poses is not None


def test_select_of_all_is_the_clip():
    clip = full_clip()
    np.testing.assert_array_equal(clip.select().detections.xy, clip.detections.xy)


def test_offsets_stay_those_of_their_cameras():
    clip = replace(full_clip(), provenance={"offsets": [0, 2, -3, 40]})
    assert clip.select(views=["cam3", "cam1"]).provenance == {"offsets": [40, 2]}
    assert clip.select(slice(5), slice(2)).provenance == {"offsets": [0, 2]}


def test_a_part_of_a_clip_has_no_figures_of_the_whole():
    line = {"id": "a", "seed": 3, "frames": 12, "quality": {}, "occlusion": {}, "calibration_error": [1.0, 2.0]}
    clip = replace(full_clip(), provenance={"manifest": line, "spec": {}})
    assert clip.select(slice(12), [0, 1, 2, 3]).provenance == clip.provenance
    for frames, part in (
        (5, clip.select(slice(5))),
        (12, clip.select(views=[1])),
        (12, clip.select(views=[1, 0, 2, 3])),
    ):
        assert part.provenance == {"manifest": {"id": "a", "seed": 3, "frames": frames}, "spec": {}}


def test_a_tuple_of_indices_is_a_list_of_them():
    clip = full_clip()
    found, expected = clip.select(frames=(0, 2), views=(1, 0)), clip.select(frames=[0, 2], views=[1, 0])
    assert found.rig.names == expected.rig.names
    for name in ("xyz", "source"):
        np.testing.assert_array_equal(getattr(found.truth, name), getattr(expected.truth, name))
    np.testing.assert_array_equal(found.detections.xy, expected.detections.xy)
    np.testing.assert_array_equal(clip.truth.select((0, 2)).xyz, expected.truth.xyz)


def test_poses_of_some_frames_and_persons_are_selected_in_every_array():
    poses = walkers()
    for name, array in poses.arrays.items():
        np.testing.assert_array_equal(poses.select(persons=[1]).arrays[name], array[:, [1]])
        np.testing.assert_array_equal(poses.select((0, 2), (1, 0)).arrays[name], array[[0, 2]][:, [1, 0]])
        np.testing.assert_array_equal(poses.select(slice(2), np.array([True, False])).arrays[name], array[:2, :1])


def test_views_are_chosen_by_the_names_of_cameras():
    clip = full_clip()
    names = [clip.rig.names[1], clip.rig.names[0]]
    np.testing.assert_array_equal(clip.select(views=names).detections.xy, clip.select(views=[1, 0]).detections.xy)
    assert clip.select(views=names).rig.names == clip.rig[names].names == tuple(names)
    with pytest.raises(IndexError, match=r"cameras \['left'\]: expected .* names or indices; there are 0 "):
        clip.select(views=["left"])


def test_a_clip_is_printed_in_a_few_lines():
    clip = full_clip()
    printed = repr(clip)
    assert len(printed) < 3000
    assert f"names={clip.rig.names}" in printed
    assert f"xyz=float32[{', '.join(map(str, clip.truth.xyz.shape))}]" in printed
    assert "skeleton=body25" in printed
    assert "None" not in printed
