"""Capture frame by frame, against capture of the whole clip."""

from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip, Detections2D, Source
from dmae.data.skeleton import BODY25
from dmae.metrics.comparison import match, take_matched
from dmae.online.capture import FinishedFrame, OnlineCapture
from dmae.reconstruction.config import CaptureConfig, ReassignmentConfig, TrackingConfig
from dmae.reconstruction.noise import DetectionNoise
from dmae.reconstruction.pipeline import capture, learn_noise
from tests.support.clips import looking_at_origin
from tests.support.detected_people import FPS, FRAMES, crossing, detected_clip, rows_of, walk
from tests.support.ghosts import haunted_clip, two_people

DEFAULT = CaptureConfig()


def feed(clip: Clip, config: CaptureConfig = DEFAULT, noise: DetectionNoise | None = None) -> list[FinishedFrame]:
    """Push all frames of a clip one by one; no result may be later than the delay."""
    online = OnlineCapture(clip.rig, clip.detections.skeleton, clip.fps, config, noise=noise)
    finished = []
    for frame in range(len(clip)):
        finished += online.push(clip.select(frames=[frame]).detections)
        assert len(finished) >= frame + 1 - online.delay
    finished += online.flush()
    assert [frame.number for frame in finished] == list(range(len(clip)))
    assert online.flush() == []
    return finished


def together(finished: list[FinishedFrame]) -> np.ndarray:
    """(F, P, J, 3) joints, a row for each person in the order of their numbers."""
    people = np.unique(np.concatenate([frame.people for frame in finished]))
    xyz = np.full((len(finished), len(people), len(BODY25), 3), np.nan)
    for frame in finished:
        xyz[frame.number, np.searchsorted(people, frame.people)] = frame.poses.xyz[0]
    return xyz


def agreement(online: np.ndarray, offline: np.ndarray) -> float:
    """Share of the joints captured offline that are within 2 cm of them online, in one row for each row."""
    matches = match(online, offline)
    assert all(len(set(row[row >= 0])) == 1 for row in matches.T)
    assert online.shape[1] == offline.shape[1]
    known = ~np.isnan(offline[..., 0])
    off = np.linalg.norm(take_matched(online, matches) - offline, axis=-1)[known]
    return (off < 0.02).mean()


@pytest.mark.parametrize("views", [3, 5])
def test_people_who_cross_are_captured_as_offline(views):
    clip = detected_clip(crossing(), views)
    noise = learn_noise(clip, DEFAULT)
    assert agreement(together(feed(clip, noise=noise)), capture(clip, DEFAULT, noise).xyz) > 0.99


def test_finished_frames_state_the_source_of_joints():
    for frame in feed(detected_clip(crossing(), miss=0.4)):
        absent = np.isnan(frame.poses.xyz).any(-1)
        assert ((frame.poses.source == Source.ABSENT) == absent).all()
        assert (frame.poses.views[~absent] >= 2).all()
        assert (np.linalg.eigvalsh(frame.poses.cov[~absent]) > 0).all()
        assert len(set(frame.people)) == len(frame.people) == frame.poses.xyz.shape[1]


def test_a_person_who_re_enters_soon_keeps_the_number():
    people = crossing().copy()
    people[30:62, 1] = np.nan
    poses = replace(detected_clip(people).truth, xyz=together(feed(detected_clip(people))), source=None)
    assert sorted(rows_of(poses, people)) == [[0], [1], [2]]


def test_a_track_of_a_moment_is_no_person():
    people = np.stack([walk((-1, 0), (1, 0)), walk((0, 1.2), (0, 1.2))], 1)
    people[:50, 1], people[54:, 1] = np.nan, np.nan
    assert together(feed(detected_clip(people))).shape[1] == 1


@pytest.mark.parametrize("seed", [3000, 3004])
def test_figures_that_stay_in_the_images_are_no_people(seed):
    """Two people who stand, among figures that agree by chance in every frame, some of them for less than a second."""
    standing = np.repeat(two_people(20)[10:11], 80, 0)
    numbers = [len(frame.people) for frame in feed(haunted_clip(20, 80, True, seed, standing))]
    assert numbers[-60:] == [2] * 60


def test_the_delay_is_the_time_that_steps_look_ahead():
    rig = looking_at_origin(4)
    assert 0.4 < OnlineCapture(rig, BODY25, FPS, DEFAULT).delay / FPS <= 0.6
    nothing_ahead = CaptureConfig(
        tracking=TrackingConfig(min_duration_s=0), reassignment=ReassignmentConfig(distance_m=0), prune=False
    )
    assert OnlineCapture(rig, BODY25, FPS, nothing_ahead).delay / FPS < 0.2


def test_a_shorter_look_ahead_is_a_shorter_delay():
    clip = detected_clip(crossing())
    for look_ahead, delay in ((0.2, 7), (0.0, 2)):
        online = OnlineCapture(clip.rig, BODY25, FPS, DEFAULT, look_ahead=look_ahead)
        assert online.delay == delay
        finished = [done for frame in range(60) for done in online.push(clip.select(frames=[frame]).detections)]
        assert len(finished) >= 60 - delay
        assert all(frame.people.tolist() == [0, 1, 2] for frame in finished[10:])
    with pytest.raises(ValueError, match="look_ahead=-1: expected seconds, 0 or more"):
        OnlineCapture(clip.rig, BODY25, FPS, DEFAULT, look_ahead=-1)


def test_zero_people_and_zero_frames_are_valid_results():
    empty = Detections2D(BODY25, np.empty((FRAMES, 4, 0, 25, 2)), np.empty((FRAMES, 4, 0, 25)))
    finished = feed(replace(detected_clip(crossing()), detections=empty))
    assert all(frame.poses.xyz.shape == (1, 0, 25, 3) for frame in finished)
    assert OnlineCapture(looking_at_origin(4), BODY25, FPS, DEFAULT).flush() == []


def test_people_survive_frames_in_which_no_camera_detects_anyone():
    clip = detected_clip(crossing())
    online = OnlineCapture(clip.rig, BODY25, FPS, DEFAULT)
    nothing = Detections2D(BODY25, np.empty((1, len(clip.rig), 0, 25, 2)), np.empty((1, len(clip.rig), 0, 25)))
    finished = [
        done
        for frame in range(60)
        for done in online.push(nothing if 30 <= frame < 34 else clip.select(frames=[frame]).detections)
    ]
    finished += online.flush()
    assert [frame.people.tolist() for frame in (finished[20], finished[50])] == [[0, 1, 2]] * 2


def test_frames_of_another_shape_are_refused():
    clip = detected_clip(crossing())
    with pytest.raises(ValueError, match="expected one frame of body25, found 2 of body25"):
        OnlineCapture(clip.rig, BODY25, FPS, DEFAULT).push(clip.select(frames=[0, 1]).detections)
    with pytest.raises(ValueError, match="3 cameras but detections in 4 views"):
        OnlineCapture(clip.rig[:3], BODY25, FPS, DEFAULT).push(clip.select(frames=[0]).detections)
    with pytest.raises(ValueError, match="capture needs at least 2 cameras, found 1"):
        OnlineCapture(clip.rig[:1], BODY25, FPS, DEFAULT)


@pytest.mark.slow
def test_shelf_is_captured_as_offline(shelf):
    # A live capture learns no noise from the recording.
    prior = replace(DEFAULT, noise=replace(DEFAULT.noise, learn=False))
    for views in ([0, 1, 2, 3, 4], [0, 1, 3]):
        clip = shelf.select(views=views)
        assert agreement(together(feed(clip)), capture(clip, prior).xyz) > 0.98
