"""Completion of frames as they come is completion of the recording so far, as far as it is remembered."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from dmae.calibrate import CLASSES
from dmae.capture import CaptureConfig
from dmae.clip import Poses3D, Source
from dmae.commands import CompleteCommand, run_complete
from dmae.online import OnlineCapture
from dmae.skeleton import BODY25, SHELF14
from dmae.store import load_clip, save_clip
from dmae.stream import FinishedFrame, OnlineCompleter, apart, joined, replayed
from dmae.weights import save_model

from .completing import FPS, strolling, untrained, with_holes
from .film import crossing, film
from .strollers import clip_of


def pushed(online: OnlineCompleter, poses: Poses3D, step: int = 1) -> list[list[FinishedFrame]]:
    """What comes out by each push of so many frames."""
    frames = apart(poses, np.arange(poses.xyz.shape[1]))
    return [online.push(frames[start : start + step]) for start in range(0, len(frames), step)]


@pytest.mark.parametrize(("fps", "step", "delay"), [(25.0, 1, 0.28), (25.0, 5, 0.28), (25.0, 1, 0.0), (50.0, 7, 0.2)])
def test_each_frame_is_as_in_the_last_seconds_up_to_the_one_pushed(fps, step, delay):
    """For longer than what is remembered; until then that is the whole recording."""
    poses = with_holes(strolling(0, frames=round(9 * fps), persons=2), 0)
    completer, people = untrained(factors=((1.0,) * CLASSES,) * 2), np.arange(2)
    online = OnlineCompleter(completer, fps, delay)
    assert online.delay == round(delay * fps)
    expected = 0
    frames = apart(poses, people)
    for number, start in enumerate(range(0, len(frames), step)):
        began, finished = online.began, online.push(frames[start : start + step])
        known = min(start + step, len(frames))
        assert began <= max(expected - 5 * fps, 0)
        assert [frame.number for frame in finished] == list(range(expected, max(known - online.delay, expected)))
        if finished and number % 20 == 0:
            whole = completer(poses.select(slice(began, known)), fps)
            now = slice(expected - began, known - online.delay - began)
            offline, found = whole.select(now), joined(finished, people)
            np.testing.assert_array_equal(found.source, offline.source)
            np.testing.assert_allclose(found.xyz, offline.xyz, atol=1e-4)
            np.testing.assert_allclose(found.cov, offline.cov, rtol=1e-3)
        expected += len(finished)


def test_at_the_end_nothing_is_left_and_nothing_lost():
    poses, completer = with_holes(strolling(1, frames=60), 1), untrained()
    done = replayed(completer, poses, FPS)
    offline = completer(poses, FPS)
    assert done.xyz.shape == offline.xyz.shape
    assert done.xyz[poses.measured].tobytes() == poses.xyz[poses.measured].tobytes()
    online = OnlineCompleter(completer, FPS)
    late = sum(map(len, pushed(online, poses)))
    rest = online.flush()
    assert late + len(rest) == 60 and online.flush() == []
    tail = joined(rest, np.arange(3))
    np.testing.assert_allclose(tail.xyz, offline.xyz[late:], atol=1e-5)


def test_later_knowledge_helps():
    """A joint hidden to the end of what is known is extrapolated; with more delay, interpolated."""
    truth = strolling(2, frames=100)
    poses = with_holes(truth, 2)
    errors = []
    for delay in (0.0, 1.0):
        done = replayed(untrained(), poses, FPS, delay)
        filled = done.source == Source.COMPLETED
        errors.append(np.linalg.norm(done.xyz - truth.xyz, axis=-1)[filled].mean())
    assert errors[1] < 0.95 * errors[0]


def test_who_is_unseen_comes_out_if_seen_again_within_the_delay():
    xyz = strolling(3).xyz.copy()
    xyz[20:24, 0], xyz[20:40, 1] = np.nan, np.nan
    done = replayed(untrained(), Poses3D(SHELF14, xyz), FPS, 0.4)
    assert (done.source[20:24, 0] == Source.COMPLETED).all()
    assert not done.source[20:29, 1].any()
    assert (done.source[32:40, 1] == Source.COMPLETED).all()


def test_memory_does_not_grow_with_the_recording():
    frames = apart(with_holes(strolling(4, frames=25, persons=1), 4), np.arange(1))
    online, held = OnlineCompleter(untrained(), FPS), []
    tracemalloc.start()
    for second in range(36):
        online.push([replace(frame, number=second * 25 + frame.number, people=np.array([second])) for frame in frames])
        if second % 12 == 11:
            held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    assert held[2] < 1.1 * held[0] + 50_000


def test_nobody_and_bad_delays():
    nobody = Poses3D(SHELF14, np.empty((12, 0, 14, 3)))
    assert replayed(untrained(), nobody, FPS).xyz.shape == (12, 0, 14, 3)
    assert replayed(untrained(), strolling(0).select(slice(0)), FPS).xyz.shape == (0, 3, 14, 3)
    for fps, delay in ((0.0, 0.1), (np.nan, 0.1), (FPS, -0.1), (FPS, np.nan)):
        with pytest.raises(ValueError, match="fps must be positive and delay not negative"):
            OnlineCompleter(untrained(), fps, delay)


def test_capture_while_it_happens_completes_what_it_captures():
    clip = film(crossing(), views=3, miss=0.4)
    completer = untrained()
    plain, complete = (
        OnlineCapture(clip.rig, BODY25, clip.fps, CaptureConfig(), complete=given) for given in (None, completer)
    )
    assert complete.delay == plain.delay + 7
    captured, finished = [], []
    for frame in range(len(clip)):
        captured += plain.push(clip.select(frames=[frame]).detections)
        finished += complete.push(clip.select(frames=[frame]).detections)
        assert len(finished) >= frame + 1 - complete.delay
    captured, finished = captured + plain.flush(), finished + complete.flush()
    assert [frame.number for frame in finished] == list(range(len(clip)))
    people = np.unique(np.concatenate([frame.people for frame in captured]))
    before, after = joined(captured, people), joined(finished, people)
    np.testing.assert_array_equal(after.xyz[before.measured], before.xyz[before.measured])
    limbs = BODY25.index(*(joint for joint in SHELF14.joints if joint in BODY25.joints))
    there = before.measured.any(-1)[:, :, None] & np.isin(np.arange(25), limbs)
    assert (before.source[there] == Source.ABSENT).mean() > 0.01
    assert (after.source[there] != Source.ABSENT).all()


def test_the_command_tells_what_online_would_have_given(tmp_path):
    poses = with_holes(strolling(5), 5)
    save_clip(replace(clip_of(poses, "walk"), poses=poses), tmp_path / "clip")
    save_model(untrained().model, SHELF14, tmp_path / "model", {"denoises": False, "calibration": None})
    command = CompleteCommand(str(tmp_path / "clip"), str(tmp_path / "model"), online=True, delay=0.12)
    run_complete(command, tmp_path / "out")
    expected = replayed(untrained(), poses, FPS, 0.12)
    np.testing.assert_array_equal(load_clip(tmp_path / "out").poses.xyz, expected.xyz)
