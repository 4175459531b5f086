"""The simulated detector: exact when it is to be, wrong as real ones are, the same wherever it runs."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.clip import Poses3D, Visibility
from dmae.skeleton import BODY25
from synth.chance import in_bursts, unrest, wander
from synth.mistakes import PartConfig

from .detecting import CLEAN, PRESETS, SKELETON, by_person, everywhere, preset, run
from .test_rigs import preset as rig_preset


@pytest.fixture(scope="module")
def rig():
    return rig_preset("shelf")


def test_the_clean_detector_gives_the_projections_of_what_is_visible(truth, seen, rig):
    found = run(truth, seen, rig, preset("clean"))
    assert preset("clean") == CLEAN
    xy, score = by_person(found)
    expected, _ = rig.project(truth.xyz[:, :, :25])
    visible = seen[0][..., :25] == Visibility.VISIBLE
    np.testing.assert_array_equal(np.isfinite(score), visible)
    np.testing.assert_allclose(xy[visible], expected[visible], atol=1e-3)
    assert (score[visible] == 1).all()
    assert found.detections.skeleton is BODY25


def test_the_order_within_a_view_says_nothing_and_leaves_no_gaps(truth, seen, rig):
    detections, person = run(truth, seen, rig, CLEAN)[:2]
    there = detections.observed.any(-1)
    assert (there[..., :-1] >= there[..., 1:]).all()
    assert (there == (person >= 0)).all()
    first = person[:, 1, 0]
    assert all(0.2 < (first == who).mean() < 0.5 for who in range(3))
    # Nor does a person keep its place from frame to frame.
    assert 0.15 < (first[1:] == first[:-1]).mean() < 0.55


def test_the_same_seed_gives_the_same_detections_and_another_seed_others(truth, seen, rig):
    config = preset("shelf_openpose")
    one, same, other = (run(truth, seen, rig, config, seed)[0] for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.xy, same.xy)
    assert one.xy.shape != other.xy.shape or not np.array_equal(one.xy, other.xy, equal_nan=True)


@pytest.mark.parametrize("views", [[0], [4, 1], [2, 3, 0]])
def test_a_view_s_detections_do_not_depend_on_the_other_views(truth, seen, rig, views):
    config = preset("shelf_openpose")
    whole, who = run(truth, seen, rig, config)[:2]
    part, who_part = run(truth, tuple(array[:, views] for array in seen), rig[views], config)[:2]
    most = part.xy.shape[2]
    np.testing.assert_array_equal(whole.xy[:, views, :most], part.xy)
    np.testing.assert_array_equal(whole.score[:, views, :most], part.score)
    np.testing.assert_array_equal(who[:, views, :most], who_part)
    assert not whole.observed[:, views, most:].any()


def test_what_is_outside_the_image_is_never_detected(truth, seen, rig):
    visibility, hidden_by = seen
    outside = visibility.copy()
    outside[:, 2] = Visibility.OUTSIDE_IMAGE
    outside[:, 3] = Visibility.BEHIND_CAMERA
    detections = run(truth, (outside, hidden_by), rig, replace(preset("shelf_openpose"), ghosts=0.0)).detections
    assert not detections.observed[:, 2:4].any()
    inside = rig.inside(detections.xy)
    assert (inside == detections.observed).all()


def test_hidden_joints_are_missed_more_often_placed_worse_and_trusted_less(truth, seen, rig):
    config = replace(preset("shelf_openpose"), ghosts=0.0, leg_inversion=0.0, arm_inversion=0.0, swap=0.0)
    xy, score = by_person(run(truth, seen, rig, config))
    expected, _ = rig.project(truth.xyz[:, :, :25])
    error = np.linalg.norm(xy - expected, axis=-1)
    code = seen[0][..., :25]
    visible = code == Visibility.VISIBLE
    hidden = (code == Visibility.HIDDEN_BY_SELF) | (code == Visibility.HIDDEN_BY_PERSON)
    assert 0.02 < np.isnan(score[visible]).mean() < 0.25 < np.isnan(score[hidden]).mean() < 0.95
    assert np.nanmedian(error[hidden]) > 1.3 * np.nanmedian(error[visible])
    assert np.nanmedian(score[hidden]) < np.nanmedian(score[visible]) - 0.05
    assert np.nanmin(score) >= config.least_score
    # Nowhere does a hidden joint get more confidence than visible ones can have.
    assert np.nanquantile(score[hidden], 0.99) < np.nanquantile(score[visible], 0.99)


def test_confidence_falls_with_the_error(truth, seen, rig):
    config = everywhere(PartConfig(noise=0.01, tail=3, score=[8, 2]), score_knows=0.6)
    xy, score = by_person(run(truth, seen, rig, config))
    error = np.linalg.norm(xy - rig.project(truth.xyz[:, :, :25])[0], axis=-1)
    good, bad = error[score > 0.9], error[score < 0.6]
    assert np.median(bad) > 2 * np.median(good)


def test_noise_is_student_t_in_the_size_of_the_person_and_hangs_together_in_time(truth, seen, rig):
    config = everywhere(PartConfig(noise=0.01, tail=3), correlation=0.2)
    xy, _ = by_person(run(truth, seen, rig, config))
    expected, _ = rig.project(truth.xyz[:, :, :25])
    height = np.ptp(expected[..., 1], axis=-1)[..., None, None]
    noise = (xy - expected)[:, [1]] / height[:, [1]]
    # Quartiles of t with 3 degrees of freedom are +-0.765.
    np.testing.assert_allclose(np.nanquantile(noise, [0.25, 0.75]), [-0.00765, 0.00765], rtol=0.15)
    assert np.nanquantile(np.abs(noise), 0.99) > 0.04
    steps, still = np.sign(noise[1:]), np.sign(noise[:-1])
    assert np.nanmean(steps * still) > 0.5


def test_a_bias_stays_for_the_clip(truth, seen, rig):
    config = everywhere(PartConfig(noise=0.01, tail=1000), correlation=0.1, bias=0.5)
    xy, _ = by_person(run(truth, seen, rig, config))
    expected, _ = rig.project(truth.xyz[:, :, :25])
    noise = (xy - expected)[:, 1] / np.ptp(expected[:, 1, ..., 1], axis=-1)[..., None, None]
    always = np.isfinite(noise).all(0)
    constant = noise.mean(0)[always]
    assert 0.4 < (constant**2).mean() / (noise[:, always] ** 2).mean() < 0.62


def test_arms_are_missed_whole_and_misses_come_in_bursts(truth, seen, rig):
    config = everywhere(PartConfig(miss=[0.2, 1, 1, 1]), together=0.95)
    _, score = by_person(run(truth, (np.zeros_like(seen[0]), seen[1]), rig, config))
    missed = np.isnan(score)[:, 1]
    elbow, wrist, knee = (missed[..., i] for i in BODY25.index("l_elbow", "l_wrist", "l_knee"))
    assert 0.1 < missed.mean() < 0.3
    assert elbow[wrist].mean() > 0.7
    assert knee[wrist].mean() < 0.5
    assert missed[1:][missed[:-1]].mean() > 0.6


def test_sides_are_exchanged_as_often_as_asked(truth, seen, rig):
    config = everywhere(PartConfig(miss=[0, 0, 0, 0]), leg_inversion=0.3)
    xy, _ = by_person(run(truth, seen, rig, config))
    expected, _ = rig.project(truth.xyz[:, :, :25])
    left, right, wrist = BODY25.index("l_ankle", "r_ankle", "l_wrist")
    near = np.linalg.norm(xy[..., left, :] - expected[..., right, :], axis=-1) < 0.01
    known = np.isfinite(xy[..., left, 0])
    assert 0.2 < near[known].mean() < 0.4
    assert np.nanmax(np.abs(xy[..., wrist, :] - expected[..., wrist, :])) < 1e-3


def test_hidden_joints_are_taken_for_the_neighbour_s(truth, seen, rig):
    config = everywhere(PartConfig(miss=[0, 0, 0, 0]), swap=0.5)
    xy, _ = by_person(run(truth, seen, rig, config))
    expected, _ = rig.project(truth.xyz[:, :, :25])
    hidden = (seen[0][..., 1, :25] == Visibility.HIDDEN_BY_PERSON) & np.isfinite(xy[..., 1, :, 0])
    on_other = np.linalg.norm(xy[..., 1, :, :] - expected[..., 2, :, :], axis=-1) < 0.01
    assert 0.35 < on_other[hidden].mean() < 0.65
    assert not on_other[seen[0][..., 1, :25] == Visibility.VISIBLE].any()


def test_ghosts_stay_at_their_places(truth, seen, rig):
    counts = []
    for seed in range(12):
        detections, person = run(truth, seen, rig, replace(CLEAN, ghosts=0.5), seed)[:2]
        ghost = (person < 0) & detections.observed.any(-1)
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


def test_whole_persons_are_missed_in_bursts(truth, seen, rig):
    config, shares, again = replace(CLEAN, person_miss=0.3, person_miss_hidden=0.3), [], []
    there = np.stack([(run(truth, seen, rig, CLEAN).detected_person == who).any(-1) for who in range(3)], -1)
    for seed in range(8):
        person = run(truth, seen, rig, config, seed).detected_person
        missed = there & ~np.stack([(person == who).any(-1) for who in range(3)], -1)
        shares.append(missed.sum() / there.sum())
        again.append(missed[1:][missed[:-1]].mean())
    assert abs(np.mean(shares) - 0.3) < 0.05
    assert np.mean(again) > 0.6


def test_nobody_is_detected_where_nobody_is(rig):
    truth = Poses3D(SKELETON, np.full((10, 2, 39, 3), np.nan))
    absent = np.full((10, 5, 2, 39), Visibility.ABSENT, np.uint8)
    for name in PRESETS:
        found = run(truth, (absent, np.full(absent.shape, -1, np.int16)), rig, preset(name))
        assert found.detections.xy.shape == (10, 5, 0, 25, 2)


def test_a_part_of_the_wrong_shape_is_refused():
    with pytest.raises(ValueError, match=r"expected 4 numbers of miss, got \[0.1\]"):
        PartConfig(miss=[0.1])


def test_wander_is_standard_normal_and_forgets_at_the_rate_asked():
    values = wander((5000, 40), 50, 0.1, rng=np.random.default_rng(0))
    assert abs(values.mean()) < 0.03
    assert abs(values.std() - 1) < 0.02
    # From the first frame on.
    assert abs(wander((1, 100_000), 50, 0.1, rng=np.random.default_rng(1)).std() - 1) < 0.02
    assert abs((values[5:] * values[:-5]).mean() - np.exp(-1)) < 0.03
    assert abs((wander((5000, 40), 50, 0, rng=np.random.default_rng(2))[1:] * values[:-1]).mean()) < 0.01


def test_bursts_happen_as_often_as_asked_and_vary_in_length():
    level = unrest((20_000, 20), 25, [3.0, 0.4], rng=np.random.default_rng(0))
    assert abs(level.std() - 1) < 0.1
    missed = in_bursts(0.12, level)
    assert abs(missed.mean() - 0.12) < 0.01
    edges = np.diff(np.pad(missed, ((1, 1), (0, 0))).astype(int).T)
    lengths = np.nonzero(edges == -1)[1] - np.nonzero(edges == 1)[1]
    # A Markov chain's longest tenth of bursts would hold a third of the events.
    assert lengths[lengths >= np.quantile(lengths, 0.9)].sum() > 0.4 * lengths.sum()
    assert not in_bursts(0.0, level).any()
    assert in_bursts(1.0, level).all()
