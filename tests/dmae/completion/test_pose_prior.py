"""Single frames completed by the Gaussian of poses: against a closed form, and what may not change them."""

from dataclasses import replace

import numpy as np
import torch

from dmae.completion.complete import load_completer
from dmae.completion.pose_prior import floor_height, likely_pose, lower_ankles, pose_covariance, stand_on_floor
from dmae.completion.weights import find_shipped
from dmae.completion.windows import rest_pose
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14
from dmae.numerics.body import rotate_z
from tests.support.circling_people import circling_people
from tests.support.completers import circling, untrained

WALK = circling(0, 200)
REST = rest_pose(WALK.xyz, SHELF14)
COVARIANCE = pose_covariance(WALK.xyz, SHELF14, REST)
ARM = SHELF14.index("l_elbow", "l_wrist")


def hidden(poses: Poses3D, joints=ARM) -> Poses3D:
    xyz = poses.xyz.copy()
    xyz[:, :, joints] = np.nan
    return Poses3D(poses.skeleton, xyz)


def test_a_pose_is_the_conditional_mean_of_the_gaussian():
    """Of a person who faces +x, and whose place is known only by the joints: differences from one joint."""
    frame = hidden(Poses3D(SHELF14, REST[None, None]))
    frame.xyz[0, 0, SHELF14.index("r_wrist")] += (0.1, 0.2, 0.3)
    found = likely_pose(frame, REST, COVARIANCE)[0, 0]
    seen = np.repeat(np.isin(np.arange(len(SHELF14)), ARM, invert=True), 3)
    prior = COVARIANCE + 100 * np.kron(np.ones((len(SHELF14),) * 2), np.eye(3))
    noisy = prior[np.ix_(seen, seen)] + 0.02**2 * np.eye(seen.sum())
    off = (frame.xyz[0, 0].astype(float) - REST).reshape(-1)[seen]
    wanted = REST.reshape(-1)[~seen] + prior[np.ix_(~seen, seen)] @ np.linalg.solve(noisy, off)
    np.testing.assert_allclose(found[ARM].reshape(-1), wanted, atol=1e-4)


def test_people_like_those_learned_from_are_completed_nearer_than_by_the_rest_pose():
    truth = circling(3, 40)
    error = {}
    for name, covariance in {"rest": np.zeros_like(COVARIANCE), "learned": COVARIANCE}.items():
        found = likely_pose(hidden(truth), REST, covariance)
        error[name] = np.linalg.norm(found - truth.xyz, axis=-1)[:, :, ARM].mean()
    assert error["learned"] < 0.7 * error["rest"]


def test_people_who_are_moved_and_turned_are_completed_likewise():
    truth = circling(3, 10)
    angle, shift = np.full(truth.xyz.shape[:3], 2.0), (3.0, -40.0, 0.5)
    moved = Poses3D(SHELF14, rotate_z(truth.xyz, angle) + shift)
    expected = rotate_z(likely_pose(hidden(truth), REST, COVARIANCE), angle) + shift
    np.testing.assert_allclose(likely_pose(hidden(moved), REST, COVARIANCE), expected, atol=1e-4)


def test_a_joint_that_one_camera_detected_is_near_its_ray():
    truth = circling(3, 10)
    center = np.array([0.0, 0.0, 6.0])
    along = truth.xyz[:, :, ARM] - center
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    rays = np.full((*truth.xyz.shape[:3], 2, 3), np.nan)
    rays[:, :, ARM, 0], rays[:, :, ARM, 1] = center, along
    alone, found = (
        likely_pose(poses, REST, COVARIANCE)[:, :, ARM]
        for poses in (hidden(truth), replace(hidden(truth), rays=rays.astype(np.float32)))
    )
    off = found - center
    across = np.linalg.norm(off - (off * along).sum(-1, keepdims=True) * along, axis=-1)
    assert across.max() < 0.03
    error = [np.linalg.norm(each - truth.xyz[:, :, ARM], axis=-1).mean() for each in (alone, found)]
    assert error[1] < error[0]


def test_measured_joints_stay_and_persons_without_any_stay_absent():
    completer = untrained(denoise=True)
    completer.model.pose_covariance.copy_(torch.from_numpy(COVARIANCE))
    poses = hidden(circling(5, 4))
    poses.xyz[1, 0] = np.nan
    given = Poses3D(SHELF14, poses.xyz)
    done = completer(given, 0.5)
    np.testing.assert_array_equal(done.xyz[given.measured], given.xyz[given.measured])
    assert (done.source[1, 0] == Source.ABSENT).all()
    assert (done.source[0][:, ARM] == Source.COMPLETED).all()
    np.testing.assert_array_equal(done.xyz[0], completer(given.select(slice(0, 1)), 25.0).xyz[0])


