"""Triangulation: properties that hold for any rig and any points."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from dmae.data.cameras import CameraRig
from dmae.reconstruction.config import NoiseModel
from dmae.reconstruction.triangulation import DEFAULT_NOISE, Points, closest_approach, triangulate
from tests.support import numpy_triangulation
from tests.support.clips import looking_at_origin

seeds = st.integers(0, 2**32 - 1)


def random_rig(rng: np.random.Generator, views: int, distorted: bool = False) -> CameraRig:
    """Cameras of different focal lengths and off-centre principal points, all turned to a 3 m room."""
    rig = looking_at_origin(views)
    K = rig.K.copy()
    K[:, 0, 0], K[:, 1, 1] = rng.uniform(600, 1500, (2, views))
    K[:, :2, 2] += rng.uniform(-60, 60, (views, 2))
    T = rig.cam_from_world.copy()
    T[:, :3, 3] += rng.uniform(-0.5, 0.5, (views, 3))
    dist = rng.uniform(-0.1, 0.1, (views, 5)) * (1, 0.5, 0.01, 0.01, 0.1) * distorted
    return CameraRig(rig.names, K, dist, T, rig.size)


def pixels_of(rig: CameraRig, points: np.ndarray) -> np.ndarray:
    """(n, V, 2) undistorted pixels of points (n, 3)."""
    return rig.undistort(rig.project(points)[0])


def room(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.uniform((-1, -1, 0), (1, 1, 2), (count, 3))


def noisy(rng: np.random.Generator, views: int, count: int = 20):
    """A rig, pixels with noise of the size announced, confidences, the true points."""
    rig, points = random_rig(rng, views), room(rng, count)
    confidence = rng.uniform(0.3, 1, (count, views))
    _, depth = rig.project(points)
    sigma = DEFAULT_NOISE.sigma(confidence) * np.sqrt(rig.K[:, 0, 0] * rig.K[:, 1, 1]) / depth
    return rig, pixels_of(rig, points) + rng.normal(size=(count, views, 2)) * sigma[..., None], confidence, points


def assert_same(a: Points, b: Points, tolerance: float = 1e-6):
    np.testing.assert_allclose(a.xyz, b.xyz, atol=tolerance)
    np.testing.assert_allclose(a.cov, b.cov, rtol=1e-3, atol=1e-9)
    np.testing.assert_allclose(a.residual, b.residual, atol=1e-3)
    np.testing.assert_array_equal(a.views, b.views)


@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(2, 8), st.booleans())
def test_triangulation_inverts_projection(seed, views, distorted):
    rng = np.random.default_rng(seed)
    rig, points = random_rig(rng, views, distorted), room(rng, 10)
    if views == 2:  # cameras that face each other see no depth on the line between them
        rig = random_rig(rng, 5, distorted)[:2]
    found = triangulate(rig, pixels_of(rig, points), np.full((10, len(rig)), 0.9))
    np.testing.assert_allclose(found.xyz, points, atol=1e-6)
    assert (found.views == len(rig)).all()
    assert (found.residual < 1e-4).all()


@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(3, 6))
def test_a_view_of_nan_equals_that_view_removed(seed, views):
    rng = np.random.default_rng(seed)
    rig, xy, confidence, _ = noisy(rng, views)
    gone = rng.integers(views)
    rest = np.delete(np.arange(views), gone)
    without = triangulate(rig[rest], xy[:, rest], confidence[:, rest])
    xy[:, gone] = np.nan
    assert_same(triangulate(rig, xy, confidence), without)


@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(2, 6))
def test_the_order_of_views_does_not_matter(seed, views):
    rng = np.random.default_rng(seed)
    rig, xy, confidence, _ = noisy(rng, views)
    order = rng.permutation(views)
    shuffled = triangulate(rig[order], xy[:, order], confidence[:, order])
    found = triangulate(rig, xy, confidence)
    assert_same(found, shuffled)
    np.testing.assert_array_equal(found.used[:, order], shuffled.used)


@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(2, 6))
def test_points_and_covariances_move_with_the_world(seed, views):
    rng = np.random.default_rng(seed)
    rig, xy, confidence, _ = noisy(rng, views)
    moved_from_world = np.eye(4)
    moved_from_world[:3, :3] = Rotation.random(rng=rng).as_matrix()
    moved_from_world[:3, 3] = rng.uniform(-10, 10, 3)
    moved = CameraRig(rig.names, rig.K, rig.dist, rig.cam_from_world @ np.linalg.inv(moved_from_world), rig.size)
    here, there = triangulate(rig, xy, confidence), triangulate(moved, xy, confidence)
    R, t = moved_from_world[:3, :3], moved_from_world[:3, 3]
    np.testing.assert_allclose(here.xyz @ R.T + t, there.xyz, atol=1e-6)
    np.testing.assert_allclose(R @ here.cov @ R.T, there.cov, rtol=1e-3, atol=1e-8)


@settings(max_examples=30, deadline=None)
@given(seeds, st.integers(5, 8))
def test_an_outlier_view_is_not_used(seed, views):
    # Of four views, an outlier agrees now and then with two that are opposite each other.
    rng = np.random.default_rng(seed)
    rig, points = random_rig(rng, views), room(rng, 10)
    xy = pixels_of(rig, points) + rng.normal(0, 2, (10, views, 2))
    outlier = rng.integers(views, size=10)
    angle = rng.uniform(0, 2 * np.pi, 10)
    xy[np.arange(10), outlier] += 300 * np.stack([np.cos(angle), np.sin(angle)], -1)
    found = triangulate(rig, xy, np.full((10, views), 0.9))
    assert not found.used[np.arange(10), outlier].any()
    deviation = np.sqrt(np.trace(found.cov, axis1=1, axis2=2))
    assert (np.linalg.norm(found.xyz - points, axis=-1) < 4 * deviation).all()


def test_shapes_follow_the_input():
    rig = looking_at_origin(3)
    found = triangulate(rig, np.full((4, 0, 25, 3, 2), np.nan), np.full((4, 0, 25, 3), np.nan))
    assert found.xyz.shape == (4, 0, 25, 3)
    point = triangulate(rig, pixels_of(rig, np.array([[0.1, 0.2, 1.0]]))[0], np.ones(3))
    np.testing.assert_allclose(point.xyz, [0.1, 0.2, 1.0], atol=1e-9)
    assert point.views == 3
    assert point.cov.shape == (3, 3)


def test_a_point_in_one_view_is_absent():
    rig = looking_at_origin(3)
    xy = pixels_of(rig, np.array([[0.1, 0.2, 1.0]]))
    xy[:, 1:] = np.nan
    found = triangulate(rig, xy, np.ones((1, 3)))
    assert np.isnan(found.xyz).all()
    assert np.isnan(found.cov).all()
    assert found.views == 0


@pytest.mark.parametrize("odd", [np.nan, np.inf])
def test_a_view_without_a_finite_pixel_or_confidence_is_absent(odd):
    rig = looking_at_origin(3)
    xy, confidence = pixels_of(rig, np.array([[0.1, 0.2, 1.0]] * 2)), np.ones((2, 3))
    xy[0, 0, 1], confidence[1, 2] = odd, odd
    found = triangulate(rig, xy, confidence)
    assert found.used.tolist() == [[False, True, True], [True, True, False]]
    np.testing.assert_allclose(found.xyz, [[0.1, 0.2, 1.0]] * 2, atol=1e-9)


def face_to_face() -> CameraRig:
    """Two cameras that look at each other along x from 4 m, and one from the side."""
    rotations = [
        [[0, -1, 0], [0, 0, -1], [1, 0, 0]],
        [[0, 1, 0], [0, 0, -1], [-1, 0, 0]],
        [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
    ]
    T = np.tile(np.eye(4), (3, 1, 1))
    T[:, :3, :3], T[:, 2, 3] = rotations, 4
    K = np.tile([[1000.0, 0, 500], [0, 1000, 500], [0, 0, 1]], (3, 1, 1))
    return CameraRig(tuple("abc"), K, np.zeros((3, 5)), T, np.full((3, 2), 1000))


def test_parallel_rays_give_no_point_and_perpendicular_rays_do():
    rig, centre = face_to_face(), np.full((1, 3, 2), 500.0)
    parallel, perpendicular = centre.copy(), centre.copy()
    parallel[:, 2], perpendicular[:, 1] = np.nan, np.nan
    assert np.isnan(triangulate(rig, parallel, np.ones((1, 3))).xyz).all()
    np.testing.assert_allclose(triangulate(rig, perpendicular, np.ones((1, 3))).xyz, 0, atol=1e-9)


def test_a_point_of_uncertain_depth_is_absent():
    """Two cameras face each other: a point near the line between them may be anywhere on it."""
    rig = face_to_face()[:2]
    xy = pixels_of(rig, np.array([[0.0, 0.05, 0.0], [0.0, 1.0, 0.0]]))
    near_the_line, aside = triangulate(rig, xy, np.full((2, 2), 0.9)).xyz
    assert np.isnan(near_the_line).all()
    np.testing.assert_allclose(aside, [0, 1, 0], atol=1e-6)


def test_rays_that_meet_behind_a_camera_give_no_point():
    """The lines through pixels of a point behind both cameras meet there, but no camera can see it."""
    rig = looking_at_origin(8)[:2]
    behind = np.array([9.0, 3.5, 2.0, 1.0])
    pixels = rig.projections @ behind
    xy = (pixels[:, :2] / pixels[:, 2:])[None]
    assert (pixels[:, 2] < 0).all()
    assert np.isnan(triangulate(rig, xy, np.ones((1, 2))).xyz).all()


def test_a_more_confident_view_weighs_more():
    rig, point = looking_at_origin(4), np.array([[0.0, 0.0, 1.0]])
    xy = pixels_of(rig, point)
    xy[0, 0, 1] += 6
    doubted, trusted = np.full((2, 1, 4), 0.8)
    doubted[0, 0], trusted[0, 0] = 0.3, 1.0
    assert abs(triangulate(rig, xy, doubted).xyz[0, 2] - 1) < abs(triangulate(rig, xy, trusted).xyz[0, 2] - 1)


def test_the_covariance_is_that_of_the_error():
    """Mahalanobis distances follow chi^2 of three degrees (median 2.4, mean 3), or less where residuals widen it."""
    rng = np.random.default_rng(0)
    rig, xy, confidence, points = noisy(rng, 5, 4000)
    found = triangulate(rig, xy, confidence)
    off = found.xyz - points
    assert np.isfinite(off).all()
    distance = np.einsum("ni,nij,nj->n", off, np.linalg.inv(found.cov), off)
    assert 1.8 < np.median(distance) < 2.5
    assert 2.4 < distance.mean() < 3.2


def test_a_point_does_not_depend_on_the_rest_of_the_batch():
    rig, xy, confidence, _ = noisy(np.random.default_rng(1), 5, 50)
    together = triangulate(rig, xy, confidence)
    alone = [triangulate(rig, xy[i : i + 1], confidence[i : i + 1]) for i in range(50)]
    np.testing.assert_allclose(together.xyz, np.concatenate([found.xyz for found in alone]), atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(seeds, st.integers(2, 8), st.sampled_from([2, 8]))
def test_it_does_as_its_form_in_numpy(seed, views, iterations):
    """With views missing and outliers."""
    rng = np.random.default_rng(seed)
    rig, xy, confidence, _ = noisy(rng, views, 60)
    outlier = rng.random(xy.shape[:2]) < 0.15
    xy[outlier] += rng.normal(0, 100, (outlier.sum(), 2))
    xy[rng.random(xy.shape[:2]) < 0.2] = np.nan
    assert_same(
        triangulate(rig, xy, confidence, iterations=iterations),
        numpy_triangulation.triangulate(rig, xy, confidence, iterations=iterations),
        2e-6,
    )


def test_covariances_have_the_largest_eigenvalue_that_is_allowed():
    rng = np.random.default_rng(0)
    rig, xy, confidence, _ = noisy(rng, 3, 200)
    found = triangulate(rig, xy, confidence, NoiseModel(max_error_m=0.04))
    every = triangulate(rig, xy, confidence, NoiseModel(max_error_m=10.0))
    within = np.linalg.eigvalsh(every.cov)[:, -1] <= 0.04**2
    assert 0.1 < within.mean() < 0.9
    np.testing.assert_array_equal(np.isfinite(found.xyz[:, 0]), within)


vector = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)


@given(vector, vector, vector)
def test_the_connection_is_perpendicular_to_both_lines(base, a, b):
    assume(np.linalg.norm(a) > 0.1 and np.linalg.norm(b) > 0.1)
    a, b = a / np.linalg.norm(a), b / np.linalg.norm(b)
    along_a, along_b, sine2 = closest_approach(base, a, b)
    assume(sine2 > 1e-3)
    np.testing.assert_allclose(sine2, (np.cross(a, b) ** 2).sum(), atol=1e-9)
    connection = base + along_b * b - along_a * a
    np.testing.assert_allclose([connection @ a, connection @ b], 0, atol=1e-9)


def test_a_point_behind_the_start_is_negative():
    along_a, along_b, sine2 = closest_approach(np.array([0, 2, 0]), np.array([1, 0, 0]), np.array([0, 1, 0]))
    assert (along_a, along_b, sine2) == (0, -2, 1)


def test_parallel_lines_have_the_smallest_sine():
    x = np.array([1.0, 0, 0])
    assert closest_approach(np.array([0, 1.0, 0]), x, x)[2] == 1e-12
