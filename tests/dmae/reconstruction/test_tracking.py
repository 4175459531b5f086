"""People among false detections: no coincidence of false detections becomes a person."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D
from dmae.data.skeleton import BODY25
from dmae.numerics.statistics import median_over_frames
from dmae.reconstruction.chance import expected_by_chance, resting_ghosts
from dmae.reconstruction.config import CaptureConfig, TrackingConfig
from dmae.reconstruction.evidence import Evidence
from dmae.reconstruction.noise import DetectionNoise
from dmae.reconstruction.pipeline import capture, learn_noise
from dmae.reconstruction.tracking import Tracker
from tests.support.clips import looking_at_origin, looking_inwards, t_pose
from tests.support.detected_people import detected_clip, errors, rows_of, walk
from tests.support.ghosts import haunted_clip, two_people


@pytest.mark.parametrize(
    ("ghosts", "fixed", "frames", "seed"),
    [
        (50, False, 12, 1), (150, True, 12, 1), (50, True, 60, 1), (20, True, 60, 8), (20, True, 60, 10),
        (20, False, 60, 3001), (20, False, 60, 3002), (20, True, 12, 3001),
    ],
)  # fmt: skip
def test_ghosts_are_no_people(ghosts, fixed, frames, seed):
    poses, people = capture(haunted_clip(ghosts, frames, fixed, seed), CaptureConfig()), two_people(frames)
    assert poses.xyz.shape[1] == 2
    assert sorted(rows_of(poses, people)) == [[0], [1]]
    off = errors(poses, people)
    assert np.isfinite(off).mean() > 0.97
    assert np.nanmedian(off) < 0.03


def test_somebody_who_stands_for_long_and_walks_on_is_no_ghost():
    """Joints are detected 4 cm beside their places in each view, so that views agree no better than those of ghosts."""
    way, rng = walk((0, 0), (2.0, 0.4)), np.random.default_rng(4)
    people = np.concatenate([np.repeat(way[:1], 44, 0), way[:48:3]])[:, None]
    clip = haunted_clip(3, 60, True, 4, people).select(views=[0, 2, 4])
    xy = clip.detections.xy.copy()
    xy[:, :, 0] += 0.04 * clip.rig.focal[:, None, None] / 5 * rng.normal(size=(3, 25, 2))
    xy[:, :, 0] += rng.normal(0, 4, xy[:, :, 0].shape)
    poses = capture(replace(clip, detections=replace(clip.detections, xy=xy)), CaptureConfig())
    assert poses.xyz.shape[1] == 1 and np.nanmedian(errors(poses, people)) < 0.1


def test_a_figure_that_one_view_shows_moving_all_the_time_and_another_at_the_end_is_no_ghost():
    """The figures of the three views do not fit each other. A third of the frames show it passing in two of them."""
    clip = haunted_clip(3, 24, True, 4, np.full((24, 1, 25, 3), np.nan)).select(views=[0, 2, 4])
    figures = np.random.default_rng(0).uniform(300, 700, (3, 1, 25, 2))
    xy = np.repeat(figures[None], 24, 0)
    xy[:, 0] += 6 * np.arange(24)[:, None, None, None]
    xy[16:, 1] += 60 * np.arange(1, 9)[:, None, None, None]
    clip = replace(clip, detections=replace(clip.detections, xy=xy, score=np.full(xy.shape[:-1], 0.9)))
    config, noise = CaptureConfig(), DetectionNoise.prior(CaptureConfig().noise, 3, 25)
    assigned, xyz = np.zeros((24, 1, 3, 25), np.int16), np.zeros((24, 1, 25, 3))
    assert not resting_ghosts(clip, assigned, xyz, config, noise).any()
    at_rest = replace(clip, detections=replace(clip.detections, xy=np.repeat(figures[None], 24, 0)))
    assert resting_ghosts(at_rest, assigned, xyz, config, noise).all()


@pytest.mark.parametrize(("ghosts", "hidden"), [(0, 3), (5, 2), (20, 0)])
def test_people_who_stand_still_among_resting_ghosts_are_people(ghosts, hidden):
    """They stand like mannequins; the first cameras see neither of them."""
    people = np.repeat(two_people(20)[10:11], 60, 0)
    clip = haunted_clip(ghosts, 60, fixed=True, people=people)
    place = clip.rig.project(people)[0]
    off = np.linalg.norm(clip.detections.xy[:, :, :, None] - place[:, :, None], axis=-1)
    near = (median_over_frames(np.moveaxis(off, -1, 0)) < 12).any(-1)
    near[:, hidden:] = False
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    xy[near], score[near] = np.nan, np.nan
    poses = capture(replace(clip, detections=Detections2D(BODY25, xy, score)), CaptureConfig())
    assert sorted(rows_of(poses, people)) == [[0], [1]]
    assert poses.xyz.shape[1] == 2


def test_two_people_whom_one_view_each_showed_at_first_are_told_apart_later():
    """They stand on the line from a camera to one place, at which both cameras seem to see one person."""
    rig, place = looking_at_origin(3), np.zeros((60, 2, 1, 3))
    away = -rig.centers[[0, 2]] * (1, 1, 0)
    place[:, :, 0] = 0.3 * away / np.linalg.norm(away, axis=-1, keepdims=True)
    people = np.tile(t_pose(), (60, 2, 1, 1)) + place
    hidden = people.copy()
    xy, score = [], []
    for view, shown in enumerate((0, None, 1)):
        hidden[:6] = np.nan
        if shown is not None:
            hidden[:6, shown] = people[:6, shown]
        detected = detected_clip(hidden, rig=rig).detections
        xy.append(detected.xy[:, view])
        score.append(detected.score[:, view])
    detections = Detections2D(BODY25, np.stack(xy, 1), np.stack(score, 1))
    poses = capture(Clip("made up", 25.0, rig, detections), CaptureConfig())
    assert poses.xyz.shape[1] == 2
    assert np.nanmedian(errors(poses, people)) < 0.05


def unseen(clip: Clip, view: int, frames: slice) -> None:
    """Remove the first detection of a camera in some frames."""
    clip.detections.xy[frames, view, 0], clip.detections.score[frames, view, 0] = np.nan, np.nan


def test_somebody_who_walks_towards_one_of_two_cameras_is_no_ghost_at_rest():
    """For 1.6 s at 0.4 m/s, which one of the two cameras hardly shows."""
    clip = detected_clip(walk((-0.3, 0), (0.34, 0), frames=40)[:, None], views=3)
    unseen(clip, 2, slice(None))
    assert capture(clip, CaptureConfig()).xyz.shape[1] == 1


def test_a_slow_walker_whom_cameras_see_at_different_times_is_no_ghost_at_rest():
    """For 1.6 s at 0.35 m/s, among five ghosts in each view."""
    way = 0.28 * np.array([np.cos(2), np.sin(2)])
    people = walk(tuple(-way), tuple(way), frames=40)[:, None]
    clip = haunted_clip(5, 40, True, 5, people).select(views=[0, 2, 3])
    unseen(clip, 1, slice(22))
    unseen(clip, 2, slice(22, None))
    assert rows_of(capture(clip, CaptureConfig()), people) == [[0]]


def test_three_views_of_resting_ghosts_need_to_agree_better_than_by_chance_now_and_then():
    """Of this seed, 0.05 figures as convincing as one of the ghosts are expected by chance."""
    people = np.repeat(two_people(20)[10:11], 60, 0)
    assert capture(haunted_clip(20, 60, True, 5001, people), CaptureConfig()).xyz.shape[1] == 2


def test_nobody_is_lost_among_ghosts_in_a_short_clip():
    """One of the two is hidden in one camera, where there are as many ghosts as in the others."""
    clip = haunted_clip(100, 12, fixed=False)
    xy, score = clip.detections.xy.copy(), clip.detections.score.copy()
    xy[:, 0, 1], score[:, 0, 1] = np.nan, np.nan
    hidden = replace(clip, detections=Detections2D(BODY25, xy, score))
    poses = capture(hidden, CaptureConfig())
    assert sorted(rows_of(poses, two_people(12))) == [[0], [1]]
    assert poses.xyz.shape[1] == 2


def test_forty_people_within_70_cm_of_each_other_are_all_found():
    place = np.stack(np.divmod(np.arange(40), 7), -1) * 0.7 - 2.1
    turn = np.random.default_rng(0).uniform(-3, 3, 40)
    people = np.stack([walk(at, at + (0.1, 0), heading=a, frames=8) for at, a in zip(place, turn, strict=True)], 1)
    poses = capture(detected_clip(people, 5), CaptureConfig())
    assert poses.xyz.shape[1] == 40
    assert np.isfinite(errors(poses, people)).mean() > 0.97


@pytest.mark.parametrize("apart", [0.3, 0.4])
def test_somebody_who_appears_close_behind_a_person_is_found(apart):
    """Cameras in front see both near each other, so the new detections lie near the first person in all of them."""
    angle = np.radians([0, 25, -25])
    rig = looking_inwards(np.stack([4 * np.cos(angle), 4 * np.sin(angle), np.full(3, 1.6)], -1))
    people = np.stack([walk((0, 0), (0, 0), frames=20), walk((-apart, 0.05), (-apart, 0.05), frames=20)], 1)
    people[:6, 1] = np.nan
    poses = capture(detected_clip(people, rig=rig), CaptureConfig())
    assert rows_of(poses, people) == [[0], [1]]
    assert np.isfinite(errors(poses, people)[6:, 1]).mean() > 0.9


def test_a_joint_that_is_off_for_a_second_does_not_cost_the_person_meanwhile():
    """All views show the wrist a metre beside the person, so that its rays meet."""
    people = walk((-1, 0), (1, 0))[:, None].copy()
    people[40:65, :, BODY25.index("l_wrist")[0], 1] += 1.0
    poses = capture(detected_clip(people, views=3, miss=0, noise=1.0), CaptureConfig())
    assert poses.xyz.shape[1] == 1
    known = np.isfinite(poses.xyz[:, 0, :, 0])
    assert (known.sum(-1) >= 23).all()
    assert not known[40:65, BODY25.index("l_wrist")[0]].any()


def test_without_the_rule_coincidences_are_people():
    everything = replace(CaptureConfig(), tracking=TrackingConfig(max_by_chance=None))
    assert capture(haunted_clip(20, 12, True), everything).xyz.shape[1] > 10


def supported(figures: int, offset: float, views: int = 5, seen: int = 5, exchanged: int = 0) -> bool:
    """Whether a person is beyond chance, seen by some of the views, among so many figures in each view.

    The first views exchange the sides of the person, whose joints of one side were not triangulated from them.
    """
    rig, body, rng = looking_at_origin(views), t_pose(), np.random.default_rng(0)
    xy = rig.project(body[None])[0][0] + rng.normal(0, offset * 800 / 6, (views, 25, 2))
    left = [n for n, name in enumerate(BODY25.joints) if name.startswith("l_")]
    xy[:exchanged] = xy[:exchanged, list(BODY25.mirror)]
    assigned = np.where(np.arange(views) < seen, 0, -1)[None, :, None] * np.ones((1, 1, 25), int)
    used, counts = np.moveaxis(assigned >= 0, 1, 2).copy(), np.full(views, float(figures))
    used[:, left, :exchanged] = False
    focal, size = np.full(views, 800.0), np.full((views, 2), 960)
    given = rig.projections, focal, size, xy[:, None], assigned, body[None], used, counts
    found = expected_by_chance(*given, np.full(len(focal), np.inf), 0.1)
    assert (counts[:seen] == figures - (found[0] <= 0.1)).all()
    assert (counts[seen:] == figures).all()
    return bool(found[0] <= 0.1)


def test_more_figures_need_more_views_or_smaller_residuals():
    assert supported(1, 0.02, seen=2)
    assert not supported(5, 0.02, seen=2)
    assert supported(5, 0.02, seen=3)
    assert not supported(100, 0.03, seen=2)
    assert supported(100, 0.03, seen=4)
    assert not supported(100, 0.1, seen=3)
    assert supported(10, 0.1, seen=5)
    assert not supported(1000, 0.1, seen=5)


def test_a_view_with_exchanged_sides_does_not_speak_against_the_others():
    assert supported(150, 0.02, seen=4)
    assert supported(150, 0.02, seen=5, exchanged=1)


def test_pairs_of_unrelated_figures_are_as_many_as_expected():
    """Of all pairs of 150 ghosts in two views, those that are expected 150 times by chance."""
    clip, count = haunted_clip(150, 1, fixed=False).select(views=[0, 1]), 150
    detections = clip.detections
    ghosts = replace(clip, detections=Detections2D(BODY25, detections.xy[:, :, 2:], detections.score[:, :, 2:]))
    noise = learn_noise(haunted_clip(0, 10, fixed=True).select(views=[0, 1]), CaptureConfig())
    evidence = Evidence.of(ghosts, 0.2, CaptureConfig(), noise=noise)
    index = np.stack(np.divmod(np.arange(count**2), count), -1)[..., None]
    assigned = np.where(np.isnan(evidence.confidence[0])[[0, 1], index[..., 0]], -1, index)
    points = evidence.triangulate(assigned[None], 2)
    (xyz,), (used,), (start, end) = points.xyz, points.used, np.array(BODY25.bones).T
    length = np.linalg.norm(xyz[:, start] - xyz[:, end], axis=-1)
    bodies = ((~np.isnan(xyz[..., 0])).sum(-1) >= 4) & ~(length > 0.8).any(-1)
    agreeing = 0
    for pair in np.flatnonzero(bodies):
        figures, each = np.full(2, float(count)), slice(pair, pair + 1)
        agreeing += expected_by_chance(
            evidence.rig.projections, evidence.rig.focal, evidence.rig.size, evidence.xy[0],
            assigned[each], xyz[each], used[each], figures, np.full(len(figures), np.inf), 150.0,
        )[0] <= 150  # fmt: skip
    assert 15 <= agreeing <= 300


def test_a_person_of_one_view_or_without_joints_is_not_supported():
    assert not supported(1, 0.0, seen=1)
    rig, nothing = looking_at_origin(3), np.full((1, 25, 3), np.nan)
    found = expected_by_chance(
        rig.projections, np.full(3, 800.0), np.full((3, 2), 960), np.zeros((3, 1, 25, 2)), np.zeros((1, 3, 25), int),
        nothing, np.ones((1, 25, 3), bool), np.ones(3), np.full(3, np.inf), 0.1,
    )  # fmt: skip
    assert found[0] == np.inf


@pytest.mark.parametrize("strangers", [None, np.ones(5)])
def test_people_of_a_frame_alone_are_those_of_a_new_tracker(strangers):
    clip, config = haunted_clip(20, 12, fixed=True, seed=1), CaptureConfig()
    evidence = Evidence.of(clip, config.th_p, config)
    trackers = [Tracker(clip.detections.skeleton, clip.fps, config, strangers) for _ in range(4)]
    for frame, tracker in enumerate(trackers[1:]):
        found = tracker.step(evidence.at(frame)).assigned
        assert len(found) >= 2
        np.testing.assert_array_equal(trackers[0].alone(evidence.at(frame)), found)
