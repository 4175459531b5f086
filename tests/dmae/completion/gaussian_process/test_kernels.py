"""Learned kernels: their file, their predictions, and how they are learned."""

import numpy as np
import pytest
import torch

from dmae.completion.gaussian_process.episodes import Episode, episodes_of
from dmae.completion.gaussian_process.fitting import FitConfig, fit, predictions, table_of
from dmae.completion.gaussian_process.kernels import (
    Exactness,
    KernelSet,
    covariance,
    load_kernels,
    shipped_kernels,
)
from dmae.completion.gaussian_process.limbs import body_sizes
from dmae.completion.gaussian_process.problems import Limbs
from dmae.completion.gaussian_process.regression import blending_weight, predict
from dmae.completion.methods.gaussian_process_learned import fill_gaussian_process_learned, fill_with
from dmae.completion.methods.pchip_body import fill_pchip_body
from dmae.data.clip import Poses3D
from dmae.data.skeleton import BODY25
from dmae.numerics.body import interpolate_bodies
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
    bodies = interpolate_bodies(xyz.astype(np.float64), BODY25, FPS, pchip)
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
