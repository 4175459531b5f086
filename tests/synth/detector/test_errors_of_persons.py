"""Errors of persons and of times, and the labels of each detection."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Poses3D
from dmae.data.labels import JointError, OcclusionLabels, Visibility
from dmae.data.skeleton import BODY25
from synth.detector.parts import PartConfig
from tests.support.detectors import (
    CLEAN,
    FPS,
    PRESETS,
    by_person,
    changed,
    everywhere,
    occlusion_of,
    preset,
    run,
    three_persons,
)

ALL = PartConfig(miss=[0, 0, 0, 0])


@pytest.mark.parametrize("name", PRESETS)
def test_labels_say_what_each_detection_is(truth, occlusion, rig, true_xy, name):
    found = run(truth, occlusion, rig, preset(name))
    observed, person = found.detections.observed, found.labels.person
    of_ghost = (person < 0)[..., None]
    np.testing.assert_array_equal(found.labels.error != JointError.ABSENT, observed)
    np.testing.assert_array_equal((found.labels.error == JointError.GHOST), observed & of_ghost)
    np.testing.assert_array_equal(np.isfinite(found.labels.offset_px), observed & ~of_ghost)
    frame, view, place, joint = np.nonzero(observed & ~of_ghost)
    expected = found.detections.xy[frame, view, place, joint] - true_xy[frame, view, person[frame, view, place], joint]
    off = found.labels.offset_px[frame, view, place, joint]
    np.testing.assert_allclose(off, np.linalg.norm(expected, axis=-1), rtol=1e-4, atol=1e-3)
    owner, kind = (array[frame, view, place, joint] for array in (found.labels.joint_person, found.labels.error))
    others = owner != person[frame, view, place]
    assert not others[np.isin(kind, [JointError.GOOD, JointError.JITTER, JointError.FAR])].any()
    assert others[np.isin(kind, [JointError.MERGED, JointError.SWAPPED])].all()
    if name != "clean":
        good, jitter, far = (
            np.median(off[kind == code]) for code in (JointError.GOOD, JointError.JITTER, JointError.FAR)
        )
        assert good < jitter < far


def test_errors_are_classed_by_keypoint_similarity(truth, occlusion, rig, true_xy):
    found = run(truth, occlusion, rig, everywhere(PartConfig(noise=0.02, tail=3)))
    low, high = true_xy.min(-2), true_xy.max(-2)
    box = (high - low).prod(-1)
    ankle = BODY25.index("r_ankle")[0]
    frame, view, place = np.nonzero(found.detections.observed[..., ankle])
    off = found.labels.offset_px[frame, view, place, ankle]
    area = 0.53 * box[frame, view, found.labels.person[frame, view, place]]
    similarity = np.exp(-(off**2) / (2 * area * (2 * 0.089) ** 2))
    kind = found.labels.error[frame, view, place, ankle]
    for code, least, most in ((JointError.GOOD, 0.85, 1), (JointError.JITTER, 0.5, 0.85), (JointError.FAR, 0, 0.5)):
        assert (kind == code).any()
        of_kind = similarity[kind == code]
        assert (of_kind >= least - 1e-6).all()
        assert (of_kind <= most + 1e-6).all()


@pytest.mark.parametrize("name", PRESETS)
def test_absent_persons_and_persons_behind_a_camera_are_not_detected(truth, occlusion, rig, name):
    xyz, visibility = truth.xyz.copy(), occlusion.visibility.copy()
    xyz[:200, 0], visibility[:200, :, 0] = np.nan, Visibility.ABSENT
    xyz[:, 1] += 2.5 * (rig.centers[0] - xyz[:, 1].mean((0, 1)))
    moved = Poses3D(truth.skeleton, xyz)
    depth = rig.project(moved.xyz)[1]
    visibility[:, 0, 1] = np.where(depth[:, 0, 1] <= 0, Visibility.BEHIND_CAMERA, Visibility.OUTSIDE_IMAGE)
    found = run(moved, replace(occlusion, visibility=visibility), rig, preset(name))
    assert (depth[:, 0, 1] <= 0).all()
    # A view that lags by a frame may show a person a frame early.
    assert not (found.labels.person[:198] == 0).any()
    assert (found.labels.person[202:] == 0).any()
    assert not (found.labels.person[:, 0] == 1).any()


def test_a_worse_preset_is_worse(truth, occlusion, rig):
    good = {}
    for name in PRESETS:
        found = run(truth, occlusion, rig, preset(name))
        good[name] = (found.labels.error == JointError.GOOD).sum() / found.detections.observed.sum()
    assert good["clean"] == 1
    assert all(0.6 < good[name] < 0.99 for name in ("shelf_openpose", "posefix", "hrnet_like"))
    assert good["terrible"] < 0.6


def crossing() -> Poses3D:
    """The first two persons as one, a hand apart, the third far off."""
    truth = three_persons()
    xyz = truth.xyz.copy()
    xyz[:, 1] = xyz[:, 0] + [0.06, 0.05, 0.01]
    return Poses3D(truth.skeleton, xyz)


def test_two_close_persons_are_merged(rig):
    truth = crossing()
    occlusion = occlusion_of(truth, rig)
    occlusion.visibility[occlusion.visibility <= Visibility.HIDDEN_BY_OBJECT] = Visibility.VISIBLE
    shares = []
    for rest in (0.0, 1.0):
        found = run(truth, occlusion, rig, changed(CLEAN, {"merges.probability": 0.6, "merges.remainder": rest}))
        merged = (found.labels.error == JointError.MERGED).any(-1)
        there = np.stack([(found.labels.person == who).any(-1) for who in range(3)], -1)
        shares.append(merged.any(-1).mean())
        host = found.labels.person[merged]
        guests = found.labels.joint_person[merged]
        assert set(np.unique(host)) == {0, 1}
        np.testing.assert_array_equal(guests.max(-1) + np.where(guests < 0, 9, guests).min(-1), 1)
        # Trunks are the host's own.
        neck = BODY25.index("neck")[0]
        np.testing.assert_array_equal(guests[:, neck][guests[:, neck] >= 0], host[guests[:, neck] >= 0])
        if not rest:
            assert (~there[merged.any(-1)][:, :2]).sum(-1).all()
        # No joint of anybody's occurs twice.
        frame, view, place, joint = np.nonzero(found.labels.joint_person >= 0)
        keys = np.stack([frame, view, joint, found.labels.joint_person[frame, view, place, joint]])
        assert len(np.unique(keys, axis=1).T) == keys.shape[1]
    assert 0.3 < np.mean(shares) < 0.75
    apart = run(three_persons(), occlusion_of(three_persons(), rig), rig, changed(CLEAN, {"merges.probability": 0.6}))
    assert (apart.labels.error == JointError.MERGED).any((-1, -2)).mean() < min(shares)


def test_a_person_is_split_without_losing_a_joint(truth, occlusion, rig):
    whole, found = (run(truth, occlusion, rig, changed(CLEAN, {"splits.probability": split})) for split in (0.0, 0.3))
    assert found.detections.observed.sum() == whole.detections.observed.sum()
    twice = np.stack([(found.labels.person == who).sum(-1) for who in range(3)], -1)
    assert twice.max() == 2
    assert 0.15 < (twice == 2).mean() < 0.45
    assert (twice == 2)[1:][(twice == 2)[:-1]].mean() > 0.7
    # Pieces are lower bodies, or left halves.
    frame, view, person = np.argwhere(twice == 2).T
    parts = {
        tuple(found.detections.observed[f, v, place])
        for f, v, p in zip(frame, view, person, strict=True)
        for place in np.flatnonzero(found.labels.person[f, v] == p)
    }
    nose, ankle, left = BODY25.index("nose", "r_ankle", "l_wrist")
    assert any(part[nose] and not part[ankle] for part in parts)
    assert any(part[ankle] and not part[nose] for part in parts)
    assert all(not (part[left] and not part[nose] and part[ankle]) for part in parts)


def test_joints_near_those_of_others_are_swapped(rig):
    truth = crossing()
    occlusion = occlusion_of(truth, rig)
    occlusion = replace(occlusion, visibility=np.zeros_like(occlusion.visibility))
    for swap, low, high in ((0.0, 0, 0), (0.3, 0.15, 0.4)):
        found = run(truth, occlusion, rig, everywhere(ALL, {"swaps.probability": swap}))
        of_pair = np.isin(found.labels.person, [0, 1])
        swapped = found.labels.error[of_pair] == JointError.SWAPPED
        assert low <= swapped.mean() <= high
        assert not (found.labels.error[found.labels.person == 2] == JointError.SWAPPED).any()


def test_inversions_are_labelled(truth, occlusion, rig, true_xy):
    found = run(truth, occlusion, rig, everywhere(ALL, {"inversions.legs": 0.3, "inversions.arms": 0.2}))
    inverted = found.labels.error == JointError.INVERTED
    legs = BODY25.index("l_knee", "r_ankle", "l_heel")
    arms = BODY25.index("l_elbow", "r_wrist")
    known = found.detections.observed
    assert 0.15 < inverted[..., legs][known[..., legs]].mean() < 0.45
    assert 0.08 < inverted[..., arms][known[..., arms]].mean() < 0.35
    assert not inverted[..., BODY25.index("nose", "l_hip", "neck")].any()
    frame, view, place, joint = np.nonzero(inverted)
    mirror = np.array(BODY25.mirror)[joint]
    other = true_xy[frame, view, found.labels.person[frame, view, place], mirror]
    np.testing.assert_allclose(found.detections.xy[frame, view, place, joint], other, atol=1e-3)


def test_dropped_frames_are_empty_or_repeat_the_one_before(truth, occlusion, rig):
    whole = run(truth, occlusion, rig, CLEAN)
    for repeats in (False, True):
        found = run(truth, occlusion, rig, changed(CLEAN, {"drops.probability": 0.3, "drops.repeat": repeats}))
        lost = ~(np.nan_to_num(found.detections.xy[:, :, :3]) == np.nan_to_num(whole.detections.xy)).all((2, 3, 4))
        assert 0.15 < lost.mean() < 0.45
        for frame, view in np.argwhere(lost):
            if repeats and not lost[: frame + 1, view].all():
                np.testing.assert_array_equal(found.detections.xy[frame, view], found.detections.xy[frame - 1, view])
                assert np.nanmax(found.labels.offset_px[frame, view]) > 0
            else:
                assert not found.detections.observed[frame, view].any()


def sliding() -> Poses3D:
    """Three persons at 1 m/s along x."""
    truth = three_persons()
    xyz = np.repeat(truth.xyz[:1], 60, axis=0)
    xyz[..., 0] += (np.arange(60) / FPS - 1.2)[:, None, None]
    return Poses3D(truth.skeleton, xyz)


def test_unsynchronised_cameras_show_another_time(rig):
    truth = sliding()
    occlusion = occlusion_of(three_persons(), rig).select(slice(60))
    occlusion = replace(occlusion, visibility=np.zeros_like(occlusion.visibility))
    found = run(truth, occlusion, rig, changed(CLEAN, {"timing.unsynchronised": 3.0}))
    xy, _ = by_person(found)
    times = np.linspace(-3, 3, 601)
    best = []
    for view in range(len(rig)):
        off = []
        for time in times:
            moved = truth.xyz[:, :, :25] + [time / FPS, 0, 0]
            off.append(np.nanmedian(np.abs(xy[5:-5, view] - rig.project(moved)[0][5:-5, view])))
        assert min(off) < 0.05
        best.append(times[np.argmin(off)])
    assert abs(best[0] - best[1]) > 0.1
    assert max(np.abs(best)) <= 3


def test_rows_are_exposed_one_after_the_other(rig):
    truth = sliding()
    codes = np.zeros((60, len(rig), 3, 39))
    occlusion = OcclusionLabels(codes, codes - 1)
    xy, _ = by_person(run(truth, occlusion, rig, changed(CLEAN, {"timing.rolling_shutter": 0.02})))
    still = rig.project(truth.xyz[:, :, :25])[0]
    delay = (still[..., 1] / rig.size[:, 1][:, None, None] * 0.02)[..., None]
    later = truth.xyz[:, None, :, :25] + delay * [1.0, 0, 0]
    expected = np.stack([rig[[view]].project(later[:, view])[0][:, 0] for view in range(len(rig))], 1)
    off = np.abs(xy - expected)
    assert np.nanmax(off) < 0.3
    assert np.nanmax(np.abs(xy - still)) > 2
