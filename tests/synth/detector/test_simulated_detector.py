"""The simulated detector: exact when it is to be, wrong as real ones are, the same wherever it runs."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Poses3D
from dmae.data.labels import OcclusionLabels, Visibility
from dmae.data.skeleton import BODY25
from synth.detector.parts import PartConfig
from tests.support.detectors import CLEAN, PRESETS, SKELETON, by_person, changed, everywhere, preset, run
from tests.support.rigs import preset as rig_preset


@pytest.fixture(scope="module")
def rig():
    return rig_preset("shelf")


def test_the_clean_detector_detects_the_projections_of_visible_joints(truth, occlusion, rig):
    found = run(truth, occlusion, rig, preset("clean"))
    assert preset("clean") == CLEAN
    xy, score = by_person(found)
    expected, _ = rig.project(truth.xyz[:, :, :25])
    visible = occlusion.visibility[..., :25] == Visibility.VISIBLE
    np.testing.assert_array_equal(np.isfinite(score), visible)
    np.testing.assert_allclose(xy[visible], expected[visible], atol=1e-3)
    assert (score[visible] == 1).all()
    assert found.detections.skeleton is BODY25


def test_detections_are_in_random_order_without_gaps(truth, occlusion, rig):
    detections, labels = run(truth, occlusion, rig, CLEAN)
    person = labels.person
    there = detections.observed.any(-1)
    assert (there[..., :-1] >= there[..., 1:]).all()
    assert (there == (person >= 0)).all()
    first = person[:, 1, 0]
    assert all(0.2 < (first == who).mean() < 0.5 for who in range(3))
    # Nor does a person keep its place from frame to frame.
    assert 0.15 < (first[1:] == first[:-1]).mean() < 0.55


def test_the_same_seed_gives_the_same_detections_and_another_seed_others(truth, occlusion, rig):
    config = preset("shelf_openpose")
    one, same, other = (run(truth, occlusion, rig, config, seed)[0] for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.xy, same.xy)
    assert one.xy.shape != other.xy.shape or not np.array_equal(one.xy, other.xy, equal_nan=True)


@pytest.mark.parametrize("views", [[0], [4, 1], [2, 3, 0]])
def test_a_view_s_detections_do_not_depend_on_the_other_views(truth, occlusion, rig, views):
    config = preset("shelf_openpose")
    whole, labels = run(truth, occlusion, rig, config)
    part, part_labels = run(truth, occlusion.select(views=views), rig[views], config)
    most = part.xy.shape[2]
    np.testing.assert_array_equal(whole.xy[:, views, :most], part.xy)
    np.testing.assert_array_equal(whole.score[:, views, :most], part.score)
    np.testing.assert_array_equal(labels.person[:, views, :most], part_labels.person)
    assert not whole.observed[:, views, most:].any()


def test_joints_outside_the_image_are_never_detected(truth, occlusion, rig):
    outside = occlusion.visibility.copy()
    outside[:, 2] = Visibility.OUTSIDE_IMAGE
    outside[:, 3] = Visibility.BEHIND_CAMERA
    config = changed(preset("shelf_openpose"), {"ghosts.count": 0.0})
    detections = run(truth, replace(occlusion, visibility=outside), rig, config).detections
    assert not detections.observed[:, 2:4].any()
    inside = rig.inside(detections.xy)
    assert (inside == detections.observed).all()


def test_hidden_joints_are_missed_more_often_with_larger_errors_and_lower_scores(truth, occlusion, rig):
    config = changed(
        preset("shelf_openpose"),
        {"ghosts.count": 0.0, "inversions.legs": 0.0, "inversions.arms": 0.0, "swaps.probability": 0.0},
    )
    xy, score = by_person(run(truth, occlusion, rig, config))
    expected, _ = rig.project(truth.xyz[:, :, :25])
    error = np.linalg.norm(xy - expected, axis=-1)
    code = occlusion.visibility[..., :25]
    visible = code == Visibility.VISIBLE
    hidden = (code == Visibility.HIDDEN_BY_SELF) | (code == Visibility.HIDDEN_BY_PERSON)
    assert 0.02 < np.isnan(score[visible]).mean() < 0.25 < np.isnan(score[hidden]).mean() < 0.95
    assert np.nanmedian(error[hidden]) > 1.3 * np.nanmedian(error[visible])
    assert np.nanmedian(score[hidden]) < np.nanmedian(score[visible]) - 0.05
    assert np.nanmin(score) >= config.scores.minimum
    # Nowhere does a hidden joint get more confidence than visible ones can have.
    assert np.nanquantile(score[hidden], 0.99) < np.nanquantile(score[visible], 0.99)


def test_confidence_falls_with_the_error(truth, occlusion, rig):
    config = everywhere(PartConfig(noise=0.01, tail=3, score=[8, 2]), {"scores.error_correlation": 0.6})
    xy, score = by_person(run(truth, occlusion, rig, config))
    error = np.linalg.norm(xy - rig.project(truth.xyz[:, :, :25])[0], axis=-1)
    good, bad = error[score > 0.9], error[score < 0.6]
    assert np.median(bad) > 2 * np.median(good)


def test_noise_is_student_t_scaled_by_the_person_and_correlated_in_time(truth, occlusion, rig):
    config = everywhere(PartConfig(noise=0.01, tail=3), {"times.correlation": 0.2})
    xy, _ = by_person(run(truth, occlusion, rig, config))
    expected, _ = rig.project(truth.xyz[:, :, :25])
    height = np.ptp(expected[..., 1], axis=-1)[..., None, None]
    noise = (xy - expected)[:, [1]] / height[:, [1]]
    # Quartiles of t with 3 degrees of freedom are +-0.765.
    np.testing.assert_allclose(np.nanquantile(noise, [0.25, 0.75]), [-0.00765, 0.00765], rtol=0.15)
    assert np.nanquantile(np.abs(noise), 0.99) > 0.04
    steps, still = np.sign(noise[1:]), np.sign(noise[:-1])
    assert np.nanmean(steps * still) > 0.5


def test_a_bias_is_constant_in_a_clip(truth, occlusion, rig):
    config = everywhere(PartConfig(noise=0.01, tail=1000), {"times.correlation": 0.1, "noise.bias": 0.5})
    xy, _ = by_person(run(truth, occlusion, rig, config))
    expected, _ = rig.project(truth.xyz[:, :, :25])
    noise = (xy - expected)[:, 1] / np.ptp(expected[:, 1, ..., 1], axis=-1)[..., None, None]
    always = np.isfinite(noise).all(0)
    constant = noise.mean(0)[always]
    assert 0.4 < (constant**2).mean() / (noise[:, always] ** 2).mean() < 0.62


def test_arms_are_missed_whole_and_in_bursts(truth, occlusion, rig):
    config = everywhere(PartConfig(miss=[0.2, 1, 1, 1]), {"misses.limb_correlation": 0.95})
    _, score = by_person(run(truth, replace(occlusion, visibility=np.zeros_like(occlusion.visibility)), rig, config))
    missed = np.isnan(score)[:, 1]
    elbow, wrist, knee = (missed[..., i] for i in BODY25.index("l_elbow", "l_wrist", "l_knee"))
    assert 0.1 < missed.mean() < 0.3
    assert elbow[wrist].mean() > 0.7
    assert knee[wrist].mean() < 0.5
    assert missed[1:][missed[:-1]].mean() > 0.6


def test_legs_are_inverted_with_the_given_probability(truth, occlusion, rig):
    config = everywhere(PartConfig(miss=[0, 0, 0, 0]), {"inversions.legs": 0.3})
    xy, _ = by_person(run(truth, occlusion, rig, config))
    expected, _ = rig.project(truth.xyz[:, :, :25])
    left, right, wrist = BODY25.index("l_ankle", "r_ankle", "l_wrist")
    near = np.linalg.norm(xy[..., left, :] - expected[..., right, :], axis=-1) < 0.01
    known = np.isfinite(xy[..., left, 0])
    assert 0.2 < near[known].mean() < 0.4
    assert np.nanmax(np.abs(xy[..., wrist, :] - expected[..., wrist, :])) < 1e-3


def test_hidden_joints_are_swapped_with_the_person_in_front(truth, occlusion, rig):
    config = everywhere(PartConfig(miss=[0, 0, 0, 0]), {"swaps.probability": 0.5})
    xy, _ = by_person(run(truth, occlusion, rig, config))
    expected, _ = rig.project(truth.xyz[:, :, :25])
    hidden = (occlusion.visibility[..., 1, :25] == Visibility.HIDDEN_BY_PERSON) & np.isfinite(xy[..., 1, :, 0])
    on_other = np.linalg.norm(xy[..., 1, :, :] - expected[..., 2, :, :], axis=-1) < 0.01
    assert 0.35 < on_other[hidden].mean() < 0.65
    assert not on_other[occlusion.visibility[..., 1, :25] == Visibility.VISIBLE].any()


def test_ghosts_stay_at_their_places(truth, occlusion, rig):
    counts = []
    for seed in range(12):
        detections, labels = run(truth, occlusion, rig, changed(CLEAN, {"ghosts.count": 0.5}), seed)
        ghost = (labels.person < 0) & detections.observed.any(-1)
        counts.append(ghost.sum() / ghost.shape[0] / ghost.shape[1])
    assert 0.35 < np.mean(counts) < 0.65
    frame, view, place = np.nonzero(ghost)
    middle = np.nanmean(detections.xy[frame, view, place], 1)
    joints = detections.observed[frame, view, place].sum(-1)
    assert 4 < np.median(joints) < 18
    # Few places a view: most ghosts have another one close by a little later.
    later = [(view == v) & (frame == f + 5) for f, v in zip(frame, view, strict=True)]
    moved = [np.linalg.norm(middle[i] - m, axis=-1).min(initial=np.inf) for i, m in zip(later, middle, strict=True)]
    assert np.mean(np.array(moved) < 60) > 0.5


def test_whole_persons_are_missed_in_bursts(truth, occlusion, rig):
    config, shares, again = changed(CLEAN, {"misses.person": 0.3, "misses.hidden_person": 0.3}), [], []
    there = np.stack([(run(truth, occlusion, rig, CLEAN).labels.person == who).any(-1) for who in range(3)], -1)
    for seed in range(8):
        person = run(truth, occlusion, rig, config, seed).labels.person
        missed = there & ~np.stack([(person == who).any(-1) for who in range(3)], -1)
        shares.append(missed.sum() / there.sum())
        again.append(missed[1:][missed[:-1]].mean())
    assert abs(np.mean(shares) - 0.3) < 0.05
    assert np.mean(again) > 0.6


def test_an_empty_scene_has_no_detections(rig):
    truth = Poses3D(SKELETON, np.full((10, 2, 39, 3), np.nan))
    absent = OcclusionLabels(np.full((10, 5, 2, 39), Visibility.ABSENT), np.full((10, 5, 2, 39), -1))
    for name in PRESETS:
        found = run(truth, absent, rig, preset(name))
        assert found.detections.xy.shape == (10, 5, 0, 25, 2)


def test_a_part_of_the_wrong_shape_is_refused():
    with pytest.raises(ValueError, match=r"expected 4 numbers of miss, found \[0.1\]"):
        PartConfig(miss=[0.1])
