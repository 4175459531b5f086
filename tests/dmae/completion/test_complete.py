"""Completion: measured joints stay, absent ones are filled, and errors name their cause."""

import json
import shutil
from dataclasses import fields, replace

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import dmae
from dmae.commands import complete as command
from dmae.commands.config import CompleteCommand
from dmae.completion import pieces
from dmae.completion.complete import CLASSES, load_completer
from dmae.completion.config import (
    SMOOTHING,
    AugmentConfig,
    MaskingConfig,
    TrainConfig,
)
from dmae.completion.fillings import fill_linear, fill_pchip_body
from dmae.completion.pose_prior import pose_covariance
from dmae.completion.training import train
from dmae.completion.weights import save_model
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, COCO17, SHELF14, Skeleton
from dmae.data.store import load_clip, save_clip
from dmae.metrics.position import REGION_RADIUS
from dmae.numerics.filling import fill_world, present, resample
from dmae.numerics.paths import pchip
from tests.support.circling_people import circling_people, clip_of
from tests.support.completers import FPS, circling, untrained, with_holes
from tests.support.training import SMALL_NETWORK, changed

pytestmark = pytest.mark.slow

LEARNING = changed(
    TrainConfig(),
    model=SMALL_NETWORK,
    masking=MaskingConfig(longest=20, scattered=0.0, bursts=3.0),
    augment=AugmentConfig(speed=0.0, scale=0.03),
    skeleton="shelf14",
    steps=100,
    batch=8,
    lr=5e-3,
    held_back=0.4,
)
"""Without changes of speed and size, steps repeat, and the network learns in seconds to correct the interpolation."""


@pytest.fixture(scope="module")
def clips():
    rng = np.random.default_rng(0)
    return [clip_of(circling_people(100, 3, rng=rng), f"clip{i}") for i in range(5)]


@pytest.fixture(scope="module")
def trained(clips, tmp_path_factory):
    return train(LEARNING, clips, tmp_path_factory.mktemp("model"))


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 1000), st.booleans())
def test_measured_joints_stay_to_the_bit_and_present_people_are_complete(seed, residual):
    poses = with_holes(circling(seed), seed)
    done = untrained(residual)(poses, FPS)
    assert done.xyz[poses.measured].tobytes() == poses.xyz[poses.measured].tobytes()
    there = np.broadcast_to(present(poses, FPS)[..., None], poses.source.shape)
    np.testing.assert_array_equal(done.source == Source.COMPLETED, there & ~poses.measured)
    np.testing.assert_array_equal(done.source == Source.ABSENT, ~there)
    invented = done.source == Source.COMPLETED
    assert np.isnan(done.cov[invented]).all() and not done.views[invented].any()
    assert np.linalg.norm(done.xyz[invented], axis=-1).max() < 6


@pytest.mark.slow
def test_completion_beats_linear_and_the_interpolation_it_corrects(trained):
    completer = load_completer(trained)
    errors = {"completed": [], "interpolated": [], "linear": []}
    for seed in range(5):
        truth = circling(100 + seed, frames=100)
        poses = with_holes(truth, seed)
        lines = fill_linear(poses, FPS)
        scored = lines.source == Source.COMPLETED
        for name, filled in zip(errors, (completer(poses, FPS), fill_pchip_body(poses, FPS), lines), strict=True):
            errors[name].append(np.linalg.norm(filled.xyz - truth.xyz, axis=-1)[scored])
    mean = {name: np.concatenate(values).mean() for name, values in errors.items()}
    assert mean["completed"] < 0.9 * mean["interpolated"]
    assert mean["completed"] < 0.5 * mean["linear"]


@pytest.mark.parametrize("fps", [FPS, 60.0])
def test_only_completed_joints_get_a_covariance_and_it_scales_with_its_factor(fps):
    poses = with_holes(circling(8), 8)
    poses = replace(poses, cov=np.where(poses.measured[..., None, None], 1e-4 * np.eye(3), np.nan))
    once, twice = (untrained(factors=((factor,) * CLASSES,) * 2)(poses, fps) for factor in (1.0, 2.0))
    np.testing.assert_array_equal(once.cov[poses.measured], poses.cov[poses.measured])
    np.testing.assert_array_equal(np.isnan(once.cov).any((-2, -1)), once.source == Source.ABSENT)
    invented = once.source == Source.COMPLETED
    assert (np.linalg.eigvalsh(once.cov[invented]) > 0).all()
    np.testing.assert_allclose(twice.cov[invented], 4 * once.cov[invented], rtol=1e-5)
    assert len(np.unique(once.cov[invented][:, 0, 0])) > 100


