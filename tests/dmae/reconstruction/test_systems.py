"""Published systems: each finds people who are exactly detected, and fails as its file says."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D, Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14, Skeleton
from dmae.evaluation.scores import score, scored_actors
from dmae.formats.reading import Clips, DataConfig
from dmae.metrics.comparison import match, take_matched
from dmae.online.capture import OnlineCapture
from dmae.reconstruction.config import CaptureConfig, capture_method
from dmae.reconstruction.pipeline import capture
from dmae.reconstruction.systems.common import Frame, as_tracks
from dmae.reconstruction.systems.voxelpose import heat
from tests.support.clips import full_clip, looking_at_origin, walkers

WRIST, ELBOW = BODY25.index("l_wrist", "l_elbow")
EXACT_M = {"4d_association": 1e-4, "mvpose": 1e-4, "pictorial_structures": 1e-4, "plane_sweep": 0.05, "voxelpose": 0.03}
"""Median error of joints that are detected exactly."""


def seen(truth: Poses3D, views: int = 4) -> Clip:
    """People detected exactly by cameras on a circle."""
    rig = looking_at_origin(views)
    xy, _ = rig.project(truth.xyz)
    return Clip("seen", 25.0, rig, Detections2D(truth.skeleton, xy, np.where(np.isnan(xy[..., 0]), np.nan, 0.9)), truth)


def moved(clip: Clip, joint: int, pixels: float, views=slice(None)) -> Clip:
    """A joint of the first person, detected to the right of where it is."""
    xy = clip.detections.xy.copy()
    xy[:, views, 0, joint, 0] += pixels
    return replace(clip, detections=replace(clip.detections, xy=xy))


def captured(clip: Clip, method: str) -> Poses3D:
    return capture(clip, CaptureConfig(method=method))


@pytest.mark.parametrize("method", sorted(capture_method))
class TestEverySystem:
    def test_finds_two_people_in_shuffled_detections(self, method):
        clip = full_clip(frames=6)
        poses = captured(clip, method)
        found = take_matched(poses.xyz, match(poses.xyz, clip.truth.xyz))
        error = np.linalg.norm(found - clip.truth.xyz, axis=-1)
        assert poses.skeleton == BODY25
        assert poses.xyz.shape[1] == 2
        assert np.isfinite(error).mean() > 0.85
        assert np.nanmedian(error) < EXACT_M[method]

    def test_what_is_absent_is_nan_and_used_no_view(self, method):
        poses = captured(full_clip(frames=2), method)
        absent = np.isnan(poses.xyz).any(-1)
        assert (poses.source[absent] == Source.ABSENT).all()
        assert (poses.views[absent] == 0).all()
        assert (poses.views[~absent] > 0).all()

    def test_empty_rooms_and_clips_without_frames(self, method):
        clip = full_clip(frames=2)
        nothing = Detections2D(
            BODY25, np.full_like(clip.detections.xy, np.nan), np.full_like(clip.detections.score, np.nan)
        )
        assert captured(replace(clip, detections=nothing), method).xyz.shape == (2, 0, 25, 3)
        assert captured(clip.select(frames=slice(0, 0)), method).xyz.shape == (0, 0, 25, 3)

    def test_cameras_that_see_nothing_change_nothing(self, method):
        clip = seen(walkers(2), views=5)
        xy, confidence = clip.detections.xy.copy(), clip.detections.score.copy()
        xy[:, 4], confidence[:, 4] = np.nan, np.nan
        blind = captured(replace(clip, detections=Detections2D(BODY25, xy, confidence)), method)
        without = captured(clip.select(views=[0, 1, 2, 3]), method)
        np.testing.assert_allclose(blind.xyz, without.xyz, atol=1e-4)

    def test_other_options_of_capture_are_refused(self, method):
        with pytest.raises(
            ValueError, match=f"method={method} takes th_p and no other option; leave out th_v, persons"
        ):
            CaptureConfig(method=method, th_v=3, persons=2)

    def test_one_camera(self, method):
        with pytest.raises(ValueError, match="capture needs at least 2 cameras, found 1"):
            captured(full_clip(frames=2).select(views=[0]), method)

    def test_not_as_frames_come(self, method):
        with pytest.raises(ValueError, match=f"capture.method={method} captures whole recordings"):
            OnlineCapture(looking_at_origin(), BODY25, 25.0, CaptureConfig(method=method))


def test_ghosts_of_a_long_recording_share_columns():
    """One person stays, and a ghost comes elsewhere in every frame."""
    clip = seen(walkers(200, persons=1))
    ghosts = np.arange(200)[:, None, None] * np.ones((25, 3)) * 10 + 100
    found = [np.stack([person[0], ghost]) for person, ghost in zip(clip.truth.xyz, ghosts, strict=True)]
    poses = as_tracks(clip, found, [np.full((2, 25), 2)] * 200)
    assert poses.xyz.shape[1] == 100
    np.testing.assert_array_equal(poses.xyz[:, 0], clip.truth.xyz[:, 0])
    assert np.isfinite(poses.xyz[..., 0, 0]).sum(1).tolist() == [2] * 200
    few = as_tracks(
        clip, found[:50] + [each[:1] for each in found[50:]], [np.full((2, 25), 2)] * 50 + [np.full((1, 25), 2)] * 150
    )
    assert few.xyz.shape[1] == 51


class TestHowTheyFail:
    def test_mvpose_keeps_a_joint_on_which_its_two_cameras_disagree(self):
        clip = moved(seen(walkers(2, persons=1), views=4).select(views=[0, 1]), WRIST, 60, views=[0])
        error = np.linalg.norm(captured(clip, "mvpose").xyz - clip.truth.xyz, axis=-1)[..., WRIST]
        assert (error > 0.1).all()

    def test_4d_association_leaves_out_the_camera_that_contradicts(self):
        clip = moved(seen(walkers(2, persons=1)), WRIST, 120, views=[0])
        poses = captured(clip, "4d_association")
        assert np.linalg.norm(poses.xyz - clip.truth.xyz, axis=-1).max() < 1e-4
        assert (poses.views[..., WRIST] == 3).all()
        assert (poses.views[..., ELBOW] == 4).all()

    def test_4d_association_gives_a_new_number_to_a_person_who_jumps(self):
        truth = walkers(4, persons=1)
        truth = replace(truth, xyz=truth.xyz + np.array([0, 0, 0, 1.0])[:, None, None, None] * (1, 1, 0))
        persons = ~np.isnan(captured(seen(truth), "4d_association").xyz).all((2, 3))
        assert persons.tolist() == [[True, False]] * 3 + [[False, True]]

    def test_pictorial_structures_leave_out_a_joint_where_no_bone_reaches(self):
        clip = seen(walkers(40, persons=1))
        xyz = clip.truth.xyz.copy()
        xyz[:5, :, WRIST] += (0, 0, 0.8)
        poses = captured(replace(seen(replace(clip.truth, xyz=xyz)), truth=clip.truth), "pictorial_structures")
        absent = poses.source == Source.ABSENT
        assert absent[:5, 0, WRIST].all()
        assert not absent[5:, 0].any()

    def test_plane_sweep_makes_a_person_of_a_pose_that_no_other_camera_sees(self):
        clip = seen(walkers(2, persons=2))
        xy, confidence = clip.detections.xy.copy(), clip.detections.score.copy()
        xy[:, 1:, 1], confidence[:, 1:, 1] = np.nan, np.nan
        alone = replace(clip, detections=Detections2D(BODY25, xy, confidence))
        assert captured(alone, "plane_sweep").xyz.shape[1] > 1
        assert captured(alone, "mvpose").xyz.shape[1] == 1

    def test_voxelpose_places_a_wrist_that_no_camera_sees(self):
        clip = seen(walkers(2, persons=1))
        xy, confidence = clip.detections.xy.copy(), clip.detections.score.copy()
        xy[..., WRIST, :], confidence[..., WRIST] = np.nan, np.nan
        hidden = replace(clip, detections=Detections2D(BODY25, xy, confidence))
        assert np.isfinite(captured(hidden, "voxelpose").xyz[..., WRIST, :]).all()
        assert np.isnan(captured(hidden, "plane_sweep").xyz[..., WRIST, :]).all()

    @pytest.mark.parametrize("method", ["plane_sweep", "voxelpose"])
    def test_networks_take_the_joints_that_they_have_learned(self, method):
        poses = captured(seen(walkers(2, persons=1, skeleton=SHELF14)), method)
        assert np.isfinite(poses.xyz[..., 0]).all((0, 1)).tolist() == [
            joint in BODY25.joints for joint in SHELF14.joints
        ]

    @pytest.mark.parametrize("method", ["plane_sweep", "voxelpose"])
    def test_networks_leave_out_a_pose_without_a_joint_that_they_have_learned(self, method):
        clip = seen(walkers(2, persons=2, skeleton=SHELF14))
        xy, confidence = clip.detections.xy.copy(), clip.detections.score.copy()
        learned = [joint in BODY25.joints for joint in SHELF14.joints]
        xy[:, :, 1, learned], confidence[:, :, 1, learned] = np.nan, np.nan
        assert np.isfinite(xy[:, :, 1]).any()
        heads = captured(replace(clip, detections=Detections2D(SHELF14, xy, confidence)), method)
        xy[:, :, 1], confidence[:, :, 1] = np.nan, np.nan
        alone = captured(replace(clip, detections=Detections2D(SHELF14, xy, confidence)), method)
        np.testing.assert_array_equal(heads.xyz, alone.xyz)

    @pytest.mark.parametrize("method", ["plane_sweep", "voxelpose"])
    def test_networks_and_other_bodies(self, method):
        cat = Skeleton("cat", ("tail", "paw"), (-1, 0))
        clip = seen(Poses3D(cat, np.zeros((2, 1, 2, 3))))
        with pytest.raises(
            ValueError, match=rf"method={method} has learned joints of body25, .* found 'cat' with 0 of"
        ):
            captured(clip, method)

    def test_4d_association_of_a_dome(self):
        with pytest.raises(ValueError, match=r"takes at most 12; found 13\. Choose some of them"):
            captured(seen(walkers(1), views=13), "4d_association")


def test_voxels_have_the_mean_of_gaussians_as_high_as_confidences_over_the_views_that_see_them():
    """Beside a joint by its standard deviation in one view, on it in the others; the last view detects nothing."""
    rig = looking_at_origin(4)
    joint = np.array([0.1, 0.2, 1.0])
    xy = np.full((3, 25, 2), np.nan)
    xy[:, 0] = rig.project(joint[None, None])[0][0, :3, 0]
    xy[:, 1] = xy[:, 0] + (0, 300)  # A pose of 300 px
    sigma = 3 * 2**0.5 / 96 * 300
    xy[0, :2, 0] += sigma
    score = np.where(np.isnan(xy[..., 0]), np.nan, 0.8)
    frame = Frame(np.arange(3), xy, score, np.empty((3, 0, 3)))
    found = heat(frame, rig, joint[None])[0]
    np.testing.assert_allclose(found[0], 0.8 * (np.exp(-0.5) + 1 + 1) / 3, rtol=1e-5)
    assert (found[2:] == 0).all()
    wider = heat(frame, rig, joint[None], 2.0)[0]
    np.testing.assert_allclose(wider[0], 0.8 * (np.exp(-1 / 8) + 1 + 1) / 3, rtol=1e-5)
    assert (heat(frame, rig, np.array([[0.1, 0.2, -50.0]])) == 0).all()


class TestOwnMethod:
    def test_of_a_module(self, monkeypatch):
        assert captured(full_clip(frames=2), "tests.dmae.reconstruction.test_systems:nobody").xyz.shape == (2, 0, 25, 3)

    def test_of_the_clip_alone(self):
        assert captured(full_clip(frames=2), "tests.dmae.reconstruction.test_systems:alone").xyz.shape == (2, 0, 25, 3)

    def test_of_other_arguments(self):
        with pytest.raises(ValueError, match=r"method=tests.*:crowded: expected a function of a clip, or of a clip "):
            captured(full_clip(frames=2), "tests.dmae.reconstruction.test_systems:crowded")

    def test_that_returns_something_else(self):
        with pytest.raises(
            ValueError, match=r"method=tests.*:too_short: expected Poses3D of 3 frames, found Poses3D of 1"
        ):
            captured(full_clip(frames=3), "tests.dmae.reconstruction.test_systems:too_short")

    def test_a_function_starts_from_the_capture_of_this_package(self):
        clip = full_clip(frames=2)
        found = captured(clip, "tests.dmae.reconstruction.test_systems:backwards")
        np.testing.assert_array_equal(found.xyz, capture(clip, CaptureConfig()).xyz[:, ::-1])

    def test_unknown(self):
        with pytest.raises(ValueError, match="no capture method 'mv_pose'; did you mean mvpose"):
            CaptureConfig(method="mv_pose")


def backwards(clip: Clip, config: CaptureConfig) -> Poses3D:
    return capture(clip, config).select(persons=slice(None, None, -1))


def nobody(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Find no one."""
    return Poses3D(clip.detections.skeleton, np.empty((len(clip), 0, len(clip.detections.skeleton), 3)))


def alone(clip: Clip) -> Poses3D:
    """Find no one either."""
    return nobody(clip, CaptureConfig())


def crowded(clip: Clip, config: CaptureConfig, people: int) -> Poses3D:
    """Ask for more than there is."""
    raise AssertionError


def too_short(clip: Clip, config: CaptureConfig) -> Poses3D:
    """Lose all frames but one."""
    return nobody(clip.select(frames=[0]), config)


@pytest.mark.parametrize(
    ("method", "least", "most"),
    [
        ("4d_association", 94, 99),
        ("mvpose", 80, 92),
        ("pictorial_structures", 88, 96),
        ("plane_sweep", 93, 99.5),
        ("voxelpose", 88, 97),
    ],
)
def test_on_shelf_it_is_as_good_as_published_up_to_its_differences(data_folder, method, least, most):
    """30 frames with four people, where systems differ; published figures are in their files."""
    (clip,) = Clips(DataConfig("shelf", str(data_folder / "shelf")))
    clip = clip.select(frames=slice(210, 240))
    poses = captured(clip, method)
    truth = convert(clip.truth, SHELF14)
    found = score(convert(poses, SHELF14), poses, truth, scored_actors(clip), fps=clip.fps)
    assert least < found["pcp"] < most
