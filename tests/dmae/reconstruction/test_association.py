"""Association within a frame, against least squares and against the people that detections were made of."""

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from dmae.reconstruction.association import NONE, Candidates, affinity, find_groups, find_partners, propagate
from dmae.reconstruction.config import AssociationConfig
from tests.support.clips import looking_at_origin, t_pose

unit = st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.1)
place = st.tuples(*[st.floats(-3, 3)] * 3)


def one(vector) -> np.ndarray:
    return np.array(vector) / np.linalg.norm(vector)


def affinity_of(base, ray_a, ray_b, weights=((1,), (1,)), half=0.1) -> float:
    """Affinity of two detections with rays (3,) to all their joints, the camera of the second `base` from the first."""
    weights = np.array(weights, np.float32)
    rays = np.stack([np.tile(np.array(ray, np.float32)[:, None], weights.shape[1]) for ray in (ray_a, ray_b)])
    centers = np.array([(0, 0, 0), base], np.float32)
    candidates = Candidates(np.arange(2), centers, rays, weights, np.zeros((2, 3), np.float32))
    return affinity(0, 1, candidates, np.float32(half), np.float32(0))[0]


def ray_distance(a, ray_a, b, ray_b) -> float:
    """Distance between rays from two places, m, from the affinity of detections of that single joint."""
    highest = affinity_of((0, 0, 0), (0, 0, 1), (0, 0, 1))
    found = affinity_of(np.array(b) - a, ray_a, ray_b, half=1)
    return np.sqrt(highest / found - 1) if found < highest else 0.0


@settings(max_examples=60, deadline=None)
@given(place, unit, place, unit)
def test_distance_is_the_least_between_points_of_the_rays(a, ray_a, b, ray_b):
    a, b, ray_a, ray_b = np.array(a), np.array(b), one(ray_a), one(ray_b)
    # Nearly parallel rays meet, if at all, where no person can be: they count as parallel.
    assume(not 0 < np.linalg.norm(np.cross(ray_a, ray_b)) < 1e-2)
    _, least = nnls(np.stack([ray_a, -ray_b], 1), b - a)
    for distance in (ray_distance(a, ray_a, b, ray_b), ray_distance(b, ray_b, a, ray_a)):
        np.testing.assert_allclose(distance, least, rtol=1e-4, atol=2e-3)


def test_perpendicular_and_parallel_rays_have_distances():
    origins, rays = [[0, 0, 0], [3, 0, 1], [0, 2, 0.0]], [[1, 0, 0], [0, 1, 0], [1, 0, 0.0]]
    found = [ray_distance(origins[a], rays[a], origins[b], rays[b]) for a, b in ((0, 1), (0, 2), (1, 2))]
    np.testing.assert_allclose(found, [1, 2, 1], atol=1e-5)


def test_rays_behind_a_camera_are_not_near():
    """The lines cross at (0, 0, 0), a metre behind the second camera."""
    assert ray_distance([-3, 0, 0], [1, 0, 0], [0, 1, 0], [0, 1, 0]) > 0.99


def test_affinity_needs_shared_evidence():
    forward, weights = (0, 0, 1), np.ones((2, 9))
    assert affinity_of((0, 0, 0), forward, forward) < affinity_of((0, 0, 0), forward, forward, weights) < 1
    half = affinity_of((0.1, 0, 0), forward, forward, weights)
    np.testing.assert_allclose(half, affinity_of((0, 0, 0), forward, forward, weights) / 2, rtol=1e-5)
    weights[0, ::2], weights[1, 1::2] = 0, 0
    assert affinity_of((0, 0, 0), forward, forward, weights) == -1


def shuffled_detections(people: np.ndarray, seen: np.ndarray, rng: np.random.Generator):
    """Rays, views and persons of detections, shuffled; `seen` (V, P) is True where a view detects a person."""
    rig = looking_at_origin(len(seen))
    xy, _ = rig.project(people[None])
    rays = rig.rays(xy + rng.normal(0, 2, xy.shape))[0]
    view, person = np.nonzero(seen)
    order = rng.permutation(len(view))
    view, person = view[order], person[order]
    return rays[view, person], view, person


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(2, 6), st.integers(1, 4))
# Two pairs of strangers, barely above the threshold, have more affinity than one pair of a person.
@example(225, 5, 4)
@example(4293, 5, 4)
@example(5711, 5, 4)
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
    rays, view, person = shuffled_detections(people, seen, rng)
    order = np.argsort(view, kind="stable")
    rig = looking_at_origin(views)
    candidates = Candidates.of(view[order], rig.centers, rays[order], np.ones(rays.shape[:2]))
    groups = find_groups(candidates, AssociationConfig())
    found = {frozenset(order[group[group != NONE]].tolist()) for group in groups}
    expected = {frozenset(np.flatnonzero(person == p).tolist()) for p in np.flatnonzero(seen.any(0))}
    assert found == expected


