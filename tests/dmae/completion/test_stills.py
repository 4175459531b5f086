"""Single frames completed by the Gaussian of poses: against a closed form, and what may not change them."""

from dataclasses import replace

import numpy as np
import torch

from dmae.completion.complete import load_completer
from dmae.completion.stills import likely_pose, pose_covariance
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