def test_the_shipped_weights_know_how_bodies_vary():
    truth = convert(circling_people(8, 3, rng=np.random.default_rng(2)), BODY25)
    completer, part = load_completer(find_shipped(BODY25)), BODY25.index("l_knee", "l_ankle", "l_heel")
    done = completer(hidden(truth, part), 0.5).xyz
    completer.model.pose_covariance.zero_()
    rest = completer(hidden(truth, part), 0.5).xyz
    error = [np.linalg.norm(xyz - truth.xyz, axis=-1)[:, :, part].mean() for xyz in (done, rest)]
    assert error[0] < 0.9 * error[1]


LEGS = SHELF14.index("l_knee", "l_ankle", "r_knee", "r_ankle")
ANKLES = list(SHELF14.index("l_ankle", "r_ankle"))
NO_LEGS = np.isin(np.arange(len(SHELF14)), LEGS)


def sunk(depth: float) -> np.ndarray:
    """(20, 14, 3) a person whose lower ankle is so far below the floor, m, as if one sat with straight legs."""
    xyz = circling(0, 20).xyz[:, 0].astype(float)
    xyz[..., 2] -= xyz[:, ANKLES, 2].min() + depth
    return xyz


def test_feet_that_were_never_seen_are_on_the_floor():
    """As poses vary in the shipped weights: knees and ankles of somebody whose hips are 0.4 m lower than standing."""
    covariance = load_completer(find_shipped(BODY25)).model.pose_covariance.numpy()
    xyz = convert(Poses3D(SHELF14, sunk(0.4)[:, None].astype(np.float32)), BODY25).xyz[:, 0]
    ankles = list(BODY25.index("l_ankle", "r_ankle"))
    unknown = np.array([joint.endswith(("knee", "ankle", "toe", "heel")) for joint in BODY25.joints])
    found = stand_on_floor(xyz, unknown, 0.0, BODY25, covariance)
    assert np.abs(found[:, ankles, 2].min(1) - 0.07).max() < 0.03
    np.testing.assert_array_equal(found[:, ~unknown], xyz[:, ~unknown])


def test_the_floor_is_where_measured_feet_are():
    def floor(poses: Poses3D) -> float:
        return floor_height(lower_ankles(poses))

    poses = circling(0, 40)
    lower = np.median(poses.xyz[:, :, ANKLES, 2].min(-1))
    raised = replace(poses, xyz=poses.xyz + np.array((0, 0, 2.5), np.float32))
    np.testing.assert_allclose(floor(raised) - floor(poses), 2.5, atol=1e-5)
    np.testing.assert_allclose(floor(poses), lower - 0.07, atol=1e-6)
    assert floor(hidden(raised, LEGS)) == 0


def test_a_floor_moves_and_turns_with_the_world_and_off_it_nothing_moves():
    xyz, angle = sunk(0.3), np.full((20, 14), 2.0)
    expected = rotate_z(stand_on_floor(xyz, NO_LEGS, 0.0, SHELF14, COVARIANCE), angle) + (3, -40, 0.5)
    moved = rotate_z(xyz, angle) + (3, -40, 0.5)
    np.testing.assert_allclose(stand_on_floor(moved, NO_LEGS, 0.5, SHELF14, COVARIANCE), expected, atol=1e-6)
    for floor in (5.0, -0.8):
        np.testing.assert_array_equal(stand_on_floor(moved, NO_LEGS, floor, SHELF14, COVARIANCE), moved)


def test_legs_seen_once_or_on_a_ray_stay_as_the_network_has_them(monkeypatch):
    """Of a person without legs in all frames but one; and of one whose ankles a single camera sees."""
    completer = load_completer(find_shipped(BODY25))
    truth = convert(circling(0, 20), BODY25)
    legs = BODY25.index("l_knee", "l_ankle", "r_knee", "r_ankle", "l_heel", "r_heel", "l_big_toe", "r_big_toe")
    lowered = replace(truth, xyz=truth.xyz - np.array((0, 0, 0.3), np.float32))
    never = completer(hidden(lowered, legs), 25.0)
    once = hidden(lowered, legs)
    once.xyz[3] = lowered.xyz[3]
    once = completer(Poses3D(BODY25, once.xyz), 25.0)
    monkeypatch.setattr("dmae.completion.complete.stand_on_floor", lambda xyz, *_: xyz)
    straight = completer(hidden(lowered, legs), 25.0)
    ankles = list(BODY25.index("l_ankle", "r_ankle"))
    assert np.nanmin(straight.xyz[..., ankles, 2]) < -0.1 < 0 < np.nanmin(never.xyz[..., ankles, 2])
    assert np.nanmin(once.xyz[..., ankles, 2]) < -0.1
