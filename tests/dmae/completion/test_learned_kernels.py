"""Learned kernels: their file, their predictions, and how they are learned."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from dmae.completion.fillings import fill_pchip_body
from dmae.completion.gaussian_process import fill_gaussian_process, finished
from dmae.completion.kernel_fitting import Episode, FitConfig, episodes_of, fit, predictions, table_of
from dmae.completion.learned_kernels import (
    Exactness,
    KernelSet,
    Limbs,
    Torsos,
    blending_weight,
    body_sizes,
    covariance,
    fill_both,
    fill_gaussian_process_learned,
    fill_with,
    load_kernels,
    predict,
    shipped_kernels,
)
from dmae.data.clip import Poses3D
from dmae.data.skeleton import BODY25
from dmae.numerics import body
from dmae.numerics.paths import pchip
from tests.support.circling_people import circling_people
from tests.support.gaps import without

FPS = 25.0
ELBOW, WRIST = BODY25.index("l_elbow", "l_wrist")


@pytest.fixture(scope="module")
def kernels() -> KernelSet:
    return shipped_kernels()


def circling(hidden: slice = slice(60, 90), joints=(ELBOW, WRIST)) -> tuple[Poses3D, Poses3D]:
    """Return a circling person with one arm hidden, and the truth."""
    truth = circling_people(200, 1, rng=np.random.default_rng(0))
    return without(truth, hidden, 0, list(joints)), truth


def episodes(kernels: KernelSet) -> list[Episode]:
    return list(episodes_of(*circling(), FPS, kernels.bones, 60))


def test_what_is_learned_with_is_what_predicts(kernels):
    """By torch, on tensors of many gaps, and by NumPy."""
    found = episodes(kernels)
    table = table_of(
        {("true", "arm", 2): found}, FitConfig(training_poses=60, queries=40), rng=np.random.default_rng(0)
    )
    kernel = kernels.kernels["l_shoulder", Exactness.exact]
    weights = torch.tensor([kernel.weights.get(name, 0.0) for name in table.names])
    parameters = {name: torch.tensor(value) for name, value in kernel.parameters.items()}
    by_torch = predictions(table, torch.arange(len(found)), weights, parameters)
    for row, episode in enumerate(found):
        by_numpy = predict(episode.problem, kernel).offset
        np.testing.assert_allclose(by_torch[row, : len(by_numpy)], by_numpy, atol=2e-3)


def test_learning_lowers_the_error(kernels):
    _, losses = fit(
        table_of({("true", "arm", 2): episodes(kernels)}, FitConfig(), rng=np.random.default_rng(0)),
        ("l_shoulder", Exactness.exact),
        FitConfig(steps=30, batch=2),
    )
    assert np.mean(losses[-5:]) < 0.8 * np.mean(losses[:5])


def test_kernels_come_back_from_their_file(kernels, tmp_path):
    kernels.save(tmp_path / "kernels.json")
    assert load_kernels(tmp_path / "kernels.json") == kernels
    assert all(len(kernel.weights) + len(kernel.parameters) < 100 for kernel in kernels.kernels.values())


@pytest.mark.parametrize("text", ["[]", "{}", '{"format": 9}', '{"format": 1, "kernels": [{"anchor": "x"}]}'])
def test_other_files_are_refused(text, tmp_path):
    (tmp_path / "kernels.json").write_text(text)
    with pytest.raises(ValueError, match="not a file of kernels"):
        load_kernels(tmp_path / "kernels.json")


def test_the_covariance_is_that_of_a_process(kernels):
    """Positive definite, and greatest at the pose itself."""
    rng = np.random.default_rng(0)
    poses, seconds = rng.normal(size=(40, 6)), rng.uniform(0, 9, 40)
    squared = ((poses[:, None] - poses) ** 2).sum(-1)
    apart = np.abs(seconds[:, None] - seconds)
    for kernel in kernels.kernels.values():
        found = covariance(squared, apart, kernel.parameters)
        assert np.linalg.eigvalsh(found).min() > -1e-9
        assert found.max() == pytest.approx(covariance(0.0, 0.0, kernel.parameters))


def test_it_counts_as_far_as_it_predicts_the_persons_other_frames(kernels):
    """An arm that swings is predicted, one that is where chance puts it is not."""
    kernel = kernels.kernels["l_shoulder", Exactness.exact]
    problem = next(episode.problem for episode in episodes(kernels) if episode.problem.gap.joint == ELBOW)
    assert blending_weight(problem, predict(problem, kernel)) > 0.8
    given, _ = circling()
    slow = np.random.default_rng(1).normal(0, 0.1, (200, 1, 3)).cumsum(0)
    xyz = given.xyz.copy()
    xyz[:, :, [ELBOW, WRIST]] += slow[:, :, None]
    bodies = body.interpolate_bodies(xyz.astype(np.float64), BODY25, FPS, pchip)
    walking = next(Limbs(Poses3D(BODY25, xyz), bodies, FPS, kernels.bones).problems(ELBOW, 60))
    assert 0 <= blending_weight(walking, predict(walking, kernel)) < 0.8


def test_a_hidden_arm_keeps_swinging(kernels):
    given, truth = circling()
    by_kernels, by_cubics = (
        np.linalg.norm(poses.xyz - truth.xyz, axis=-1)[60:90, 0, WRIST].mean()
        for poses in (fill_with(given, FPS, kernels), fill_pchip_body(given, FPS))
    )
    assert by_kernels < 0.5 * by_cubics


def test_a_joint_with_a_parent_that_was_never_measured_is_filled(kernels):
    given, _ = circling(joints=(WRIST,))
    xyz = given.xyz.copy()
    xyz[:, :, ELBOW] = np.nan
    poses = Poses3D(BODY25, xyz)
    filled = fill_gaussian_process_learned(poses, FPS)
    np.testing.assert_array_equal(filled.source, fill_pchip_body(poses, FPS).source)
    assert (fill_with(poses, FPS, kernels).source == filled.source).all()


def test_sizes_are_those_of_the_bones(kernels):
    truth = circling_people(20, 2, rng=np.random.default_rng(0)).xyz.astype(np.float64)
    sizes = body_sizes(truth, BODY25, kernels.bones)
    np.testing.assert_allclose(body_sizes(truth * 1.3, BODY25, kernels.bones), 1.3 * sizes, rtol=1e-6)
    assert (body_sizes(np.full((5, 1, 25, 3), np.nan), BODY25, kernels.bones) == 1).all()


# The torso: where hidden hips and shoulders are, by the joints around them.

TORSO_FPS = 25.0
GAP = slice(60, 90)
HIPS = BODY25.index("mid_hip", "l_hip", "r_hip")
SHOULDER, TORSO_ELBOW, TORSO_WRIST = BODY25.index("l_shoulder", "l_elbow", "l_wrist")
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
    bodies = body.interpolate_bodies(poses.xyz.astype(np.float64), BODY25, TORSO_FPS, pchip, poses.rays)
    return list(Torsos(poses, bodies, TORSO_FPS, shipped_kernels().bones).problems(joint, 60))


def error(poses: Poses3D, truth: Poses3D, joints: list[int]) -> float:
    return float(np.linalg.norm(poses.xyz - truth.xyz, axis=-1)[GAP, 0][:, joints].mean())


def test_knees_say_where_hips_are():
    given, truth = leaning(HIPS)
    plain, mixed = fill_gaussian_process(given, TORSO_FPS), fill_gaussian_process_learned(given, TORSO_FPS)
    by_kernels = fill_with(given, TORSO_FPS, shipped_kernels())
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
    given, _ = leaning([SHOULDER, TORSO_ELBOW, TORSO_WRIST])
    (problem,) = problems(given, SHOULDER)
    assert not {SHOULDER, TORSO_ELBOW} & set(problem.inputs)


def test_a_torso_without_an_anchor_is_left_to_interpolation():
    given, _ = leaning([joint for joint in range(25) if joint != KNEE])
    assert problems(given, LEFT) == []
    plain, learned = fill_gaussian_process(given, TORSO_FPS), fill_gaussian_process_learned(given, TORSO_FPS)
    np.testing.assert_allclose(learned.xyz[:, :, HIPS], plain.xyz[:, :, HIPS], atol=1e-6)


def test_single_cameras_that_see_a_joint_say_more():
    given, truth = leaning(HIPS)
    rays = np.full((*given.xyz.shape[:3], 2, 3), np.nan)
    for hip in HIPS:
        rays[GAP, :, hip, 0] = truth.xyz[GAP, :, hip] - [1, 0, 0]
        rays[GAP, :, hip, 1] = [1, 0, 0]
    seen = Poses3D(BODY25, given.xyz, rays=rays)
    plain, learned = fill_gaussian_process(seen, TORSO_FPS), fill_gaussian_process_learned(seen, TORSO_FPS)
    np.testing.assert_allclose(learned.xyz[GAP, :, HIPS], plain.xyz[GAP, :, HIPS], atol=1e-6)


def test_noisy_poses_are_filled_as_by_one_kernel():
    given, _ = leaning(HIPS)
    noise = np.random.default_rng(0).normal(0, 0.03, given.xyz.shape)
    noisy = Poses3D(BODY25, given.xyz + noise)
    plain, learned = fill_gaussian_process(noisy, TORSO_FPS), fill_gaussian_process_learned(noisy, TORSO_FPS)
    np.testing.assert_array_equal(learned.xyz, plain.xyz)


@pytest.mark.parametrize("exactness", Exactness)
def test_kernels_of_hips_and_shoulders_are_shipped(exactness):
    for name in ("neck-mid_hip", "neck-l_hip", "neck-l_shoulder"):
        assert (name, exactness) in shipped_kernels().kernels


def test_frames_asked_for_are_filled_as_in_the_whole_recording():
    """Through gaps that end before, overlap, or reach into gaps of joints that hang from them."""
    truth = circling_people(200, 2, rng=np.random.default_rng(2))
    given = without(truth, slice(20, 40), 0, [TORSO_WRIST])
    for frames, joints in ((slice(95, 130), [TORSO_ELBOW]), (slice(120, 150), [TORSO_WRIST]), (GAP, HIPS)):
        given = without(given, frames, 0, joints)
    asked = slice(140, 160)
    plain, learned = finished(fill_both(given, TORSO_FPS, asked))
    whole = fill_gaussian_process_learned(given, TORSO_FPS)
    np.testing.assert_array_equal(plain.xyz, fill_gaussian_process(given, TORSO_FPS).xyz)
    np.testing.assert_array_equal(learned.xyz[asked], whole.xyz[asked])
    hidden = ~given.measured[asked]
    assert (learned.xyz[asked] != plain.xyz[asked])[hidden].any()
    assert not np.array_equal(learned.xyz[20:40], whole.xyz[20:40]), "that gap is left to the plain process"
