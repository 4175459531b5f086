from dataclasses import replace

import numpy as np

from dmae.completion.fillings import fill_kalman, smooth_paths
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25
from tests.support.clips import walkers
from tests.support.gaps import FPS, turning, without


def test_smoother_equals_the_solution_of_one_linear_system():
    """The states of twelve frames are solved for at once."""
    rng = np.random.default_rng(0)
    frames, density, dt = 12, 2.0, 0.04
    root = 0.02 * rng.normal(size=(frames, 1, 3, 3))
    cov = root @ root.swapaxes(-1, -2) + 1e-4 * np.eye(3)
    xyz = 0.05 * np.cumsum(rng.normal(size=(frames, 1, 3)), 0)
    xyz[[4, 5, 6, 9, 11]] = np.nan
    mean, spread = smooth_paths(xyz, cov, 1 / dt, np.array([density]))
    move = np.kron([[1, dt], [0, 1]], np.eye(3))
    stir = np.linalg.inv(density * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], np.eye(3)))
    weights, sums = np.zeros((6 * frames, 6 * frames)), np.zeros(6 * frames)
    # The smoother starts from the first measurement, with standard deviations of 10 m and 2 m/s.
    weights[:6, :6] = np.kron(np.diag([1 / 100, 1 / 4]), np.eye(3))
    sums[:3] = xyz[0, 0] / 100
    for frame in range(frames):
        step = np.zeros((6, 6 * frames))
        step[:, 6 * frame : 6 * frame + 6] = np.eye(6)
        if frame:
            step[:, 6 * frame - 6 : 6 * frame] = -move
            weights += step.T @ stir @ step
        if not np.isnan(xyz[frame, 0, 0]):
            where = slice(6 * frame, 6 * frame + 3)
            weights[where, where] += np.linalg.inv(cov[frame, 0])
            sums[where] += np.linalg.inv(cov[frame, 0]) @ xyz[frame, 0]
    whole = np.linalg.inv(weights)
    expected = (whole @ sums).reshape(frames, 6)[:, :3]
    np.testing.assert_allclose(mean[:, 0], expected, atol=1e-9)
    for frame in range(frames):
        where = slice(6 * frame, 6 * frame + 3)
        np.testing.assert_allclose(spread[frame, 0], whole[where, where], atol=1e-9)


def test_measurements_are_denoised_by_their_covariances():
    """Noise is 5 cm along one axis and 2 mm along the others, as the covariances say."""
    rng = np.random.default_rng(0)
    truth = walkers(frames=60, persons=1)
    deviation = np.array([0.002, 0.05, 0.002])
    xyz = truth.xyz + deviation * rng.normal(size=truth.xyz.shape)
    poses = Poses3D(BODY25, xyz, cov=np.tile(np.diag(deviation**2), (60, 1, 25, 1, 1)))
    found = fill_kalman(poses, FPS)
    assert (found.source == Source.DENOISED).all()
    before, after = (np.sqrt(((p.xyz - truth.xyz) ** 2).mean((0, 1, 2))) for p in (poses, found))
    assert after[1] < 0.5 * before[1]
    assert (after < before).all()


def test_covariances_grow_within_gaps_and_hold_the_truth():
    """Largest in the middle of the gap; 90 % regions hold more than 90 % of the truth."""
    rng = np.random.default_rng(0)
    truth = walkers(frames=200, persons=4)
    poses = Poses3D(BODY25, truth.xyz + 0.02 * rng.normal(size=truth.xyz.shape))
    wrist = BODY25.index("l_wrist")[0]
    found = fill_kalman(without(poses, slice(100, 121), 0, wrist), FPS)
    deviation = np.sqrt(found.cov[..., 0, 0])
    hole = deviation[99:122, 0, wrist]
    assert hole.argmax() == 11
    assert hole.max() > 4 * deviation[50, 0, wrist]
    assert (found.source[100:121, 0, wrist] == Source.COMPLETED).all()
    assert (deviation[found.measured] < 0.02).all()
    off = (found.xyz - truth.xyz).astype(np.float64)
    inside = np.einsum("...i,...ij,...j", off, np.linalg.inv(found.cov.astype(np.float64)), off) < 6.251
    # An even walk accelerates less than the model expects.
    assert inside.mean() > 0.9


def test_an_unknown_covariance_is_taken_as_two_centimetres():
    poses = turning()
    known = replace(poses, cov=np.tile(0.02**2 * np.eye(3), (60, 1, 25, 1, 1)))
    infinite = replace(poses, cov=np.full((60, 1, 25, 3, 3), np.inf))
    for other in (known, infinite):
        np.testing.assert_allclose(fill_kalman(poses, FPS).xyz, fill_kalman(other, FPS).xyz, atol=1e-6)
