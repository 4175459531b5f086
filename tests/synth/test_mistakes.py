"""The detector's effects one by one, each apart from the others, and the truth of what it says."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.clip import JointError, Poses3D, Visibility
from dmae.skeleton import BODY25, SHELF14
from synth.mistakes import DetectorConfig, PartConfig
from synth.mistakes.errors import height

from .detecting import CLEAN, by_person, everywhere, run

NOISY = PartConfig(noise=0.01, tail=3, score=[8, 2], miss=[0.1, 0.5, 0.5, 0.5])
ALL = PartConfig(miss=[0, 0, 0, 0])
BUSY = everywhere(NOISY, leg_inversion=0.1, swap=0.2, ghosts=1.0, person_miss=0.05, together=0.5, score_knows=0.4)


def heights(true_xy) -> np.ndarray:
    """(F, V, P, 1, 1) px."""
    return np.stack([height(xy) for xy in np.moveaxis(true_xy, 1, 0)], 1)[..., None, None]


def noise(truth, seen, rig, true_xy, config, seed=0) -> np.ndarray:
    """(F, V, P, 25, 2) errors, px."""
    return by_person(run(truth, seen, rig, config, seed))[0] - true_xy


@pytest.mark.parametrize(
    "change",
    [
        {"ghosts": 0.0}, {"ghost_joints": 0.7}, {"ghost_score": [2.0, 2.0]}, {"drop_repeats": True},
        {"merge_rest": 0.1},
    ],
)  # fmt: skip
def test_effects_on_whole_detections_leave_the_people_as_they_are(truth, seen, rig, change):
    one, other = (by_person(run(truth, seen, rig, config)) for config in (BUSY, replace(BUSY, **change)))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    "change",
    [
        {"person_miss": 0.0}, {"hanging": 0.9}, {"leg_inversion": 0.0}, {"arm_inversion": 0.2}, {"swap": 0.0},
        {"merge": 0.7}, {"split": 0.2}, {"drop": 0.2}, {"person_miss_hidden": 0.5},
    ],
)  # fmt: skip
def test_an_effect_more_or_less_leaves_the_draws_of_all_others(truth, seen, rig, change):
    """Most joints stay where they are, to the last bit, and only some come, go or are taken for others."""
    (one, one_score), (other, other_score) = (
        by_person(run(truth, seen, rig, config)) for config in (BUSY, replace(BUSY, **change))
    )
    both = np.isfinite(one_score) & np.isfinite(other_score)
    same = (one[both] == other[both]).all(-1) & (one_score[both] == other_score[both])
    assert same.mean() > 0.7
    assert not same.all() or np.isfinite(one_score).sum() != np.isfinite(other_score).sum()


def test_ghosts_do_not_depend_on_what_happens_to_people(truth, seen, rig):
    def ghosts(config):
        found = run(truth, seen, rig, config)
        return np.sort(found.detections.xy[found.detected_error == JointError.GHOST], axis=0)

    wild = replace(BUSY, merge=0.5, hanging=1.0, leg_inversion=0.5, swap=0.9, person_miss=0.5)
    np.testing.assert_array_equal(ghosts(BUSY), ghosts(wild))


def test_a_bias_or_a_louder_noise_changes_neither_misses_nor_the_luck_of_errors(truth, seen, rig, true_xy):
    quiet, loud = (everywhere(replace(NOISY, noise=noise), score_knows=0.0) for noise in (0.002, 0.004))
    a, b = (noise(truth, seen, rig, true_xy, config) for config in (quiet, loud))
    both = np.isfinite(a) & np.isfinite(b)
    assert both.sum() > 0.99 * np.isfinite(a).sum()
    np.testing.assert_allclose(b[both], 2 * a[both], atol=2e-3)


def test_detectors_mean_other_points_than_annotators(truth, seen, rig, true_xy):
    part = PartConfig(miss=[0, 0, 0, 0], offset=[0.1, 0.2])
    off = noise(truth, seen, rig, true_xy, everywhere(part))
    left, right, neck, hips, nose = BODY25.index("l_hip", "r_hip", "neck", "mid_hip", "nose")
    trunk = true_xy[..., hips, :] - true_xy[..., neck, :]
    wide = true_xy[..., left, :] - true_xy[..., right, :]
    known = np.isfinite(off).all((-1, -2))
    np.testing.assert_allclose(off[known][:, nose], 0.2 * trunk[known], atol=1e-2)
    np.testing.assert_allclose(off[known][:, left], 0.2 * trunk[known] + 0.1 * wide[known], atol=1e-2)
    np.testing.assert_allclose(off[known][:, right], 0.2 * trunk[known] - 0.1 * wide[known], atol=1e-2)


def test_a_view_s_offset_is_that_of_all_people_at_all_times(truth, seen, rig, true_xy):
    off = noise(truth, seen, rig, true_xy, everywhere(ALL, view_offset=0.02)) / heights(true_xy)
    constant = np.nanmean(off, (0, 2))
    assert np.nanmax(np.abs(off - constant[:, None])) < 1e-4
    assert 0.014 < constant.std() < 0.026


@pytest.mark.parametrize(
    ("field", "low", "high"),
    [
        ("least_noise", 0.0, 3.0),
        ("blur", 0.0, 30.0),
        ("guess_noise", 1.0, 3.0),
        ("bias", 0.0, 0.9),
        ("correlation", 0.05, 1),
    ],
)
def test_errors_grow_with_what_they_are_said_to_grow_with(truth, seen, rig, true_xy, field, low, high):
    part = PartConfig(noise=0.002, tail=30, miss=[0, 0, 0, 0])
    a, b = (noise(truth, seen, rig, true_xy, everywhere(part, **{field: value})) for value in (low, high))
    if field == "bias":
        always = np.isfinite(a).all(0) & np.isfinite(b).all(0)
        assert (b.mean(0)[always] ** 2).mean() > 3 * (a.mean(0)[always] ** 2).mean()
    elif field == "correlation":
        assert np.nanmean(np.diff(a, axis=0) ** 2) > 3 * np.nanmean(np.diff(b, axis=0) ** 2)
    elif field == "guess_noise":
        # The first person's left joints are hidden, the third's are not.
        left = BODY25.index("l_wrist", "l_knee", "l_ankle")
        assert np.nanstd(b[..., 0, left, :]) > 2.5 * np.nanstd(a[..., 0, left, :])
        np.testing.assert_array_equal(a[:, :, 2], b[:, :, 2])
    else:
        assert np.nanstd(b) > 1.3 * np.nanstd(a)


def test_a_person_cut_by_the_border_is_placed_worse(truth, seen, rig):
    config = everywhere(PartConfig(noise=0.002, miss=[0, 0, 0, 0]))
    # A camera that looks past people: half of each is outside the image.
    cut = replace(rig, K=rig.K + [[0, 0, 0], [0, 0, 500], [0, 0, 0]])
    below = cut.project(truth.xyz[:, :, :25])[0]
    visibility = np.where(cut.inside(cut.project(truth.xyz)[0]), Visibility.VISIBLE, Visibility.OUTSIDE_IMAGE)
    share = np.mean(visibility[..., :25] != Visibility.VISIBLE)
    assert 0.2 < share < 0.9
    one, other = (
        by_person(run(truth, (visibility, seen[1]), cut, replace(config, cut_noise=noise)))[0] - below
        for noise in (0, 4)
    )
    assert np.nanstd(other) > (1 + 2 * share) * np.nanstd(one)
    assert np.isfinite(one).any()


def test_what_hangs_on_a_missed_joint_is_missed_with_it(truth, seen, rig):
    none = np.zeros_like(seen[0])
    rates = []
    for hanging in (0.0, 0.5, 1.0):
        _, score = by_person(
            run(truth, (none, seen[1]), rig, everywhere(PartConfig(miss=[0.15] + 3 * [1]), hanging=hanging))
        )
        elbow, wrist, toe, knee, ear, shoulder = (
            np.isnan(score[:, :, 0, joint])
            for joint in BODY25.index("l_elbow", "l_wrist", "l_big_toe", "l_knee", "l_ear", "l_shoulder")
        )
        rates.append([wrist[elbow].mean(), toe[knee].mean(), wrist[~elbow].mean(), ear[shoulder].mean()])
    rates = np.array(rates)
    assert (np.diff(rates[:, :2], axis=0) > 0.1).all()
    assert (rates[2, :2] == 1).all()
    assert np.ptp(rates[:, 2]) == 0
    assert rates[2, 3] < 0.8


def test_half_a_face_is_told_as_well_as_a_whole_one(truth, seen, rig):
    config = everywhere(PartConfig(miss=[0.02, 0.9, 0.9, 0.9]), together=0.9)
    missed = np.isnan(by_person(run(truth, seen, rig, config))[1])
    noses, eyes = (missed[:, :, 0, BODY25.index(joint)[0]].mean() for joint in ("nose", "l_eye"))
    assert noses < 0.1
    assert eyes > 0.8


def test_truth_without_the_detector_s_joints_is_refused(rig):
    truth = Poses3D(SHELF14, np.ones((3, 1, 14, 3)))
    codes = np.zeros((3, len(rig), 1, 14), np.uint8), np.zeros((3, len(rig), 1, 14), np.int16)
    with pytest.raises(ValueError, match=r"truth of skeleton 'shelf14' lacks \['nose', .* expected truth of body25"):
        run(truth, codes, rig, CLEAN)


def test_arrays_that_do_not_belong_together_are_refused(truth, seen, rig):
    with pytest.raises(
        ValueError, match=r"hidden_by: expected shape \(F, V, P, K\) = \(400, 2, 3, 39\), found \(400, 1"
    ):
        run(truth, (seen[0], seen[1][:, :1]), rig, CLEAN)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: DetectorConfig(hanging=1.2), r"detector\.hanging: expected a share from 0 to 1, got 1\.2"),
        (lambda: DetectorConfig(merge=-0.1), r"detector\.merge: expected a share"),
        (lambda: DetectorConfig(drop=float("nan")), r"detector\.drop: expected a share"),
        (lambda: DetectorConfig(blur=-1), r"detector\.blur: expected 0 or more, got -1"),
        (lambda: DetectorConfig(bursts=[1.0]), r"detector\.bursts: expected two times above 0 s"),
        (lambda: DetectorConfig(guess_score=[1.0]), r"detector\.guess_score: expected a > 0 and b >= 0"),
        (lambda: DetectorConfig(ghosts=1.0, ghost_joints=1.0), r"detector\.ghost_joints: expected a share above 0"),
        (lambda: PartConfig(offset=[0.1]), r"expected 2 numbers of offset, got \[0\.1\]"),
        (lambda: PartConfig(noise=-1.0), "noise >= 0"),
        (lambda: PartConfig(score=[-1.0, 2.0]), "detector part: score: expected a > 0"),
    ],
)
def test_a_detector_that_cannot_be_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
