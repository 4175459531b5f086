"""Compiled distances, and functions that use them, compared with the same computation on arrays."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dmae.completion.fillings import fill_pchip_body, fill_rays
from dmae.completion.methods import find_method
from dmae.completion.windows import make_rows, rest_pose
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14
from dmae.metrics.comparison import match, take_matched
from dmae.numerics.body import rotate_z
from dmae.numerics.filling import resample
from dmae.reconstruction.association import NONE
from dmae.reconstruction.config import CaptureConfig, DistanceUnit, NoiseModel
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.pipeline import capture
from dmae.reconstruction.reassignment import reassign
from dmae.reconstruction.triangulation import triangulate
from tests.support.clips import looking_at_origin, walkers
from tests.support.detected_people import crossing, detected_clip, errors, standing
from tests.support.gaps import FPS, turning, without

FRAMES = slice(10, 30)


@pytest.fixture(scope="module")
def evidence() -> Evidence:
    """Return that of the frames of the people."""
    return Evidence.of(detected_clip(crossing(), miss=0.3), 0.1, CaptureConfig(), FRAMES)


@pytest.fixture(scope="module")
def people() -> np.ndarray:
    """(F, P, J, 3) near the true people; some unknown, one behind all cameras."""
    rng = np.random.default_rng(0)
    xyz = crossing()[FRAMES] + rng.normal(0, 0.05, crossing()[FRAMES].shape)
    xyz[rng.random(xyz.shape[:3]) < 0.2] = np.nan
    return np.concatenate([xyz, xyz[:, :1] + 100.0], 1)


def by_arrays(evidence: Evidence, people: np.ndarray, unit: DistanceUnit) -> np.ndarray:
    """(F, V, P, D, J)"""
    rig = evidence.rig
    pixels, depth = rig.project(people)
    focal, diagonal = np.sqrt(rig.K[:, 0, 0] * rig.K[:, 1, 1]), np.hypot(*rig.size.T)
    scale = depth / focal[:, None, None] if unit == DistanceUnit.metres else 1 / diagonal[:, None, None] + 0 * depth
    return np.linalg.norm(pixels[:, :, :, None] - evidence.xy[:, :, None], axis=-1) * scale[:, :, :, None]


@pytest.mark.parametrize("unit", list(DistanceUnit))
def test_distances_of_detections_from_people(evidence, people, unit):
    found, expected = evidence.distances(people, unit), by_arrays(evidence, people, unit)
    assert np.isfinite(expected).mean() > 0.2 and np.isnan(expected[:, :, -1]).any()
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_joints_take_the_detection_that_is_nearest_both_ways(evidence, people):
    distance = by_arrays(evidence, people, DistanceUnit.metres)
    distance = np.where(distance < 0.2, distance, np.inf)
    nearest = distance.argmin(3)
    owner = np.take_along_axis(distance.argmin(2), nearest, 2)
    mutual = np.isfinite(distance.min(3)) & (owner == np.arange(people.shape[1])[:, None])
    expected = np.where(mutual, nearest, NONE).swapaxes(1, 2)
    before = np.full(expected.shape, 7, np.int16)
    found = reassign(evidence, before, people, 0.2)
    known = ~np.isnan(people[:, :, None, :, 0]) & np.ones(expected.shape, bool)
    np.testing.assert_array_equal(found[known], expected[known])
    assert (found[~known] == 7).all() and (expected[known] != NONE).mean() > 0.3


ELBOW, WRIST = BODY25.index("l_elbow", "l_wrist")


def rays_to(xyz: np.ndarray, camera=(6.0, -5.0, 2.0)) -> np.ndarray:
    """(..., 2, 3) from a camera to points (..., 3)."""
    centre = np.broadcast_to(camera, xyz.shape)
    return np.stack([centre, (xyz - centre) / np.linalg.norm(xyz - centre, axis=-1, keepdims=True)], -2)


def waving(hidden: slice = slice(15, 45)) -> tuple[Poses3D, np.ndarray]:
    """Poses of a person raising a forearm while one camera alone sees the wrist; and the true joints."""
    truth = walkers(frames=60, persons=1).xyz.astype(float)
    length = np.linalg.norm(truth[0, 0, WRIST] - truth[0, 0, ELBOW])
    angle = 1.5 * np.sin(np.pi * (np.arange(60) - 15) / 30).clip(0)
    truth[:, 0, WRIST] = truth[:, 0, ELBOW] + length * np.stack([0 * angle, np.cos(angle), np.sin(angle)], -1)
    holed = without(Poses3D(BODY25, truth), hidden, 0, WRIST)
    return replace(holed, rays=rays_to(truth)), truth


def error_of(poses: Poses3D, truth: np.ndarray, joint: int = WRIST) -> np.ndarray:
    return np.linalg.norm(poses.xyz[:, 0, joint] - truth[:, 0, joint], axis=-1)


def test_capture_returns_the_ray_of_a_joint_that_one_camera_sees():
    clip = detected_clip(crossing(), views=4, miss=0.0, noise=0.5)
    rig = clip.rig
    # The wrist of the detections nearest to the first person's in all views but the third.
    wrist = rig.project(crossing()[:, :1, WRIST])[0]
    gap = np.linalg.norm(clip.detections.xy[:, :, :, WRIST] - wrist, axis=-1)
    missed = (gap < 3) & (np.arange(4) != 2)[:, None] & (np.abs(np.arange(100) - 50) < 15)[:, None, None]
    clip.detections.xy[:, :, :, WRIST][missed] = np.nan
    clip.detections.score[:, :, :, WRIST][missed] = np.nan
    poses = capture(clip, CaptureConfig())
    matches = match(poses.xyz, crossing())
    source = take_matched(poses.source, matches, Source.ABSENT)[36:64, 0, WRIST]
    rays = take_matched(poses.rays, matches)[36:64, 0, WRIST]
    assert (source == Source.ABSENT).all()
    np.testing.assert_allclose(rays[:, 0], np.tile(rig.centers[2], (28, 1)), atol=1e-4)
    to_wrist = crossing()[36:64, 0, WRIST] - rays[:, 0]
    aside = np.linalg.norm(np.cross(to_wrist, rays[:, 1]), axis=-1)
    assert aside.max() < 0.03
    np.testing.assert_allclose(np.linalg.norm(rays[:, 1], axis=-1), 1, atol=1e-5)


def test_a_joint_that_no_camera_sees_has_no_ray():
    clip = detected_clip(crossing(), views=4, miss=0.0)
    clip.detections.xy[30:60, :, :, WRIST] = np.nan
    clip.detections.score[30:60, :, :, WRIST] = np.nan
    rays = capture(clip, CaptureConfig()).rays
    assert np.isnan(rays[30:60, :, WRIST]).all()
    assert np.isfinite(rays[:30, :, WRIST]).any()


def test_a_hidden_joint_goes_onto_its_ray_and_to_the_length_of_its_bone():
    poses, truth = waving()
    without_rays, with_rays = error_of(fill_pchip_body(poses, FPS), truth), error_of(fill_rays(poses, FPS), truth)
    assert without_rays.max() > 0.3
    assert with_rays.max() < 0.16 and with_rays[15:45].mean() < 0.4 * without_rays[15:45].mean()
    np.testing.assert_array_equal(fill_rays(poses, FPS).xyz[:15], poses.xyz[:15])


def test_the_children_of_a_joint_on_its_ray_follow_it():
    """Elbow and wrist are hidden, the elbow raised; only the elbow is seen, by one camera."""
    truth = walkers(frames=60, persons=1).xyz.astype(float)
    truth[15:45, 0, ELBOW : WRIST + 1] += 0.25 * np.sin(np.pi * np.arange(30) / 30)[:, None, None] * (0, 0, 1)
    rays = rays_to(truth)
    rays[:, :, WRIST] = np.nan
    poses = replace(without(Poses3D(BODY25, truth), slice(15, 45), 0, [ELBOW, WRIST]), rays=rays)
    without_rays, with_rays = error_of(fill_pchip_body(poses, FPS), truth), error_of(fill_rays(poses, FPS), truth)
    assert without_rays.max() > 0.2 and with_rays.max() < 0.5 * without_rays.max()


def test_a_joint_does_not_jump_when_its_ray_ends():
    poses, truth = waving()
    rays = poses.rays.copy()
    rays[25:35] = np.nan
    step = np.linalg.norm(np.diff(fill_rays(replace(poses, rays=rays), FPS).xyz[:, 0, WRIST], axis=0), axis=-1)
    assert step.max() < 2 * np.linalg.norm(np.diff(truth[:, 0, WRIST], axis=0), axis=-1).max()


def test_a_ray_of_another_person_is_not_used():
    poses, _ = waving()
    rays = poses.rays.copy()
    rays[..., 0, :] += (0, 0, 0.8)
    np.testing.assert_array_equal(fill_rays(replace(poses, rays=rays), FPS).xyz, fill_pchip_body(poses, FPS).xyz)


def test_without_rays_nothing_changes():
    poses = without(turning(), slice(15, 45), 0, [ELBOW, WRIST])
    np.testing.assert_array_equal(fill_rays(poses, FPS).xyz, fill_pchip_body(poses, FPS).xyz)


@settings(max_examples=20, deadline=None)
@given(st.floats(-3, 3), st.floats(-5, 5))
def test_rays_turn_with_the_world(angle, away):
    poses, _ = waving()
    R = Rotation.from_rotvec((0, 0, angle)).as_matrix()
    moved = np.stack([poses.rays[..., 0, :] @ R.T + away, poses.rays[..., 1, :] @ R.T], -2)
    there = fill_rays(Poses3D(BODY25, poses.xyz @ R.T + away, rays=moved), FPS)
    np.testing.assert_allclose(fill_rays(poses, FPS).xyz @ R.T + away, there.xyz, atol=2e-4)


def test_rejected_joints_keep_their_rays():
    poses, truth = waving(slice(0, 0))
    xyz = poses.xyz.copy()
    xyz[20:23, 0, WRIST] += (0, 0, 0.6)
    wrong = replace(poses, xyz=xyz)
    assert error_of(find_method("reject_gaussian_process").load()(wrong, FPS), truth)[20:23].max() < 0.1


def test_joints_keep_their_rays_on_another_skeleton_and_derived_ones_have_none():
    poses, _ = waving()
    shelf = convert(poses, SHELF14)
    np.testing.assert_array_equal(shelf.rays[:, :, SHELF14.index("l_wrist")], poses.rays[:, :, [WRIST]])
    assert np.isnan(shelf.rays[:, :, SHELF14.index("top_head")]).all()


def test_resampled_rays_point_at_the_joint_between_frames_of_one_camera_only():
    poses, _ = waving(slice(0, 0))
    rays = poses.rays.copy()
    rays[30:] = rays_to(poses.xyz.astype(float), camera=(0, 7, 2))[30:]
    fast = resample(replace(poses, rays=rays), FPS, 2 * FPS)
    assert np.isnan(fast.rays[59, 0, WRIST]).all() and np.isfinite(fast.rays[[58, 60], 0, WRIST]).all()
    to_joint = fast.xyz - fast.rays[..., 0, :]
    aside = np.linalg.norm(np.cross(to_joint, fast.rays[..., 1, :]), axis=-1)
    assert np.nanmax(aside) < 0.002


def test_the_network_gets_only_the_rays_of_hidden_joints_in_the_frame_of_the_window():
    poses, truth = waving()
    rows = make_rows(poses, FPS, rest_pose(truth, BODY25), 15)
    shown = (rows.ray != 0).any(-1)
    np.testing.assert_array_equal(np.argwhere(shown), [(frame, WRIST) for frame in range(15, 45)])
    windows, _, heading = rows.cut(np.array([20]), 15, align_heading=True)
    direction = rotate_z(windows.ray.numpy().astype(float), heading[:, None, None])
    np.testing.assert_allclose(direction[0, 3, WRIST], poses.rays[23, 0, WRIST, 1], atol=1e-5)


@pytest.mark.parametrize("shape", [(0, 1), (5, 0)])
def test_zero_people_and_unknown_joints_have_no_rays(shape):
    nothing = Poses3D(BODY25, np.empty((*shape, 25, 3)))
    assert fill_rays(nothing, FPS).rays.shape == (*shape, 25, 2, 3)
    clip = detected_clip(np.full((shape[0], 1, 25, 3), np.nan), rig=looking_at_origin(4))
    assert capture(clip, CaptureConfig()).rays.shape[0] == shape[0]


def displaced(clip, view: int, metres: float):
    """The clip as with a calibration that has a camera elsewhere."""
    poses = clip.rig.cam_from_world.copy()
    poses[view, :3, 3] += (metres, 0, 0)
    return replace(clip, rig=replace(clip.rig, cam_from_world=poses))


@pytest.mark.parametrize("view", [0, 3])
def test_a_displaced_camera_counts_little(view):
    """Its residuals are as large as those of noise in its pixels would be, so the others decide."""
    people = standing(60)
    clip = detected_clip(people, views=5, noise=2.0)
    wrong = displaced(clip, view, 0.12)
    others = [each for each in range(5) if each != view]
    found, without = (
        np.nanmedian(errors(capture(each, CaptureConfig()), people)) for each in (wrong, clip.select(views=others))
    )
    assert found < 1.05 * without
    unaware = capture(wrong, CaptureConfig(noise=NoiseModel(learn=False)))
    assert found < 0.8 * np.nanmedian(errors(unaware, people))


def test_three_views_that_agree_come_before_two_that_agree_more_closely():
    """Of the second point two views agree exactly, and the other three within a gate of two sigmas."""
    rig = looking_at_origin(5)
    true, false = np.array([[0.0, 0.0, 1.0]]), np.array([[0.25, 0.3, 1.2]])
    xy = rig.project(true)[0].reshape(1, 5, 2)
    xy[:, :3] += np.array([[3.0, 0], [-3, 2], [0, -3]])
    xy[:, 3:] = rig.project(false)[0].reshape(1, 5, 2)[:, 3:]
    points = triangulate(rig, xy, np.full((1, 5), 0.8), NoiseModel(gate_sigmas=2.0))
    assert points.used[0].tolist() == [True] * 3 + [False] * 2
    assert np.linalg.norm(points.xyz - true) < 0.05
