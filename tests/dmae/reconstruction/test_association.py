"""Association within a frame, against least squares and against the people that detections were made of."""

import numpy as np
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from dmae.reconstruction.association import NONE, affinity, cluster, propagate, ray_distances
from tests.support.clips import looking_at_origin, t_pose

unit = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)
place = st.tuples(*[st.floats(-3, 3)] * 3)


def one(vector) -> np.ndarray:
    return np.array(vector) / np.linalg.norm(vector)


@settings(max_examples=60, deadline=None)
@given(place, unit, place, unit)
def test_distance_is_the_least_between_points_of_the_rays(a, ray_a, b, ray_b):
    a, b, ray_a, ray_b = np.array(a), np.array(b), one(ray_a), one(ray_b)
    # Nearly parallel rays meet, if at all, where no person can be: they count as parallel.
    assume(not 0 < np.linalg.norm(np.cross(ray_a, ray_b)) < 1e-3)
    distances = ray_distances(np.stack([a, b]), np.stack([ray_a, ray_b])[:, None])[..., 0]
    _, least = nnls(np.stack([ray_a, -ray_b], 1), b - a)
    np.testing.assert_allclose(distances, [[0, least], [least, 0]], atol=1e-5)


def test_perpendicular_and_parallel_rays_have_distances():
    origins = np.array([[0, 0, 0], [3, 0, 1], [0, 2, 0.0]])
    rays = np.array([[1, 0, 0], [0, 1, 0], [1, 0, 0.0]])[:, None]
    distances = ray_distances(origins, rays)[..., 0]
    np.testing.assert_allclose(distances, [[0, 1, 2], [1, 0, 1], [2, 1, 0]], atol=1e-9)


def test_rays_behind_a_camera_are_not_near():
    """The lines cross at (0, 0, 0), a metre behind the second camera."""
    origins = np.array([[-3, 0, 0], [0, 1, 0.0]])
    rays = np.array([[1, 0, 0], [0, 1, 0.0]])[:, None]
    assert ray_distances(origins, rays)[0, 1, 0] > 0.99


def test_affinity_needs_shared_evidence():
    distances = np.array([0.0, 0.1, np.nan, 0.0])[:, None, None]
    weights = np.ones_like(distances)
    assert np.isnan(affinity(distances, weights, 0.1)[2, 0])
    one_joint, nine_joints = np.zeros((1, 1, 1)), np.zeros((1, 1, 9))
    many = affinity(nine_joints, np.ones((1, 1, 9)), 0.1)
    assert affinity(one_joint, np.ones((1, 1, 1)), 0.1) < many < 1
    np.testing.assert_allclose(affinity(nine_joints + 0.1, np.ones((1, 1, 9)), 0.1), many / 2)


def shuffled_detections(people: np.ndarray, seen: np.ndarray, rng: np.random.Generator):
    """Origins, rays, views and persons of detections, shuffled; `seen` (V, P) is True where a view detects a person."""
    rig = looking_at_origin(len(seen))
    xy, _ = rig.project(people[None])
    rays = rig.rays(xy + rng.normal(0, 2, xy.shape))[0]
    view, person = np.nonzero(seen)
    order = rng.permutation(len(view))
    view, person = view[order], person[order]
    return rig.centers[view], rays[view, person], view, person


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 6), st.integers(1, 4))
def test_clusters_are_the_people(seed, views, count):
    """Each person is one cluster, in any number of views, with people missing in some.

    No person is seen by one camera alone: two such people may lie on each other's rays and cannot be distinguished.
    Any two people are seen together by some camera: the cameras look from one height, so that rays of two cameras to
    one person and of two others to another may meet in pairs across the people as well.
    """
    rng = np.random.default_rng(seed)
    around = rng.permutation(6)[:count]
    spots = np.stack([1.5 * np.cos(around), 1.5 * np.sin(around), 0 * around], -1)
    turn = rng.uniform(0, 2 * np.pi, count)
    T = t_pose()
    people = np.stack([
        np.stack([np.cos(a) * T[:, 0] - np.sin(a) * T[:, 1], np.sin(a) * T[:, 0] + np.cos(a) * T[:, 1], T[:, 2]], -1)
        for a in turn
    ]) + spots[:, None]  # fmt: skip
    seen = rng.random((views, count)) < 0.8
    seen[:, seen.sum(0) == 1] = False
    for person in range(count):
        apart = ~(seen[:, :person] & seen[:, [person]]).any(0) & seen[:, :person].any(0)
        if apart.any():
            seen[:, person] = False
    origins, rays, view, person = shuffled_detections(people, seen, rng)
    distances = ray_distances(origins, rays)
    groups = cluster(affinity(distances, np.ones_like(distances), 0.1), view, 0.5)
    found = {frozenset(group.tolist()) for group in groups}
    expected = {frozenset(np.flatnonzero(person == p).tolist()) for p in np.flatnonzero(seen.any(0))}
    assert found == expected


def test_clusters_hold_one_detection_of_a_view_and_agree_with_each_other():
    """0-1 and 1-2 look alike, 0-2 do not: the chain is not one person."""
    alike = np.array([[1, 0.9, 0.0], [0.9, 1, 0.8], [0.0, 0.8, 1]])
    assert [group.tolist() for group in cluster(alike, np.array([0, 1, 2]), 0.5)] == [[0, 1]]
    assert cluster(alike, np.array([0, 0, 0]), 0.5) == []


def closeness(values) -> np.ndarray:
    """(1, T, D, 1) from (T, D)."""
    return np.array(values, float)[None, :, :, None]


def test_propagation_is_the_best_assignment_of_all():
    owner, primary = propagate(closeness([[0.9, 0.8], [0.8, -1]]), np.array([True, True]))
    assert owner.tolist() == [[1, 0]]
    assert primary.tolist() == [[1, 0]]


def test_confirmed_tracks_are_assigned_first_and_far_detections_to_none():
    values = closeness([[0.5, -1, np.nan], [0.9, -1, -0.2]])
    owner, primary = propagate(values, np.array([True, False]))
    assert primary.tolist() == [[0, NONE]]
    assert owner.tolist() == [[0, NONE, NONE]]


def test_a_fragment_is_assigned_to_the_nearest_person():
    values = closeness([[0.9, 0.2, -1], [-1, 0.3, 0.8]])
    owner, primary = propagate(values, np.array([True, True]))
    assert primary.tolist() == [[0, 2]]
    assert owner.tolist() == [[0, 1, 1]]


def test_without_tracks_no_detection_is_assigned():
    owner, primary = propagate(np.empty((2, 0, 3, 25)), np.zeros(0, bool))
    assert (owner == NONE).all()
    assert primary.shape == (2, 0)