def test_regions_of_90_percent_hold_about_90_percent_of_other_clips(trained):
    completer = load_completer(trained)
    inside = []
    for seed in range(5):
        truth = circling(200 + seed, frames=100)
        done = completer(with_holes(truth, seed), FPS)
        invented = done.source == Source.COMPLETED
        distance = np.linalg.norm(done.xyz - truth.xyz, axis=-1) / np.sqrt(done.cov[..., 0, 0])
        inside.append((distance <= REGION_RADIUS)[invented & np.isfinite(distance)])
    assert 0.8 < np.concatenate(inside).mean() < 0.97


@settings(max_examples=8, deadline=None)
@given(st.permutations(range(3)))
def test_permuting_persons_permutes_the_answer(order):
    poses = with_holes(circling(1), 1)
    permuted = Poses3D(SHELF14, poses.xyz[:, order])
    completer = untrained()
    np.testing.assert_allclose(completer(permuted, FPS).xyz, completer(poses, FPS).xyz[:, order], atol=1e-5)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 3), st.floats(-5, 5), st.floats(-5, 5))
def test_turning_and_moving_the_world_turns_and_moves_the_answer(quarters, dx, dy):
    """By quarter turns: the cubics of the interpolation are monotone in each coordinate."""
    poses = with_holes(circling(2), 2)
    cos, sin = ((1, 0), (0, 1), (-1, 0), (0, -1))[quarters]
    R = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
    completer = untrained()
    moved = completer(Poses3D(SHELF14, poses.xyz @ R.T + (dx, dy, 0)), FPS)
    np.testing.assert_allclose(moved.xyz, completer(poses, FPS).xyz @ R.T + (dx, dy, 0), atol=1e-4)


def test_people_are_not_filled_outside_their_track_or_in_long_absences():
    xyz = circling(3, frames=120).xyz.copy()
    xyz[:10, 0], xyz[110:, 0], xyz[40:90, 0], xyz[95:105, 0] = np.nan, np.nan, np.nan, np.nan
    xyz[:, 1] = np.nan
    source = untrained()(Poses3D(SHELF14, xyz), FPS).source[..., 0]
    assert not source[:10, 0].any() and not source[110:, 0].any() and not source[40:90, 0].any()
    assert (source[95:105, 0] == Source.COMPLETED).all()
    assert not source[:, 1].any()


def test_completed_joints_are_no_evidence():
    poses = with_holes(circling(4), 4)
    wrong = replace(fill_linear(poses, FPS), cov=np.zeros((*poses.source.shape, 3, 3)))
    wrong = replace(wrong, xyz=np.where((wrong.source == Source.COMPLETED)[..., None], 99, wrong.xyz))
    completer = untrained()
    np.testing.assert_array_equal(completer(wrong, FPS).xyz, completer(poses, FPS).xyz)


def test_denoising_moves_and_marks_measured_joints(clips, tmp_path):
    config = changed(LEARNING, steps=300, observed_weight=1.0, augment=AugmentConfig(noise=0.03))
    truth = circling(5, frames=100)
    noisy = Poses3D(SHELF14, truth.xyz + np.random.default_rng(0).normal(0, 0.02, truth.xyz.shape))
    done = load_completer(train(config, clips, tmp_path), denoise=True)(noisy, FPS)
    assert (done.source == Source.DENOISED).all()
    before, after = (np.linalg.norm(poses.xyz - truth.xyz, axis=-1).mean() for poses in (noisy, done))
    assert after < 0.9 * before


def test_joints_of_three_views_are_not_denoised():
    truth = circling(5, frames=60)
    noisy = truth.xyz + np.random.default_rng(0).normal(0, 0.02, truth.xyz.shape)
    views = np.random.default_rng(1).integers(2, 5, truth.source.shape)
    poses = Poses3D(SHELF14, noisy, views=views)
    done = untrained(denoise=True)(poses, FPS)
    np.testing.assert_array_equal(done.source == Source.DENOISED, views < 3)
    np.testing.assert_array_equal(done.xyz[views >= 3], poses.xyz[views >= 3])
    assert (done.xyz != poses.xyz).any(-1)[views < 3].mean() > 0.9


