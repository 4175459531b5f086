"""The torso: where hidden hips and shoulders are, by the joints around them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmae.completion.gaussian_process.kernels import Exactness, shipped_kernels
from dmae.completion.gaussian_process.steps import finished
from dmae.completion.gaussian_process.torso import Torsos
from dmae.completion.methods.gaussian_process import fill_gaussian_process
from dmae.completion.methods.gaussian_process_learned import (
    fill_both,
    fill_gaussian_process_learned,
    fill_with,
)
from dmae.data.clip import Poses3D
from dmae.data.skeleton import BODY25
from dmae.numerics.body import interpolate_bodies
from dmae.numerics.paths import pchip
from tests.support.circling_people import circling_people
from tests.support.gaps import without

FPS = 25.0
GAP = slice(60, 90)
HIPS = BODY25.index("mid_hip", "l_hip", "r_hip")
SHOULDER, ELBOW, WRIST = BODY25.index("l_shoulder", "l_elbow", "l_wrist")
NECK, LEFT, RIGHT, MIDDLE, KNEE = BODY25.index("neck", "l_hip", "r_hip", "mid_hip", "l_knee")
LOWER = ("hip", "knee", "ankle", "toe", "heel")


def leaning(joints: list[int]) -> tuple[Poses3D, Poses3D]:
    """Return a person with an upper body that leans to and fro, joints of it hidden for a while; and the truth."""
    xyz = circling_people(200, 1, rng=np.random.default_rng(0)).xyz.astype(np.float64)
    across = xyz[:, 0, LEFT] - xyz[:, 0, RIGHT]
    axis = across / np.linalg.norm(across, axis=-1, keepdims=True)
    lean = Rotation.from_rotvec(axis * 0.4 * np.sin(np.arange(200) / 7.0)[:, None]).as_matrix()
    above = [i for i, joint in enumerate(BODY25.joints) if not any(part in joint for part in LOWER)]
    hip = xyz[:, :, [MIDDLE]]
    xyz[:, :, above] = hip + np.einsum("fij,fpkj->fpki", lean, xyz[:, :, above] - hip)
    truth = Poses3D(BODY25, xyz)
    return without(truth, GAP, 0, joints), truth


def problems(poses: Poses3D, joint: int):
    bodies = interpolate_bodies(poses.xyz.astype(np.float64), BODY25, FPS, pchip, poses.rays)
    return list(Torsos(poses, bodies, FPS, shipped_kernels().bones).problems(joint, 60))


def error(poses: Poses3D, truth: Poses3D, joints: list[int]) -> float:
    return float(np.linalg.norm(poses.xyz - truth.xyz, axis=-1)[GAP, 0][:, joints].mean())


def test_knees_say_where_hips_are():
    given, truth = leaning(HIPS)
    plain, mixed = fill_gaussian_process(given, FPS), fill_gaussian_process_learned(given, FPS)
    by_kernels = fill_with(given, FPS, shipped_kernels())
    assert error(by_kernels, truth, HIPS) < 0.3 * error(plain, truth, HIPS)
    # Bones of these people stretch a little, so that they count as noisy in part.
    assert error(by_kernels, truth, HIPS) < error(mixed, truth, HIPS) < 0.9 * error(plain, truth, HIPS)


def test_inputs_hang_from_the_anchor_where_their_parents_are_hidden():
    given, _ = leaning(HIPS)
    (problem,) = problems(given, LEFT)
    assert (problem.gap.anchor, problem.kernel) == (NECK, "neck-l_hip")
    assert not set(problem.inputs) & {*HIPS, NECK}
    place = problem.inputs.index(KNEE)
    xyz = given.xyz.astype(np.float64)[problem.frames, 0]
    distance = np.linalg.norm(xyz[:, KNEE] - xyz[:, NECK], axis=-1) / problem.size
    np.testing.assert_allclose(np.linalg.norm(problem.known[:, place], axis=-1), distance, rtol=1e-6)


def test_what_is_hidden_with_a_joint_and_hangs_from_it_is_no_input():
    given, _ = leaning([SHOULDER, ELBOW, WRIST])
    (problem,) = problems(given, SHOULDER)
    assert not {SHOULDER, ELBOW} & set(problem.inputs)


def test_a_torso_without_an_anchor_is_left_to_interpolation():
    given, _ = leaning([joint for joint in range(25) if joint != KNEE])
    assert problems(given, LEFT) == []
    plain, learned = fill_gaussian_process(given, FPS), fill_gaussian_process_learned(given, FPS)
    np.testing.assert_allclose(learned.xyz[:, :, HIPS], plain.xyz[:, :, HIPS], atol=1e-6)


def test_single_cameras_that_see_a_joint_say_more():
    given, truth = leaning(HIPS)
    rays = np.full((*given.xyz.shape[:3], 2, 3), np.nan)
    for hip in HIPS:
        rays[GAP, :, hip, 0] = truth.xyz[GAP, :, hip] - [1, 0, 0]
        rays[GAP, :, hip, 1] = [1, 0, 0]
    seen = Poses3D(BODY25, given.xyz, rays=rays)
    plain, learned = fill_gaussian_process(seen, FPS), fill_gaussian_process_learned(seen, FPS)
    np.testing.assert_allclose(learned.xyz[GAP, :, HIPS], plain.xyz[GAP, :, HIPS], atol=1e-6)


def test_noisy_poses_are_filled_as_by_one_kernel():
    given, _ = leaning(HIPS)
    noise = np.random.default_rng(0).normal(0, 0.03, given.xyz.shape)
    noisy = Poses3D(BODY25, given.xyz + noise)
    plain, learned = fill_gaussian_process(noisy, FPS), fill_gaussian_process_learned(noisy, FPS)
    np.testing.assert_array_equal(learned.xyz, plain.xyz)


@pytest.mark.parametrize("exactness", Exactness)
def test_kernels_of_hips_and_shoulders_are_shipped(exactness):
    for name in ("neck-mid_hip", "neck-l_hip", "neck-l_shoulder"):
        assert (name, exactness) in shipped_kernels().kernels


def test_frames_asked_for_are_filled_as_in_the_whole_recording():
    """Through gaps that end before, overlap, or reach into gaps of joints that hang from them."""
    truth = circling_people(200, 2, rng=np.random.default_rng(2))
    given = without(truth, slice(20, 40), 0, [WRIST])
    for frames, joints in ((slice(95, 130), [ELBOW]), (slice(120, 150), [WRIST]), (GAP, HIPS)):
        given = without(given, frames, 0, joints)
    asked = slice(140, 160)
    plain, learned = finished(fill_both(given, FPS, asked))
    whole = fill_gaussian_process_learned(given, FPS)
    np.testing.assert_array_equal(plain.xyz, fill_gaussian_process(given, FPS).xyz)
    np.testing.assert_array_equal(learned.xyz[asked], whole.xyz[asked])
    hidden = ~given.measured[asked]
    assert (learned.xyz[asked] != plain.xyz[asked])[hidden].any()
    assert not np.array_equal(learned.xyz[20:40], whole.xyz[20:40]), "that gap is left to the plain process"
