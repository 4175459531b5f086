"""Errors of joints and scores, and their independence of each other."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Poses3D
from dmae.data.labels import JointError, OcclusionLabels, Visibility
from dmae.data.skeleton import BODY25, SHELF14
from synth.detector.errors_of_joints import Misses, Noise, Scores
from synth.detector.errors_of_persons import Drops, Ghosts, Merges
from synth.detector.parts import PartConfig
from synth.detector.view import Times, height
from tests.support.detectors import CLEAN, by_person, changed, everywhere, run

NOISY = PartConfig(noise=0.01, tail=3, score=[8, 2], miss=[0.1, 0.5, 0.5, 0.5])
ALL = PartConfig(miss=[0, 0, 0, 0])
BUSY = everywhere(
    NOISY,
    {
        "inversions.legs": 0.1,
        "swaps.probability": 0.2,
        "ghosts.count": 1.0,
        "misses.person": 0.05,
        "misses.limb_correlation": 0.5,
        "scores.error_correlation": 0.4,
    },
)


def heights(true_xy) -> np.ndarray:
    """(F, V, P, 1, 1) px."""
    return np.stack([height(xy) for xy in np.moveaxis(true_xy, 1, 0)], 1)[..., None, None]


def noise(truth, occlusion, rig, true_xy, config, seed=0) -> np.ndarray:
    """(F, V, P, 25, 2) errors, px."""
    return by_person(run(truth, occlusion, rig, config, seed))[0] - true_xy


@pytest.mark.parametrize(
    "change",
    [
        {"ghosts.count": 0.0}, {"ghosts.joints": 0.7}, {"ghosts.score": [2.0, 2.0]}, {"drops.repeat": True},
        {"merges.remainder": 0.1},
    ],
)  # fmt: skip
def test_errors_of_whole_detections_leave_persons_unchanged(truth, occlusion, rig, change):
    one, other = (by_person(run(truth, occlusion, rig, config)) for config in (BUSY, changed(BUSY, change)))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize(
    "change",
    [
        {"misses.person": 0.0}, {"misses.neighbour_correlation": 0.9}, {"inversions.legs": 0.0},
        {"inversions.arms": 0.2}, {"swaps.probability": 0.0}, {"merges.probability": 0.7}, {"splits.probability": 0.2},
        {"drops.probability": 0.2}, {"misses.hidden_person": 0.5},
    ],
)  # fmt: skip
def test_an_error_more_or_less_leaves_the_draws_of_all_others(truth, occlusion, rig, change):
    """Most joints stay where they are, to the last bit, and only some come, go or are taken for others."""
    (one, one_score), (other, other_score) = (
        by_person(run(truth, occlusion, rig, config)) for config in (BUSY, changed(BUSY, change))
    )
    both = np.isfinite(one_score) & np.isfinite(other_score)
    same = (one[both] == other[both]).all(-1) & (one_score[both] == other_score[both])
    assert same.mean() > 0.7
    assert not same.all() or np.isfinite(one_score).sum() != np.isfinite(other_score).sum()


def test_ghosts_do_not_depend_on_errors_of_persons(truth, occlusion, rig):
    def ghosts(config):
        found = run(truth, occlusion, rig, config)
        return np.sort(found.detections.xy[found.labels.error == JointError.GHOST], axis=0)

    wild = changed(
        BUSY,
        {
            "merges.probability": 0.5,
            "misses.neighbour_correlation": 1.0,
            "inversions.legs": 0.5,
            "swaps.probability": 0.9,
            "misses.person": 0.5,
        },
    )
    np.testing.assert_array_equal(ghosts(BUSY), ghosts(wild))


def test_larger_noise_changes_neither_misses_nor_the_draws_of_errors(truth, occlusion, rig, true_xy):
    quiet, loud = (
        everywhere(replace(NOISY, noise=noise), {"scores.error_correlation": 0.0}) for noise in (0.002, 0.004)
    )
    a, b = (noise(truth, occlusion, rig, true_xy, config) for config in (quiet, loud))
    both = np.isfinite(a) & np.isfinite(b)
    assert both.sum() > 0.99 * np.isfinite(a).sum()
    np.testing.assert_allclose(b[both], 2 * a[both], atol=2e-3)


def test_a_part_s_offset_moves_it_outwards_and_down_the_trunk(truth, occlusion, rig, true_xy):
    part = PartConfig(miss=[0, 0, 0, 0], offset=[0.1, 0.2])
    off = noise(truth, occlusion, rig, true_xy, everywhere(part))
    left, right, neck, hips, nose = BODY25.index("l_hip", "r_hip", "neck", "mid_hip", "nose")
    trunk = true_xy[..., hips, :] - true_xy[..., neck, :]
    wide = true_xy[..., left, :] - true_xy[..., right, :]
    known = np.isfinite(off).all((-1, -2))
    np.testing.assert_allclose(off[known][:, nose], 0.2 * trunk[known], atol=1e-2)
    np.testing.assert_allclose(off[known][:, left], 0.2 * trunk[known] + 0.1 * wide[known], atol=1e-2)
    np.testing.assert_allclose(off[known][:, right], 0.2 * trunk[known] - 0.1 * wide[known], atol=1e-2)


def test_a_view_s_offset_is_the_same_for_all_people_at_all_times(truth, occlusion, rig, true_xy):
    off = noise(truth, occlusion, rig, true_xy, everywhere(ALL, {"noise.view_offset": 0.02})) / heights(true_xy)
    constant = np.nanmean(off, (0, 2))
    assert np.nanmax(np.abs(off - constant[:, None])) < 1e-4
    assert 0.014 < constant.std() < 0.026


@pytest.mark.parametrize(
    ("option", "low", "high"),
    [
        ("noise.minimum", 0.0, 3.0),
        ("noise.blur", 0.0, 30.0),
        ("noise.hidden", 1.0, 3.0),
        ("noise.bias", 0.0, 0.9),
        ("times.correlation", 0.05, 1),
    ],
)
def test_errors_grow_with_their_parameters(truth, occlusion, rig, true_xy, option, low, high):
    part = PartConfig(noise=0.002, tail=30, miss=[0, 0, 0, 0])
    a, b = (noise(truth, occlusion, rig, true_xy, everywhere(part, {option: value})) for value in (low, high))
    if option == "noise.bias":
        always = np.isfinite(a).all(0) & np.isfinite(b).all(0)
        assert (b.mean(0)[always] ** 2).mean() > 3 * (a.mean(0)[always] ** 2).mean()
    elif option == "times.correlation":
        assert np.nanmean(np.diff(a, axis=0) ** 2) > 3 * np.nanmean(np.diff(b, axis=0) ** 2)
    elif option == "noise.hidden":
        # The first person's left joints are hidden, the third's are not.
        left = BODY25.index("l_wrist", "l_knee", "l_ankle")
        assert np.nanstd(b[..., 0, left, :]) > 2.5 * np.nanstd(a[..., 0, left, :])
        np.testing.assert_array_equal(a[:, :, 2], b[:, :, 2])
    else:
        assert np.nanstd(b) > 1.3 * np.nanstd(a)


def test_joints_of_a_truncated_person_are_noisier(truth, occlusion, rig):
    config = everywhere(PartConfig(noise=0.002, miss=[0, 0, 0, 0]))
    # A camera that looks past people: half of each is outside the image.
    cut = replace(rig, K=rig.K + [[0, 0, 0], [0, 0, 500], [0, 0, 0]])
    below = cut.project(truth.xyz[:, :, :25])[0]
    visibility = np.where(cut.inside(cut.project(truth.xyz)[0]), Visibility.VISIBLE, Visibility.OUTSIDE_IMAGE)
    occlusion = replace(occlusion, visibility=visibility)
    share = np.mean(visibility[..., :25] != Visibility.VISIBLE)
    assert 0.2 < share < 0.9
    one, other = (
        by_person(run(truth, occlusion, cut, changed(config, {"noise.truncation": noise})))[0] - below
        for noise in (0, 4)
    )
    assert np.nanstd(other) > (1 + 2 * share) * np.nanstd(one)
    assert np.isfinite(one).any()


def test_outer_neighbours_of_missed_joints_are_missed_with_them(truth, occlusion, rig):
    none = replace(occlusion, visibility=np.zeros_like(occlusion.visibility))
    rates = []
    for correlation in (0.0, 0.5, 1.0):
        config = everywhere(PartConfig(miss=[0.15] + 3 * [1]), {"misses.neighbour_correlation": correlation})
        _, score = by_person(run(truth, none, rig, config))
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


def test_half_a_face_is_detected_as_well_as_a_whole_one(truth, occlusion, rig):
    config = everywhere(PartConfig(miss=[0.02, 0.9, 0.9, 0.9]), {"misses.limb_correlation": 0.9})
    missed = np.isnan(by_person(run(truth, occlusion, rig, config))[1])
    noses, eyes = (missed[:, :, 0, BODY25.index(joint)[0]].mean() for joint in ("nose", "l_eye"))
    assert noses < 0.1
    assert eyes > 0.8


def test_a_joint_that_is_never_reported_does_not_raise_the_misses_of_its_limb(truth, occlusion, rig):
    never = {"parts.small_toe": PartConfig(miss=[1.0] * 4)}
    missed = np.isnan(by_person(run(truth, occlusion, rig, everywhere(PartConfig(miss=[0.02] * 4), never)))[1])
    big, small = (missed[..., BODY25.index(f"l_{joint}")[0]].mean() for joint in ("big_toe", "small_toe"))
    assert 0 < big < 0.08
    assert small == 1


def test_truth_without_the_joints_of_body25_is_refused(rig):
    truth = Poses3D(SHELF14, np.ones((3, 1, 14, 3)))
    codes = OcclusionLabels(np.zeros((3, len(rig), 1, 14)), np.zeros((3, len(rig), 1, 14)))
    with pytest.raises(ValueError, match=r"truth of skeleton 'shelf14' lacks \['nose', .* expected truth of body25"):
        run(truth, codes, rig, CLEAN)


def test_labels_of_another_rig_are_refused(truth, occlusion, rig):
    with pytest.raises(
        ValueError, match=r"expected visibility of shape \(F, V, P, K\) = \(400, 2, 3, 39\), found \(400, 1"
    ):
        run(truth, occlusion.select(views=[0]), rig, CLEAN)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Misses(neighbour_correlation=1.2),
            r"detector\.misses\.neighbour_correlation: expected a number from 0 to 1, found 1\.2",
        ),
        (lambda: Merges(probability=-0.1), r"detector\.merges\.probability: expected a number from 0 to 1"),
        (lambda: Drops(probability=float("nan")), r"detector\.drops\.probability: expected a number from 0 to 1"),
        (lambda: Noise(blur=-1), r"detector\.noise\.blur: expected 0 or more, found -1"),
        (lambda: Times(bursts=[1.0]), r"detector\.times\.bursts: expected two times above 0 s"),
        (lambda: Scores(hidden=[1.0]), r"detector\.scores\.hidden: expected a > 0 and b >= 0"),
        (lambda: Ghosts(count=1.0, joints=1.0), r"detector\.ghosts\.joints: expected a number above 0"),
        (lambda: PartConfig(offset=[0.1]), r"expected 2 numbers of offset, found \[0\.1\]"),
        (lambda: PartConfig(noise=-1.0), r"detector part\.noise: expected 0 or more"),
        (lambda: PartConfig(score=[-1.0, 2.0]), "detector part: score: expected a > 0"),
    ],
)
def test_parameters_out_of_range_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