@pytest.mark.parametrize("fps", [5.0, 30.0, 60.0, 240.0])
def test_other_frame_rates(trained, fps):
    truth = convert(circling_people(int(4 * fps), 2, rng=np.random.default_rng(6), fps=fps), SHELF14)
    hidden = np.zeros(truth.xyz.shape[:3], bool)
    hidden[int(1.5 * fps) : int(1.9 * fps), :, SHELF14.index("l_wrist", "l_elbow")] = True
    poses = Poses3D(SHELF14, np.where(hidden[..., None], np.nan, truth.xyz))
    done = load_completer(trained)(poses, fps)
    assert ((done.source == Source.COMPLETED) == hidden).all()
    error = np.linalg.norm(done.xyz - truth.xyz, axis=-1)[hidden].mean()
    linear = np.linalg.norm(fill_linear(poses, fps).xyz - truth.xyz, axis=-1)[hidden].mean()
    assert error < linear


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.integers(0, 12), st.integers(0, 3), st.floats(0, 1), st.integers(0, 1000), st.booleans())
def test_any_gaps_are_filled(frames, persons, share, seed, residual):
    rng = np.random.default_rng(seed)
    truth = circling(seed, frames=max(frames, 1), persons=max(persons, 1))
    xyz = truth.xyz[:frames, :persons].copy()
    xyz[rng.random(xyz.shape[:3]) < share] = np.nan
    poses = Poses3D(SHELF14, xyz)
    done = untrained(residual)(poses, FPS)
    assert done.xyz.shape == xyz.shape
    assert not np.isnan(done.xyz[present(poses, FPS)]).any()


def test_copied_weights_give_the_same_result(trained, tmp_path):
    poses = with_holes(circling(7), 7)
    shutil.copytree(trained, tmp_path / "copy")
    first, second = (load_completer(folder)(poses, FPS) for folder in (trained, tmp_path / "copy"))
    np.testing.assert_array_equal(first.xyz, second.xyz)


def test_bad_weights_are_named(trained, tmp_path):
    with pytest.raises(FileNotFoundError, match=r"dmae train.*model\.json"):
        load_completer(tmp_path)
    folder = tmp_path / "broken"
    shutil.copytree(trained, folder)
    path = folder / "weights.safetensors"
    path.write_bytes(path.read_bytes()[:-8])
    with pytest.raises(ValueError, match=r"weights\.safetensors: does not match the checksum"):
        load_completer(folder)
    (folder / "model.json").write_text("{")
    with pytest.raises(ValueError, match=r"model\.json: expected JSON"):
        load_completer(folder)
    shutil.copy(trained / "model.json", folder / "model.json")
    shutil.copy(trained / "weights.safetensors", path)
    for change, complaint in (
        ({"format": 1}, "format 5, found 1; train it again"),
        ({"format": 99}, "format 5, found 99"),
        ({"model": {"depht": 3}}, "not a model of this version"),
    ):
        meta = json.loads((trained / "model.json").read_text()) | change
        (folder / "model.json").write_text(json.dumps(meta))
        with pytest.raises(ValueError, match=complaint):
            load_completer(folder)


def test_denoising_with_a_model_not_trained_for_it_is_refused(tmp_path):
    save_model(untrained().model, SHELF14, tmp_path, {"denoises": False, "calibration": None})
    with pytest.raises(ValueError, match="observed_weight"):
        load_completer(tmp_path, denoise=True)


def test_the_last_frame_of_a_person_is_completed_at_another_rate_too():
    """The frame after it, at the rate of the weights, has no correction."""
    complete, truth = untrained(factors=((1.0,) * CLASSES,) * 2), circling(3, 60)
    hidden = np.zeros(truth.source.shape, bool)
    hidden[40:], hidden[34:, :, SHELF14.index("l_wrist", "l_elbow")] = True, True
    poses = Poses3D(SHELF14, np.where(hidden[..., None], np.nan, truth.xyz))
    done, own = complete(resample(poses, FPS, 2 * FPS), 2 * FPS), complete(poses, FPS)
    filled = done.source == Source.COMPLETED
    assert np.isfinite(done.cov[filled]).all() and filled[78].any()
    np.testing.assert_allclose(done.xyz[78][filled[78]], own.xyz[39][filled[78]], atol=0.03)


# Completion of unusual poses: few measurements, other skeletons and rates, joints that are not finite.

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
    # How far off a joint is that was never measured is not known from a glimpse.
    assert np.isnan(deviation(done)[30, 1, 3:]).all()


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


@pytest.mark.parametrize("fps", [FPS, 2 * FPS, 4 * FPS])
@pytest.mark.parametrize(("frames", "known"), [(8, False), (12, True)])
def test_from_less_time_than_a_window_lasts_nobody_knows_how_far_off_a_joint_is(frames, known, fps):
    """Windows are 9 frames long at the rate of the model."""
    xyz = circling(1, frames=round(frames * fps / FPS)).xyz.copy()
    xyz[:, :, HIPS] = np.nan
    done = untrained(factors=((1.0,) * CLASSES,) * 2)(Poses3D(SHELF14, xyz), fps)
    assert (done.source[:, :, HIPS] == Source.COMPLETED).all()
    assert (np.isfinite(deviation(done)[:, :, HIPS]) == known).all()


