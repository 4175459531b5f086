"""Windows and training examples: free of NaN, normalised and back, masked and augmented."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dmae.completion.config import AugmentConfig, MaskingConfig, ModelConfig
from dmae.completion.training_data import (
    PosePair,
    Recipe,
    TrainingBatches,
    augment,
    body_parts,
    mask_bursts,
    mask_scattered,
    masked_rows,
    pose_pair,
)
from dmae.completion.windows import join_rows, make_rows, rest_pose
from dmae.data.clip import Poses3D, Source
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, SHELF14, SKELETONS, Skeleton, get_skeleton
from dmae.numerics.body import body_heading, rotate_z
from dmae.numerics.filling import resample
from tests.support.circling_people import circling_people, clip_of

FRAMES = 15


@pytest.fixture
def rng():
    return np.random.default_rng(3)


@pytest.fixture
def truth(rng):
    return circling_people(60, 3, rng=rng)


@pytest.fixture
def rest(truth):
    return rest_pose(truth.xyz, BODY25)


def without(poses: Poses3D, hidden: np.ndarray) -> Poses3D:
    return Poses3D(poses.skeleton, np.where(hidden[..., None], np.nan, poses.xyz))


def test_windows_contain_measured_joints_only(truth, rest, rng):
    hidden = mask_bursts(60, 3, BODY25, 25.0, MaskingConfig(), rng=rng)
    rows = make_rows(without(truth, hidden), 25.0, rest, FRAMES, truth.xyz)
    windows, true, heading = rows.cut(rows.starts, FRAMES, align_heading=True)
    origin = rows.origin[rows.starts + FRAMES // 2]

    def in_world(xyz: np.ndarray) -> np.ndarray:
        return rotate_z(xyz, heading[:, None, None]) + origin[:, None, None]

    assert all(torch.isfinite(part).all() for part in windows)
    assert not windows.x[~windows.observed].any()
    person, start = np.divmod(rows.starts, 60)
    frame = start[:, None] + np.arange(FRAMES)
    np.testing.assert_array_equal(windows.observed, ~hidden[frame, person[:, None]])
    np.testing.assert_allclose(in_world(true), truth.xyz[frame, person[:, None]], atol=1e-5)
    np.testing.assert_allclose(
        in_world(windows.base.numpy())[windows.observed], in_world(true)[windows.observed], atol=1e-5
    )


def test_hidden_joints_leave_no_trace_in_windows(truth, rest, rng):
    hidden = mask_bursts(60, 3, BODY25, 25.0, MaskingConfig(), rng=rng)
    moved = Poses3D(BODY25, truth.xyz + 5 * hidden[..., None])
    first, second = (make_rows(without(poses, hidden), 25.0, rest, FRAMES) for poses in (truth, moved))
    for a, b in zip(first.cut(first.starts, FRAMES, True)[0], second.cut(second.starts, FRAMES, True)[0], strict=True):
        assert torch.equal(a, b)


def test_windows_are_centred_on_the_mid_hip_and_face_forward(truth, rest):
    rows = make_rows(truth, 25.0, rest, FRAMES)
    windows, _, _ = rows.cut(rows.starts, FRAMES, align_heading=True)
    middle = windows.x[:, FRAMES // 2].numpy()
    np.testing.assert_allclose(middle[:, BODY25.index("mid_hip")[0]], 0, atol=1e-6)
    np.testing.assert_allclose(body_heading(middle, BODY25), 0, atol=1e-5)


@pytest.mark.parametrize("missing", [["mid_hip"], ["mid_hip", "l_hip", "r_hip"], ["mid_hip", "l_shoulder", "r_hip"]])
def test_missing_hips_are_estimated(truth, rest, missing):
    hidden = np.zeros(truth.xyz.shape[:3], bool)
    hidden[:, :, BODY25.index(*missing)] = True
    whole, part = (make_rows(poses, 25.0, rest, FRAMES) for poses in (truth, without(truth, hidden)))
    assert np.linalg.norm(whole.origin - part.origin, axis=-1).max() < 0.15


def test_joints_and_people_never_measured_are_placed(truth, rest):
    hidden = np.zeros(truth.xyz.shape[:3], bool)
    hidden[:, 0, BODY25.index("nose")[0]] = True
    hidden[:, 1, :] = True
    rows = make_rows(without(truth, hidden), 25.0, rest, FRAMES)
    assert np.isfinite(rows.base).all()
    assert not rows.present[60:120].any()
    assert not ((rows.starts >= 60) & (rows.starts < 120)).any()
    nose = BODY25.index("nose")[0]
    assert np.linalg.norm(rows.base[:60, nose] - truth.xyz[:, 0, nose], axis=-1).max() < 0.2


def test_gaps_are_counted_over_the_whole_recording(truth, rest):
    hidden = np.zeros(truth.xyz.shape[:3], bool)
    wrist = BODY25.index("l_wrist")[0]
    hidden[20:50, 0, wrist] = True
    rows = make_rows(without(truth, hidden), 25.0, rest, FRAMES)
    windows, _, _ = rows.cut(np.array([25]), FRAMES, align_heading=True)
    np.testing.assert_array_equal(windows.gap[0, :, wrist, 0], np.arange(6, 21))
    np.testing.assert_array_equal(windows.gap[0, :, wrist, 1], np.arange(25, 10, -1))


def test_short_recordings_are_padded(truth, rest):
    short = Poses3D(BODY25, truth.xyz[:4])
    rows = make_rows(short, 25.0, rest, FRAMES, short.xyz)
    windows, true, _ = rows.cut(rows.starts, FRAMES, align_heading=True)
    assert len(windows.x) == 3
    assert windows.observed[:, :4].all() and not windows.observed[:, 4:].any()
    assert np.isnan(true[:, 4:]).all() and torch.isfinite(windows.base).all()


def test_joined_rows_give_the_same_windows(truth, rest):
    parts = [make_rows(Poses3D(BODY25, truth.xyz[:, p : p + 1]), 25.0, rest, FRAMES) for p in range(3)]
    joined = join_rows(parts)
    windows, _, _ = joined.cut(joined.starts, FRAMES, align_heading=False)
    apart = torch.cat([part.cut(part.starts, FRAMES, align_heading=False)[0].x for part in parts])
    assert torch.equal(windows.x, apart)


def test_rest_pose_faces_forward_and_names_joints_never_known(truth, rest):
    assert abs(body_heading(rest, BODY25)) < 1e-6
    xyz = truth.xyz.copy()
    xyz[:, :, BODY25.index("l_ear")[0]] = np.nan
    with pytest.raises(ValueError, match="l_ear"):
        rest_pose(xyz, BODY25)


@settings(max_examples=20, deadline=None)
@given(st.floats(5, 240))
def test_resampling_keeps_times_and_gaps(fps):
    time = np.arange(50) / 25
    xyz = np.broadcast_to(time[:, None, None, None], (50, 1, 25, 3)).copy()
    xyz[20:30, 0, 4] = np.nan
    poses = resample(Poses3D(BODY25, xyz), 25.0, fps)
    at = np.arange(len(poses.xyz)) / fps
    assert at[-1] <= time[-1] + 1e-6 < at[-1] + 1 / fps + 1e-3
    np.testing.assert_allclose(poses.xyz[:, 0, 0, 0], at, atol=1e-6)
    inside = (at > 19 / 25 + 1e-4) & (at < 30 / 25 - 1e-4)
    assert np.isnan(poses.xyz[inside, 0, 4]).all() and np.isfinite(poses.xyz[at < 19 / 25, 0, 4]).all()


def test_resampling_to_the_same_rate_changes_nothing(truth):
    np.testing.assert_array_equal(resample(truth, 25.0, 25.0).xyz, truth.xyz)


@pytest.mark.parametrize("fps", [10.0, 25.0, 60.0])
def test_poses_without_frames_have_none_at_any_rate(fps):
    assert resample(Poses3D(BODY25, np.empty((0, 2, 25, 3))), 25.0, fps).xyz.shape == (0, 2, 25, 3)


def test_pairs_have_the_rate_and_skeleton_wanted(rng):
    truth = circling_people(120, 2, rng=rng, fps=60.0)
    recording = pose_pair(clip_of(truth, "fast", fps=60.0), SHELF14, 25.0)
    assert recording.captured is None
    assert recording.truth.xyz.shape == (50, 2, 14, 3)
    np.testing.assert_allclose(recording.truth.xyz[5], convert(truth, SHELF14).xyz[12], atol=1e-5)


def test_captured_people_are_in_the_order_of_the_truth(truth, rng):
    """Tracks are in another order, joints are missing, and completed joints were not measured."""
    xyz = truth.xyz[:, [2, 0]] + 0.01
    xyz[5:9, 0, 3] = np.nan
    source = np.where(np.isnan(xyz).any(-1), Source.ABSENT, Source.MEASURED)
    source[20:25, 1, 4] = Source.COMPLETED
    captured = pose_pair(replace(clip_of(truth, "a"), poses=Poses3D(BODY25, xyz, source)), BODY25, 25.0).captured
    assert np.isnan(captured.xyz[:, 1]).all()
    assert np.isnan(captured.xyz[5:9, 2, 3]).all() and np.isnan(captured.xyz[20:25, 0, 4]).all()
    known = ~np.isnan(captured.xyz)
    assert known[:, [0, 2]].mean() > 0.99
    np.testing.assert_allclose(captured.xyz[known], truth.xyz[known] + 0.01, atol=1e-5)


def test_captured_and_true_poses_are_augmented_together(truth, rng):
    recording = PosePair(truth, Poses3D(BODY25, truth.xyz + np.float32(0.05)))
    varied = augment(recording, AugmentConfig(scale=0.0), 25.0, rng=rng)
    offset = np.linalg.norm(varied.captured.xyz - varied.truth.xyz, axis=-1)
    np.testing.assert_allclose(offset, 0.05 * np.sqrt(3), atol=1e-5)


def test_noise_is_correlated_in_time_and_has_the_size_asked_for(rest, rng):
    truth = Poses3D(BODY25, circling_people(400, 40, rng=rng).xyz)
    recipe = Recipe(ModelConfig(), rest, MaskingConfig(bursts=0.0, scattered=0.0), AugmentConfig(noise=0.04))
    rows = masked_rows(PosePair(truth), recipe, rng=rng)
    error = (rows.base - rows.truth).reshape(40, 400, -1)
    assert 0.01 < error.std((1, 2)).mean() < 0.03 and error.std((1, 2)).max() < 0.045
    assert abs((error[:, 1:] * error[:, :-1]).mean() / error.var() - 0.75) < 0.03


def test_augmented_people_keep_their_bones_and_sides(truth, rng):
    bones = np.array(BODY25.bones)

    def lengths(poses):
        return np.linalg.norm(poses.xyz[:, :, bones[:, 0]] - poses.xyz[:, :, bones[:, 1]], axis=-1).mean(0)

    varied = augment(PosePair(truth), AugmentConfig(scale=0.0), 25.0, rng=rng).truth
    np.testing.assert_allclose(lengths(varied), lengths(truth), atol=0.03)
    left, right = BODY25.index("l_wrist", "r_wrist")
    upright = rotate_z(varied.xyz, -body_heading(varied.xyz, BODY25)[..., None])
    assert (upright[:, :, left, 1] > upright[:, :, right, 1]).all()


def test_batches_do_not_depend_on_order(truth, rest):
    def batches():
        recipe = Recipe(ModelConfig(), rest)
        return TrainingBatches([(1.0, [PosePair(truth)])], recipe, seed=5, epoch=1, steps=3, batch=4)

    first, second = batches(), batches()
    backwards = [second[i] for i in (2, 1, 0)][::-1]
    for a, b in zip([first[i] for i in range(3)], backwards, strict=True):
        assert torch.equal(a.windows.x, b.windows.x) and torch.equal(a.truth, b.truth)
    assert not torch.equal(first[0].windows.x, first[1].windows.x)


@pytest.mark.parametrize("replay", [0.1, 0.75])
def test_a_share_of_the_windows_is_replayed(truth, rest, replay):
    """Of a recording whose people are twice as tall."""
    recipe = Recipe(ModelConfig(), rest, augment=AugmentConfig(scale=0.0, noise=0.0))
    tall = replace(truth, xyz=2 * truth.xyz)
    pools = [(1 - replay, [PosePair(truth)]), (replay, [PosePair(tall)])]
    batches = TrainingBatches(pools, recipe, seed=0, epoch=0, steps=10, batch=64)
    ankles, head = BODY25.index("l_ankle", "nose")
    heights = np.concatenate([batches[i].truth.numpy()[..., 2] for i in range(10)])
    heights = (heights[..., head] - heights[..., ankles]).max(1)
    assert abs((heights > 2).mean() - replay) < 0.05


def test_hidden_and_observed_joints_are_those_with_truth(rest, rng):
    xyz = circling_people(60, 2, rng=rng).xyz.copy()
    xyz[:30, 0] = np.nan
    batch = TrainingBatches(
        [(1.0, [PosePair(Poses3D(BODY25, xyz))])], Recipe(ModelConfig(), rest), seed=0, epoch=0, steps=1, batch=64
    )[0]
    assert batch.hidden.any() and batch.observed.any()
    assert not (batch.hidden & batch.windows.observed).any() and not (batch.observed & ~batch.windows.observed).any()
    assert torch.isfinite(batch.truth).all()
    unknown = ~(batch.hidden | batch.observed)
    assert unknown.any()


@pytest.mark.parametrize("skeleton", ["body25", "shelf14", "body25+shelf14"])
def test_bursts_take_parts_of_every_skeleton(skeleton, rng):
    skeleton = get_skeleton(skeleton)
    assert all(len(part) for part in body_parts(skeleton))
    hidden = mask_bursts(500, 2, skeleton, 25.0, MaskingConfig(longest=20, bursts=5.0), rng=rng)
    assert 0.1 < hidden.mean() < 0.7
    assert hidden.any((0, 1)).all()


def test_every_joint_but_the_neck_is_masked_with_its_part():
    for skeleton in SKELETONS.values():
        masked = {skeleton.joints[joint] for part in body_parts(skeleton) for joint in part}
        assert set(skeleton.joints) - masked <= {"neck"}


def test_joints_without_known_names_are_masked_one_by_one():
    assert body_parts(Skeleton("odd", ("a", "b"), (-1, 0))) == [[0], [1]]


def test_scattered_masking_has_the_shares_asked_for(rng):
    hidden = mask_scattered((400, 5, 25), 0.5, 0.5, rng=rng)
    assert abs(hidden.mean() - 0.75) < 0.03
    assert abs(hidden.all(-1).mean() - 0.5) < 0.05


@pytest.mark.parametrize("wrong", [{"joints": 1.5}, {"longest": 1}, {"bursts": -1.0}])
def test_impossible_masking_is_refused(wrong):
    with pytest.raises(ValueError, match="masking"):
        MaskingConfig(**wrong)


def test_truth_of_a_fused_skeleton_is_sliced(truth, rng):
    fused = get_skeleton("body25+shelf14")
    both = Poses3D(fused, np.concatenate([truth.xyz, convert(truth, SHELF14).xyz], 2))
    np.testing.assert_array_equal(convert(both, BODY25).xyz, truth.xyz)
