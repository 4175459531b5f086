import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dmae.completion.methods.pchip_body import fill_pchip_body
from dmae.completion.methods.reject import fill_reject_pchip
from dmae.completion.rejection import contradicted
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25
from dmae.evaluation.synthetic_gaps import GapConfig, cut_gaps, perturb
from tests.support.circling_people import circling_people
from tests.support.clips import t_pose
from tests.support.gaps import FPS, turning


def turning_at(fps: float) -> Poses3D:
    """Three seconds of a T-pose that turns, once in six."""
    time = np.arange(round(3 * fps)) / fps
    R = Rotation.from_rotvec(np.outer(2 * np.pi * time / 6, (0, 0, 1))).as_matrix()
    return Poses3D(BODY25, np.einsum("fij,kj->fki", R, t_pose())[:, None])


@pytest.mark.parametrize("fps", [5.0, 25.0, 240.0])
def test_an_outlier_is_dropped_filled_and_marked_completed(fps):
    truth = turning_at(fps)
    wrist, frame = BODY25.index("r_wrist")[0], len(truth.xyz) // 2
    xyz = truth.xyz.copy()
    off = 1.5 if fps == 5 else 0.3
    xyz[frame, 0, wrist] += (0, 0, off)
    found = fill_reject_pchip(Poses3D(BODY25, xyz, views=np.full(xyz.shape[:3], 3)), fps)
    assert np.argwhere(found.source == Source.COMPLETED).tolist() == [[frame, 0, wrist]]
    assert found.views[frame, 0, wrist] == 0
    assert np.linalg.norm(found.xyz - truth.xyz, axis=-1).max() < 0.03
    kept = np.delete(found.xyz, frame, 0)
    np.testing.assert_array_equal(kept, np.delete(xyz, frame, 0))


def test_outliers_of_several_frames_are_found():
    truth = turning()
    xyz = truth.xyz.copy()
    xyz[30:33, 0, 4] += (0.4, 0, 0)
    found = contradicted(xyz, FPS)
    assert np.argwhere(found).tolist() == [[frame, 0, 4] for frame in (30, 31, 32)]


def test_vigorous_motion_is_not_contradicted():
    """A hand moves in a circle of 25 cm one and a half times a second, with gaps in its path."""
    time = np.arange(100) / FPS
    phase = 2 * np.pi * 1.5 * time
    xyz = np.stack([0.25 * np.cos(phase), 0.25 * np.sin(phase), 0 * time], -1)[:, None, None]
    assert not contradicted(xyz, FPS).any()
    xyz[np.random.default_rng(0).random(100) < 0.2] = np.nan
    assert not contradicted(xyz, FPS).any()


def test_samples_at_the_ends_are_never_contradicted():
    xyz = turning().xyz.copy()
    xyz[0] += 0.5
    xyz[40:] += 0.5
    found = contradicted(xyz, FPS)
    assert not found[[0, 59]].any()


def test_rejection_brings_perturbed_poses_nearer_the_truth():
    """Strolling people with correlated noise, drift and outliers."""
    rng = np.random.default_rng(0)
    truth = circling_people(250, 4, rng=rng)
    poses = perturb(cut_gaps(truth, FPS, GapConfig(bursts=2.0), rng=rng), FPS, rng=rng)
    gone = contradicted(poses.xyz, FPS)
    off = np.linalg.norm(poses.xyz - truth.xyz, axis=-1)
    assert (off[gone] > 0.05).mean() > 0.6
    assert gone[off > 0.2].mean() > 0.6
    plain, without_them = fill_pchip_body(poses, FPS), fill_reject_pchip(poses, FPS)
    errors = [np.linalg.norm(found.xyz - truth.xyz, axis=-1).mean() for found in (plain, without_them)]
    assert errors[1] < errors[0]
