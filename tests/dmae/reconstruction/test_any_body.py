"""Capture and completion of bodies that are no people: hands and dogs of known motion."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.completion.methods import find_method
from dmae.completion.weights import find_shipped
from dmae.data.clip import Clip, Poses3D, Source
from dmae.data.skeleton import BODY25, define
from dmae.metrics.comparison import match, take_matched
from dmae.numerics.body import body_rotations
from dmae.online.capture import OnlineCapture
from dmae.reconstruction.body_size import measured_size
from dmae.reconstruction.config import AssociationConfig, CaptureConfig, ComparedJoints, SubjectConfig, TrackingConfig
from dmae.reconstruction.diagnosis import explain_capture
from dmae.reconstruction.pipeline import capture
from dmae.reconstruction.pruning import broken
from dmae.reconstruction.sides import Sides
from tests.support.animals import DOG, HAND, dog_clip, hand_clip, hands_clip
from tests.support.untrained_methods import UNTRAINED

CLIPS = {"hand": hand_clip, "hands": hands_clip, "dogs": lambda frames: dog_clip(frames, dogs=2)}


def errors_mm(clip: Clip, poses: Poses3D, chosen: np.ndarray) -> np.ndarray:
    found = take_matched(np.where(chosen[..., None], poses.xyz, np.nan), match(poses.xyz, clip.truth.xyz))
    distance = 1000 * np.linalg.norm(found - clip.truth.xyz, axis=-1)
    return distance[~np.isnan(distance)]


def unsized(clip: Clip, size_m: float | None = None) -> Clip:
    detections = clip.detections
    return replace(clip, detections=replace(detections, skeleton=replace(detections.skeleton, size_m=size_m)))


@pytest.mark.parametrize(
    ("kind", "bodies", "measured_mm", "completed_mm"), [("hand", 1, 3, 10), ("hands", 2, 3, 10), ("dogs", 2, 18, 45)]
)
def test_bodies_are_captured_and_completed(kind, bodies, measured_mm, completed_mm):
    clip = CLIPS[kind](150)
    poses = capture(clip, CaptureConfig())
    assert poses.xyz.shape[1] == bodies
    assert poses.measured.mean() > 0.8
    assert errors_mm(clip, poses, poses.measured).mean() < measured_mm
    filled = find_method("gaussian_process").load()(poses, clip.fps)
    added = filled.source == Source.COMPLETED
    assert added.sum() > 0.8 * (~poses.measured).sum()
    error = errors_mm(clip, filled, added).mean()
    assert error < completed_mm
    lines = find_method("linear").load()(poses, clip.fps)
    assert error < errors_mm(clip, lines, lines.source == Source.COMPLETED).mean() / 2
    np.testing.assert_array_equal(filled.xyz[poses.measured], poses.xyz[poses.measured])


def test_a_size_that_is_not_stated_is_measured():
    for clip, size in ((hand_clip(60), 0.18), (dog_clip(60, dogs=2), 1.2)):
        assert measured_size(clip, 0.2) == pytest.approx(size, rel=0.1)
        poses, stated = capture(unsized(clip), CaptureConfig()), capture(clip, CaptureConfig())
        assert poses.xyz.shape == stated.xyz.shape
        assert errors_mm(clip, poses, poses.measured).mean() < 1.1 * errors_mm(clip, stated, stated.measured).mean()


def test_a_size_that_no_two_cameras_show_is_asked_for():
    clip = unsized(hand_clip(20))
    xy = clip.detections.xy.copy()
    xy[:, 1:] = np.nan
    alone = replace(clip, detections=replace(clip.detections, xy=xy, score=np.where(np.isnan(xy[..., 0]), np.nan, 1.0)))
    with pytest.raises(ValueError, match="state size_m in its file"):
        capture(alone, CaptureConfig())
    assert "state size_m" in str(explain_capture(alone, CaptureConfig()))
    with pytest.raises(ValueError, match="give size_m"):
        OnlineCapture(clip.rig, clip.detections.skeleton, clip.fps, CaptureConfig())


def test_the_world_is_scaled_without_a_trace():
    """A hand ten times as large before cameras ten times as far away is captured the same, ten times as large."""
    clip = hand_clip(40)
    world = clip.rig.cam_from_world.copy()
    world[:, :3, 3] *= 10
    skeleton = replace(HAND, size_m=10 * HAND.size_m)
    large = replace(clip, rig=replace(clip.rig, cam_from_world=world), truth=None,
                    detections=replace(clip.detections, skeleton=skeleton))  # fmt: skip
    one, ten = (capture(each, replace(CaptureConfig(), prune=False)) for each in (clip, large))
    np.testing.assert_allclose(ten.xyz, 10 * one.xyz, rtol=1e-4, atol=1e-4)
    known = one.measured
    np.testing.assert_allclose(ten.cov[known], 100 * one.cov[known], rtol=1e-2, atol=1e-9)


def test_places_of_the_configuration_are_of_the_world():
    clip = dog_clip(40, dogs=2)
    middle = np.median(clip.truth.xyz[:, 0], (0, 1))
    near = CaptureConfig(volume=[-0.95, -0.95, 0, 0.95, 0.95, 1])
    assert np.linalg.norm(middle[:2]) < 0.95
    assert capture(clip, near).xyz.shape[1] == 1
    at = [20, *np.median(clip.truth.xyz[20, 1], 0)[:2].tolist()]
    (chosen,) = capture(clip, CaptureConfig(subject=SubjectConfig(at=at))).xyz.swapaxes(0, 1)
    assert np.nanmedian(np.linalg.norm(chosen - clip.truth.xyz[:, 1], axis=-1)) < 0.05


def test_options_for_people_are_refused():
    clip = hand_clip(5)
    with pytest.raises(ValueError, match=r"subject.leg_m: skeleton 'hand21' lacks l_ankle"):
        capture(clip, CaptureConfig(subject=SubjectConfig(leg_m=[0.5, 1])))
    association = AssociationConfig(joints=ComparedJoints.mid_hip)
    with pytest.raises(ValueError, match="has no hips"):
        capture(clip, CaptureConfig(association=association))
    with pytest.raises(ValueError, match=r"know people, on body25, and nothing of 'hand21'.*fill=gaussian_process"):
        find_shipped(HAND)


def test_frames_as_they_come():
    clip = hand_clip(60)
    online = OnlineCapture(clip.rig, HAND, clip.fps, CaptureConfig())
    done = [each for f in range(60) for each in online.push(clip.detections.select(slice(f, f + 1)))] + online.flush()
    assert len(done) == 60
    xyz = np.stack([each.poses.xyz[0, 0] for each in done[5:]])
    assert np.nanmean(np.linalg.norm(xyz - clip.truth.xyz[5:, 0], axis=-1)) < 0.004


@pytest.mark.parametrize("joints", [2, 3])
def test_bodies_of_few_joints_without_bones(joints):
    names = ["nose", "back", "tail_tip"][:joints]
    skeleton = define({"name": "few", "joints": dict.fromkeys(names), "size_m": 1.2}, "here")
    clip = dog_clip(40)
    kept = DOG.index("nose", "withers", "tail_tip")[:joints]
    detections = replace(clip.detections, skeleton=skeleton, xy=clip.detections.xy[..., kept, :],
                         score=clip.detections.score[..., kept])  # fmt: skip
    # So few joints that agree may do so by chance, as far as capture can say.
    config = CaptureConfig(tracking=TrackingConfig(max_by_chance=None))
    poses = capture(replace(clip, detections=detections, truth=None), config)
    assert poses.xyz.shape[1] == 1
    error = np.linalg.norm(poses.xyz[:, 0] - clip.truth.xyz[:, 0, kept], axis=-1)
    assert np.nanmedian(error) < 0.03
    for method in UNTRAINED.values():
        assert method(poses, clip.fps).xyz.shape == poses.xyz.shape


def test_a_torso_tells_how_a_body_is_turned():
    truth = hand_clip(50).truth
    turned = body_rotations(truth.xyz.astype(float), HAND, 1)[:, 0]
    palm = truth.xyz[:, 0, list(HAND.trunk)].astype(float)
    palm -= palm.mean(1, keepdims=True)
    at_rest = np.einsum("fji,fnj->fni", turned, palm)
    assert np.abs(at_rest - at_rest.mean(0)).max() < 5e-4
    gone = truth.xyz.astype(float)
    gone[20:23, :, list(HAND.trunk)[2:]] = np.nan
    again = body_rotations(gone, HAND, 1)[:, 0]
    assert np.abs(again - turned).max() < 0.05
    np.testing.assert_array_equal(
        body_rotations(np.full((4, 1, 21, 3), np.nan), HAND, 3), np.eye(3)[None, None].repeat(4, 0)
    )


def test_limbs_of_pairs_are_exchanged_together():
    pairs, groups = Sides.of(DOG).pairs, Sides.of(DOG).groups
    assert len(pairs) == 7
    limbs = [{DOG.joints[pairs[i, 0]] for i in np.flatnonzero(group)} for group in groups[1:]]
    assert {"l_fore_top", "l_fore_middle", "l_fore_paw"} in limbs
    assert {"l_ear"} in limbs
    assert len(Sides.of(BODY25).groups) == 3


def test_exchanged_legs_are_put_right():
    clip = dog_clip(60)
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    mirror = list(DOG.mirror)
    xy[20:40, 0], score[20:40, 0] = xy[20:40, 0][..., mirror, :], score[20:40, 0][..., mirror]
    wrong = replace(clip, detections=replace(clip.detections, xy=xy, score=score))
    before, after = (capture(each, CaptureConfig()) for each in (clip, wrong))
    assert after.xyz.shape == before.xyz.shape
    assert errors_mm(clip, after, after.measured).mean() < 1.2 * errors_mm(clip, before, before.measured).mean()


def test_bones_that_stretch_are_not_pruned():
    clip = dog_clip(60)
    nose = DOG.index("nose")[0]
    xyz = clip.truth.xyz.copy()
    xyz[::5, :, nose] += 0.6 * (xyz[::5, :, nose] - xyz[::5, :, DOG.parents[nose]])
    assert broken(xyz.astype(float), DOG)[:, :, nose].any()
    loose = replace(DOG, stretching=(nose, *DOG.index("l_ear", "r_ear")))
    assert not broken(xyz.astype(float), loose).any()
