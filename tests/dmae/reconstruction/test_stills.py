"""Stills: below one frame a second, each frame is captured and completed by itself."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.calibration.config import RefineConfig
from dmae.calibration.refinement import refine
from dmae.completion.methods import find_method
from dmae.data.clip import Clip, Detections2D, Poses3D, Source
from dmae.data.skeleton import BODY25
from dmae.evaluation.report.findings import examine
from dmae.evaluation.report.page import summary
from dmae.evaluation.scores import score
from dmae.numerics.filling import smooth
from dmae.reconstruction.config import CaptureConfig, NoiseModel, SubjectConfig
from dmae.reconstruction.pipeline import capture, learn_noise
from tests.support.completers import circling, untrained, with_holes
from tests.support.detected_people import crossing, detected_clip, errors, walk

RATE = 1 / 75


@pytest.fixture(scope="module")
def stills():
    """Three people, 75 s apart: nobody is near where the frame before had them."""
    order = np.random.default_rng(0).permutation(len(crossing()))[:12]
    people = crossing()[order]
    return replace(detected_clip(people, 3), fps=RATE), people


def test_each_still_has_the_people_that_it_has_alone(stills):
    """With the noise that was learned from all of them."""
    clip, people = stills
    noise = learn_noise(clip, CaptureConfig())
    poses = capture(clip, CaptureConfig())
    assert np.nanmedian(errors(poses, people)) < 0.03
    for frame in (0, 7):
        alone = capture(clip.select(frames=[frame]), CaptureConfig(), noise)
        np.testing.assert_array_equal(poses.xyz[frame, : alone.xyz.shape[1]], alone.xyz[0])
        assert np.isnan(poses.xyz[frame, alone.xyz.shape[1] :]).all()


UPPER = "nose", "neck", "l_shoulder", "r_shoulder", "l_elbow", "r_elbow"


def at_a_table(people: int) -> tuple[Clip, np.ndarray]:
    """Return stills of people close together; two cameras of three see each of them, and only head and arms."""
    rng, shape = np.random.default_rng(0), (10, people)
    angle = 2 * np.pi * (np.arange(people) + rng.uniform(-0.2, 0.2, shape)) / people
    place = np.stack([np.cos(angle), np.sin(angle)], -1) * rng.uniform(0.6, 1.2, (*shape, 1))
    size, heading = rng.uniform(0.75, 1.1, shape), rng.uniform(-np.pi, np.pi, shape)
    xyz = np.array([walk(place[each], place[each], size[each], heading[each], 1)[0] for each in np.ndindex(shape)])
    xyz = xyz.reshape(*shape, 25, 3)
    xyz[:, :, np.setdiff1d(np.arange(25), BODY25.index(*UPPER))] = np.nan
    clips = [detected_clip(xyz[:, [p]], 3, miss=0, noise=6, seed=p) for p in range(people)]
    xy, score = (np.concatenate([getattr(one.detections, name) for one in clips], 2) for name in ("xy", "score"))
    hidden = rng.integers(3, size=shape)[:, None] == np.arange(3)[:, None]
    xy[hidden], score[hidden] = np.nan, np.nan
    return replace(clips[0], fps=RATE, detections=Detections2D(BODY25, xy, score)), xyz


def test_people_of_whom_two_cameras_see_a_few_joints_are_found():
    """Each by himself could be a coincidence; but in these stills few figures belong to nobody."""
    clip, people = at_a_table(5)
    poses = capture(clip, CaptureConfig())
    assert np.isfinite(errors(poses, people)).any(-1).mean() > 0.9
    assert np.isfinite(poses.xyz[..., 0]).any(-1).sum() <= people.shape[0] * people.shape[1]


def test_two_joints_that_another_camera_adds_are_measured():
    """The third camera sees only a knee and an ankle, which the first one does not see."""
    clip = replace(detected_clip(crossing()[:8, :1], 3, miss=0), fps=RATE)
    leg, score = BODY25.index("l_knee", "l_ankle"), clip.detections.score.copy()
    score[:, 0, :, leg] = np.nan
    score[:, 2, :, np.setdiff1d(np.arange(25), leg)] = np.nan
    xy = np.where(np.isnan(score)[..., None], np.nan, clip.detections.xy)
    poses = capture(replace(clip, detections=Detections2D(BODY25, xy, score)), CaptureConfig())
    assert (poses.source[..., leg] == Source.MEASURED).all()


def test_joints_that_are_elsewhere_do_not_cost_a_person():
    """Two cameras agree on 16 of 25 joints."""
    clip = replace(detected_clip(crossing()[:8, :1], 2, miss=0), fps=RATE)
    xy = clip.detections.xy.copy()
    xy[:, 1, :, 16:] += 150
    poses = capture(replace(clip, detections=Detections2D(BODY25, xy, clip.detections.score)), CaptureConfig())
    assert ((poses.source == Source.MEASURED).sum(-1) >= 14).all()


def test_nobody_is_followed_through_stills(stills):
    with pytest.raises(ValueError, match=r"subject\.at=.*each frame is captured by itself"):
        capture(stills[0], CaptureConfig(subject=SubjectConfig(at=[0, 0.0, 0.0])))
    with pytest.raises(ValueError, match="stills have no clock"):
        refine(stills[0], RefineConfig(offsets=True))


def test_scores_of_stills_follow_nobody_either(stills):
    """The first and the second person change places, and a joint is nowhere."""
    clip, people = stills
    truth, xyz = Poses3D(BODY25, people), people.copy()
    xyz[1::2] = xyz[1::2][:, [1, 0, 2]]
    xyz[:, 0, 4] = np.nan
    poses = Poses3D(BODY25, xyz)
    found = score(poses, poses, truth, fps=RATE)
    assert np.isnan(found["identity_switches"]) and np.isnan(found["idf1"])
    assert [gap["hidden"] for gap in found["gaps"]] == [len(people), 0, 0, 0]
    assert score(poses, poses, truth, fps=25)["identity_switches"] > 0
    assert "P1 of one is not P1 of the next" in " ".join(summary([examine(replace(clip, poses=poses))]))


@pytest.mark.parametrize("method", ["hold", "linear", "pchip_body", "gaussian_process", "kalman"])
def test_no_method_bridges_stills(method):
    poses = with_holes(circling(0, 20), 1)
    filled = find_method(method).load()(poses, RATE)
    for frame in (3, 11):
        alone = find_method(method).load()(poses.select([frame]), 25.0)
        np.testing.assert_array_equal(filled.source[frame], alone.source[0])
    assert not (find_method("linear").load()(poses, RATE).source == Source.COMPLETED).any()


def test_the_network_completes_a_still_by_its_own_joints():
    complete, poses = untrained(), with_holes(circling(0, 20), 1)
    whole, alone = complete(poses, RATE), complete(poses.select([5]), 25.0)
    np.testing.assert_allclose(whole.xyz[5], alone.xyz[0], atol=1e-5)
    assert (whole.source[poses.measured.any(-1)] != Source.ABSENT).all()
    assert "stills" in complete.notes(poses, RATE)[0]
    np.testing.assert_allclose(complete(poses, RATE, slice(5, 6)).xyz[0], whole.xyz[5], atol=1e-5)


def test_stills_are_not_smoothed():
    poses = circling(0, 5)
    assert smooth(poses, RATE, 0.1) is poses


def test_an_impossible_rate_is_no_still():
    for fps in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="fps must be positive"):
            find_method("linear").load()(Poses3D(circling(0, 2).skeleton, circling(0, 2).xyz), fps)


def test_a_view_that_was_matched_with_nobody_joins_the_person_it_shows():
    """The third camera's joints lie 0.24 m below the person: too far to be matched, near enough to be the person's."""
    people = crossing()[50:52, :1]
    clip = replace(detected_clip(people, views=3, miss=0, noise=1.0), fps=RATE)
    xy, depth = clip.detections.xy.copy(), clip.rig.project(people)[1]
    xy[:, 2, :, :, 1] += 0.24 * clip.rig.K[2, 0, 0] / depth[:, 2]
    shifted = replace(clip, detections=replace(clip.detections, xy=xy))
    config = CaptureConfig(noise=NoiseModel(learn=False, sigma_sure_m=0.05))
    for each in (shifted, shifted.select(frames=[0])):
        assert np.median(capture(each, config).views) == 3


def test_one_impossible_bone_does_not_cost_the_person():
    """All views show the wrist a metre beside the person, so that its rays meet."""
    people = crossing()[50:51, :1].copy()
    people[:, :, BODY25.index("l_wrist")[0], 0] += 1.0
    poses = capture(replace(detected_clip(people, views=3, miss=0, noise=1.0), fps=RATE), CaptureConfig())
    known = np.isfinite(poses.xyz[0, 0, :, 0])
    assert known.sum() >= 23
    assert not known[BODY25.index("l_wrist")[0]]


@pytest.mark.parametrize(("frames", "fps"), [(1, RATE), (50, 25.0)])
@pytest.mark.parametrize(("joints", "found"), [(3, 1), (2, 0)])
def test_three_joints_of_two_views_show_a_person(joints, found, frames, fps):
    clip = replace(detected_clip(crossing()[50 : 50 + frames, :1], views=3, miss=0, noise=1.0), fps=fps)
    score = clip.detections.score.copy()
    score[:, 1, :, joints:] = score[:, 2] = np.nan
    xy = np.where(np.isnan(score)[..., None], np.nan, clip.detections.xy)
    poses = capture(replace(clip, detections=Detections2D(BODY25, xy, score)), CaptureConfig())
    assert poses.xyz.shape[1] == found