def test_groups_hold_one_detection_of_a_view_and_agree_with_each_other():
    """0-1 and 1-2 agree. 0-2 do not: 2 sees each joint a metre further along the rays of 1, a camera overhead."""
    centers = np.array([[6, 0, 1.5], [1, 2, 7], [0, -6, 1.5]])
    body = t_pose()
    beyond = body + (body - centers[1]) / np.linalg.norm(body - centers[1], axis=-1, keepdims=True)
    rays = np.stack([body - centers[0], body - centers[1], beyond - centers[2]])
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    chain = Candidates.of(np.arange(3), centers, rays, np.ones((3, 25)))
    found = [group[group != NONE].tolist() for group in find_groups(chain, AssociationConfig())]
    assert found in ([[0, 1]], [[1, 2]])
    same = Candidates.of(np.array([0, 0]), centers, rays[[0, 0]], np.ones((2, 25)))
    assert find_groups(same, AssociationConfig()).shape == (0, 3)


def test_many_detections_of_a_view_are_grouped_in_bounded_time():
    """Beyond 100 in a view, and beyond 16 partners each: people in all views are found among figures of one view."""
    rng = np.random.default_rng(0)
    rig, people = looking_at_origin(5), np.stack([t_pose() + (x, 0.3 * x, 0) for x in (-1.5, 0, 1.5)])
    alone = t_pose() + np.concatenate([rng.uniform(-3, 3, (5, 150, 2)), np.zeros((5, 150, 1))], -1)[:, :, None]
    alone += rng.normal(0, 0.05, alone.shape)
    xy = np.concatenate([rig.project(people[None])[0][0], [rig.project(alone[v][None])[0][0, v] for v in range(5)]], 1)
    rays = rig.rays(xy[None] + rng.normal(0, 2, xy.shape))[0]
    view = np.repeat(np.arange(5), 153)
    candidates = Candidates.of(view, rig.centers, rays.reshape(-1, 25, 3), np.full((len(view), 25), 0.8))
    groups = find_groups(candidates, AssociationConfig())
    found = {tuple(group - 153 * np.arange(5)) for group in groups}
    assert {(person,) * 5 for person in range(3)} <= found


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


VIEWS, EACH, JOINTS = 3, 12, 25


def detections(seed: int) -> Candidates:
    """Return figures in three views, a third of them of the same people."""
    rng = np.random.default_rng(seed)
    centers = np.array([[4, 0, 1.5], [-2, 3.5, 1.6], [-2, -3.5, 1.4]], np.float32)
    same = rng.uniform(-1, 1, (EACH // 3, JOINTS, 3))
    view, rays = np.repeat(np.arange(VIEWS), EACH), np.zeros((VIEWS * EACH, 3, 32), np.float32)
    for v in range(VIEWS):
        places = np.concatenate([same, rng.uniform(-1, 1, (EACH - len(same), JOINTS, 3))])
        towards = places + rng.normal(0, 0.01, places.shape) - centers[v]
        rays[view == v, :, :JOINTS] = (towards / np.linalg.norm(towards, axis=-1, keepdims=True)).swapaxes(1, 2)
    weights = np.zeros((len(view), 32), np.float32)
    weights[:, :JOINTS] = np.sqrt(rng.uniform(0.3, 1, (len(view), JOINTS)))
    absent = rng.random(weights.shape) < 0.2
    weights[absent] = 0
    rays.swapaxes(1, 2)[absent] = 0
    colours = rng.uniform(0, 60, (len(view), 3)).astype(np.float32)
    return Candidates(view, centers, rays, weights, colours)


@pytest.mark.parametrize("least", [0.3, 0.5])
@pytest.mark.parametrize("colour_weight", [0.0, 0.3, 1.0])
def test_no_pair_is_lost(least, colour_weight):
    for seed in range(3):
        given = detections(seed)
        half, weight, limit = np.array([0.1, colour_weight, least], np.float32)
        by_joint = (np.ascontiguousarray(each) for each in (given.rays.transpose(1, 2, 0), given.weights.T))
        partners, found = find_partners(given, *by_joint, half, weight, limit, EACH)
        view, expected = given.in_view, {}
        for i in range(len(view)):
            for j in range(len(view)):
                value, _ = affinity(min(i, j), max(i, j), given, half, weight)
                if view[i] != view[j] and value >= limit:
                    expected[i, j] = value
        assert len(expected) >= 2 * 3 * EACH // 3
        rows = np.argwhere(partners >= 0)
        assert {(i, partners[i, v, k]): found[i, v, k] for i, v, k in rows} == expected