def test_how_far_off_a_leg_is_that_nobody_ever_saw_is_unknown():
    xyz = circling(1, frames=30).xyz.copy()
    xyz[:, 0, SHELF14.index("l_knee", "l_ankle")] = np.nan
    xyz[:, 1, SHELF14.index("l_hip", "r_ankle")] = np.nan
    done = untrained(factors=((1.0,) * CLASSES,) * 2)(Poses3D(SHELF14, xyz), FPS)
    assert (done.source != Source.ABSENT).all()
    assert np.isnan(deviation(done)[:, 0, SHELF14.index("l_knee", "l_ankle")]).all()
    # The knee inside of the ankle, and the knee outside of the hip, say where those are.
    assert np.isfinite(deviation(done)[:, 1, SHELF14.index("l_hip", "r_ankle")]).all()


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


@pytest.mark.parametrize("unit", [1000, 100])
def test_poses_in_another_unit_are_refused(unit):
    poses = circling(0)
    with pytest.raises(ValueError, match=r"expected coordinates in m, found bones of .* m; divide those in mm by 1000"):
        untrained()(replace(poses, xyz=poses.xyz * unit), FPS)


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
    np.testing.assert_array_equal(np.argwhere(done.rejected), [[30, 0, 6]])
    assert done.views[30, 0, 6] == 2
    np.testing.assert_array_equal(untrained()(poses, FPS).xyz, xyz)


def test_joints_with_large_stated_errors_are_rejected_only_where_the_gap_stays_short():
    """Two cameras measure some joints badly throughout: completed without any measurement they would be farther off."""
    poses = circling(6)
    cov = np.broadcast_to(1e-4 * np.eye(3), (*poses.xyz.shape, 3)).copy()
    cov[:, 0, 4] = cov[20:30, 0, 7] = 0.1**2 * np.eye(3)  # the whole of one joint, 0.4 s of another
    done = replace(untrained(), reject=True)(Poses3D(SHELF14, poses.xyz, cov=cov), FPS)
    assert (done.source[:, 0, 4] == Source.MEASURED).all()
    assert (done.source[20:30, 0, 7] == Source.COMPLETED).all()
    assert (done.source == Source.COMPLETED).sum() == 10


@pytest.mark.parametrize("reject", [True, False])
@pytest.mark.parametrize("cause", ["contradicted", "large stated error"])
def test_the_command_says_how_many_measured_joints_it_replaces(tmp_path, capsys, reject, cause):
    poses = circling(6)
    xyz = poses.xyz.copy()
    cov = np.broadcast_to(1e-4 * np.eye(3), (*xyz.shape, 3)).copy()
    if cause == "contradicted":
        xyz[30, 0, 6] += 0.4
    else:
        cov[30, 0, 6] = np.eye(3)
    poses = Poses3D(SHELF14, xyz, cov=cov, views=np.full(poses.source.shape, 2))
    save_clip(replace(clip_of(poses, "walk"), poses=poses), tmp_path / "clip")
    save_model(untrained().model, SHELF14, tmp_path / "model", {"denoises": False, "calibration": None})
    command.run(CompleteCommand(str(tmp_path / "clip"), str(tmp_path / "model"), reject=reject), tmp_path / "out")
    share = 1 / poses.measured.sum()
    printed = capsys.readouterr().out
    said = f"walk: 1 measured joint ({share:.1%}) contradicted the frames around or stated a larger error" in printed
    assert said == reject
    assert (load_clip(tmp_path / "out").poses.source[30, 0, 6] == Source.COMPLETED) == reject


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
    assert (
        f"walk: joints keep their {fps:g} frames/s; corrections of the network are made at 25/s"
        in capsys.readouterr().out
    )
    done = load_clip(tmp_path / "out").poses
    # By default the command rejects and smooths; weights that were not trained to denoise do not.
    expected = replace(untrained(), reject=True, smooth=SMOOTHING)(poses, fps)
    np.testing.assert_array_equal(done.xyz, expected.xyz)


