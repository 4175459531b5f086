"""Completion of unusual poses: few measurements, other skeletons and rates, joints that are not finite."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.commands import complete as command
from dmae.commands.complete import CompleteCommand
from dmae.completion.methods.linear import fill_linear
from dmae.completion.pipeline import SMOOTHING
from dmae.completion.uncertainty import CLASSES
from dmae.completion.weights import save_model
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, COCO17, SHELF14, Skeleton
from dmae.data.store import load_clip, save_clip
from tests.support.circling_people import circling_people, clip_of
from tests.support.completers import FPS, circling, untrained, with_holes

HIPS = SHELF14.index("l_hip", "r_hip")


def deviation(poses: Poses3D) -> np.ndarray:
    """Return standard deviations (F, P, J) m, NaN where unknown."""
    return np.sqrt(poses.cov[..., 0, 0])


def test_a_person_seen_for_one_frame_is_completed_in_it_alone():
    xyz = np.full_like(circling(0).xyz, np.nan)
    xyz[30, 1, :3] = circling(0).xyz[30, 1, :3]
    poses = Poses3D(SHELF14, xyz)
    done = untrained(factors=((1.0,) * CLASSES,) * 2)(poses, FPS)
    assert np.argwhere((done.source != Source.ABSENT).any(-1)).tolist() == [[30, 1]]
    assert (done.source[30, 1, 3:] == Source.COMPLETED).all()
    assert np.linalg.norm(done.xyz[30, 1] - xyz[30, 1, 0], axis=-1).max() < 2.5
    assert np.isfinite(deviation(done)[30, 1, 3:]).all()


def test_joints_never_measured_take_their_own_factor():
    poses = circling(1, frames=12)
    xyz = poses.xyz.copy()
    xyz[:, :, HIPS] = np.nan
    xyz[4:6, :, 0] = np.nan
    known, doubted = (
        untrained(factors=((1.0, 1.0, 1.0, 1.0, last),) * 2)(Poses3D(SHELF14, xyz), FPS) for last in (1.0, 5.0)
    )
    assert (doubted.source[:, :, HIPS] == Source.COMPLETED).all()
    np.testing.assert_allclose(deviation(doubted)[:, :, HIPS], 5 * deviation(known)[:, :, HIPS], rtol=1e-5)
    np.testing.assert_array_equal(deviation(doubted)[4:6, :, 0], deviation(known)[4:6, :, 0])
    assert np.linalg.norm(doubted.xyz - poses.xyz, axis=-1).max() < 0.5


@pytest.mark.parametrize("fps", [FPS, 50.0])
def test_far_from_any_measurement_covariances_are_unknown(fps):
    xyz = circling(3).xyz.copy()
    xyz[20:44, 0] = np.nan
    done = untrained(factors=((1.0,) * CLASSES,) * 2)(Poses3D(SHELF14, xyz), fps)
    assert (done.source[20:44, 0] == Source.COMPLETED).all()
    near = round(0.2 * fps)
    expected = np.r_[np.ones(near), np.zeros(24 - 2 * near), np.ones(near)].astype(bool)
    np.testing.assert_array_equal(np.isfinite(deviation(done)[20:44, 0]).all(-1), expected)
    np.testing.assert_array_equal(np.isfinite(deviation(done)[20:44, 0]).any(-1), expected)


def test_poses_without_measurements_stay_absent():
    poses = Poses3D(SHELF14, np.full((9, 2, 14, 3), np.nan))
    assert not untrained()(poses, FPS).source.any()
    assert not untrained()(poses, 60.0).source.any()


def test_joints_that_are_not_finite_are_absent_and_completed():
    truth = circling(4)
    xyz = truth.xyz.copy()
    xyz[10, 0, 3], xyz[11, 0, 3, 1] = np.inf, -np.inf
    hidden = truth.xyz.copy()
    hidden[10:12, 0, 3] = np.nan
    done, expected = (untrained()(Poses3D(SHELF14, joints), FPS) for joints in (xyz, hidden))
    assert (done.source[10:12, 0, 3] == Source.COMPLETED).all()
    np.testing.assert_array_equal(done.xyz, expected.xyz)


def test_joints_that_are_not_finite_are_absent_where_the_weights_lack_them():
    xyz = convert(circling_people(30, 1, rng=np.random.default_rng(0)), COCO17).xyz.copy()
    shoulder, nose = COCO17.index("l_shoulder", "nose")
    xyz[10, 0, shoulder], xyz[10, 0, nose] = np.inf, -np.inf
    source = untrained()(Poses3D(COCO17, xyz), FPS).source[10, 0]
    assert source[shoulder] == Source.COMPLETED and source[nose] == Source.ABSENT


@pytest.mark.parametrize("fps", [0.0, -25.0, np.nan, np.inf])
def test_impossible_frame_rates_are_refused(fps):
    with pytest.raises(ValueError, match="fps must be positive, found"):
        untrained()(circling(0), fps)


def test_contradicted_joints_are_rejected_on_request():
    """Joints of three views are kept."""
    truth = circling(6)
    xyz, views = truth.xyz.copy(), np.full(truth.source.shape, 2)
    xyz[30, 0, 6] += 0.4
    xyz[30, 1, 6] += 0.4
    views[:, 1] = 3
    poses = Poses3D(SHELF14, xyz, views=views)
    done = replace(untrained(), reject=True)(poses, FPS)
    assert np.argwhere(done.source == Source.COMPLETED).tolist() == [[30, 0, 6]]
    assert np.linalg.norm(done.xyz[30, 0, 6] - truth.xyz[30, 0, 6]) < 0.2
    assert done.views[30, 0, 6] == 0
    np.testing.assert_array_equal(untrained()(poses, FPS).xyz, xyz)


def test_poses_of_another_skeleton_are_completed_through_common_joints():
    """The weights do not have the face of COCO."""
    truth = circling_people(60, 2, rng=np.random.default_rng(0))
    hidden = np.zeros(truth.source.shape, bool)
    hidden[20:26, :, BODY25.index("l_wrist")], hidden[20:26, :, BODY25.index("nose")] = True, True
    poses = convert(truth.without(hidden), COCO17)
    done = untrained()(poses, FPS)
    wrist, nose = COCO17.index("l_wrist", "nose")
    assert done.skeleton == COCO17
    assert (done.source[20:26, :, wrist] == Source.COMPLETED).all()
    assert not done.source[20:26, :, nose].any()
    assert done.xyz[poses.measured].tobytes() == poses.xyz[poses.measured].tobytes()
    (note,) = untrained().notes(poses, FPS)
    assert note == (
        "poses are coco17, completed with weights for shelf14; not completed: nose, l_eye, r_eye, l_ear, r_ear"
    )


def test_completed_joints_stay_where_the_weights_lack_them():
    truth = circling_people(60, 2, rng=np.random.default_rng(0))
    hidden = np.zeros(truth.source.shape, bool)
    hidden[20:26] = True
    hidden[:, :, BODY25.index("neck")] = False
    poses = fill_linear(convert(truth.without(hidden), COCO17), FPS)
    done = untrained()(poses, FPS)
    nose = COCO17.index("nose")[0]
    np.testing.assert_array_equal(done.xyz[:, :, nose], poses.xyz[:, :, nose])
    assert (done.source[20:26, :, nose] == Source.COMPLETED).all()


def test_poses_that_have_nothing_in_common_with_the_weights_are_refused():
    tail = Skeleton("lizard", ("tail", "tongue"), (-1, 0))
    with pytest.raises(ValueError, match=r"weights are for skeleton 'shelf14', the poses are 'lizard'.*train"):
        untrained()(Poses3D(tail, np.zeros((3, 1, 2, 3))), FPS)


@pytest.mark.parametrize("fps", [5.0, 240.0])
def test_another_frame_rate_is_resampled_with_a_note(tmp_path, capsys, fps):
    poses = with_holes(circling(8), 8)
    save_clip(replace(clip_of(poses, "walk", fps), poses=poses), tmp_path / "clip")
    save_model(untrained().model, SHELF14, tmp_path / "model", {"denoises": False, "calibration": None})
    command.run(CompleteCommand(str(tmp_path / "clip"), str(tmp_path / "model")), tmp_path / "out")
    assert f"walk: {fps:g} frames/s, resampled to the 25 of the weights and back" in capsys.readouterr().out
    done = load_clip(tmp_path / "out").poses
    # By default the command rejects and smooths; weights that were not trained to denoise do not.
    expected = replace(untrained(), reject=True, smooth=SMOOTHING)(poses, fps)
    np.testing.assert_array_equal(done.xyz, expected.xyz)


def test_there_are_no_notes_at_the_rate_of_the_weights():
    assert untrained().notes(circling(0), FPS) == []