@pytest.mark.parametrize("online", [False, True])
def test_what_was_completed_before_is_not_smoothed_again(tmp_path, capsys, online):
    save_model(untrained().model, SHELF14, tmp_path / "model", {"denoises": False, "calibration": None})
    once = dmae.complete(with_holes(circling(8), 8), FPS, weights=tmp_path / "model", online=online)
    again = dmae.complete(once, FPS, weights=tmp_path / "model", online=online)
    np.testing.assert_array_equal(again.xyz, once.xyz)
    save_clip(replace(clip_of(once, "walk"), poses=once), tmp_path / "clip")
    command.run(CompleteCommand(str(tmp_path / "clip"), str(tmp_path / "model"), online=online), tmp_path / "out")
    np.testing.assert_array_equal(load_clip(tmp_path / "out").poses.xyz, once.xyz)
    assert ("these joints stay as they are" in capsys.readouterr().out) == (once.source == Source.DENOISED).any()


def test_there_are_no_notes_at_the_rate_of_the_weights():
    assert untrained().notes(circling(0), FPS) == []


# Long recordings in pieces: each frame is completed once, with 20 s on both sides, at any rate.


def recording(frames: int, persons: int = 2) -> Poses3D:
    """Smooth paths with gaps."""
    rng = np.random.default_rng(0)
    time = np.arange(frames)[:, None, None, None] / 25
    xyz = np.sin(time * rng.uniform(0.5, 2, (persons, 14, 3)) + rng.uniform(0, 6, (persons, 14, 3)))
    xyz[rng.random(xyz.shape[:-1]) < 0.3] = np.nan
    return Poses3D(SHELF14, xyz)


@pytest.mark.parametrize(("frames", "fps"), [(4001, 25.0), (9000, 29.97), (13_000, 120.0), (5000, 1.0), (6000, 0.05)])
def test_pieces_cover_all_frames_with_their_surroundings(frames, fps):
    given, covered = [], []
    for inner, around in pieces._parts(frames, fps, range(frames)):
        given.append(around.stop - around.start)
        covered += range(inner.start, inner.stop)
        assert around.start in (0, *range(inner.start - round(20 * fps) + 1)) and around.start >= 0
        assert around.stop == frames or around.stop >= inner.stop + 20 * fps
    assert covered == list(range(frames))
    assert max(given) <= max(pieces.WHOLE, 61 * fps)


def test_short_recordings_are_completed_whole():
    poses, calls = recording(300), []
    pieces.in_pieces(lambda *given: calls.append(given) or poses, poses, 25.0, slice(10, 20))
    assert calls == [(poses, 25.0, slice(10, 20))]


@pytest.mark.parametrize("asked", [slice(None), slice(700, 1900), slice(120, 130)])
def test_pieces_give_what_the_whole_gives(asked, monkeypatch):
    """Of a method that looks no farther than 20 s."""
    poses = recording(2200)
    whole = fill_world(poses, 25.0, pchip).select(asked)
    monkeypatch.setattr(pieces, "WHOLE", 1000)
    monkeypatch.setattr(pieces, "_PIECE", 1250)
    sizes = []

    def complete(given: Poses3D, fps: float, frames: slice) -> Poses3D:
        sizes.append(given.source.shape[:2])
        return fill_world(given, fps, pchip).select(frames)

    found = pieces.in_pieces(complete, poses, 25.0, asked)
    for name in (field.name for field in fields(Poses3D)[1:]):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name), name)
    assert {persons for _, persons in sizes} == {1} and max(count for count, _ in sizes) < len(poses.xyz)


def test_in_pieces_people_stand_on_the_floor_that_others_show(monkeypatch):
    """The floor is 0.4 m below z = 0, and nobody ever saw the legs of the second person."""
    completer, truth = untrained(), circling(0, 1600, persons=2)
    rest = completer.model.rest.numpy()
    completer.model.pose_covariance.copy_(torch.from_numpy(pose_covariance(truth.xyz, SHELF14, rest)))
    legs, ankles = SHELF14.index("l_knee", "r_knee", "l_ankle", "r_ankle"), SHELF14.index("l_ankle", "r_ankle")
    xyz = truth.xyz - np.float32([0, 0, 0.4])
    xyz[:, 1, legs] = np.nan
    lower = []
    for frames in (4000, 300):
        monkeypatch.setattr(pieces, "WHOLE", frames)
        monkeypatch.setattr(pieces, "_PIECE", frames)
        done = completer(Poses3D(SHELF14, xyz), FPS).xyz
        lower.append(done[:, :, ankles, 2].min(-1).mean(0))
    np.testing.assert_allclose(lower[1], lower[0], atol=0.01)
    assert abs(lower[1][1] - lower[1][0]) < 0.1


def test_nobody(monkeypatch):
    monkeypatch.setattr(pieces, "WHOLE", 10)
    poses = recording(5000, persons=0)
    assert pieces.in_pieces(lambda given, fps, frames: given.select(frames), poses, 25.0).xyz.shape == (5000, 0, 14, 3)
