"""Online completion equals completion of the last seconds of the recording so far."""

import gc
import tracemalloc
from dataclasses import replace
from itertools import pairwise
from threading import Event

import numpy as np
import pytest

import dmae
from dmae.commands import complete as command
from dmae.commands.config import CompleteCommand
from dmae.completion.complete import CLASSES, Completer
from dmae.completion.weights import save_model
from dmae.data.clip import Poses3D, Source
from dmae.data.skeleton import BODY25, SHELF14
from dmae.data.store import load_clip, save_clip
from dmae.online.capture import OnlineCapture
from dmae.online.completion import FinishedFrame, OnlineCompleter, complete_online, join_frames, split_frames
from dmae.reconstruction.config import CaptureConfig
from tests.support.circling_people import clip_of
from tests.support.completers import FPS, circling, untrained, with_holes
from tests.support.detected_people import crossing, detected_clip


def pushed(online: OnlineCompleter, poses: Poses3D, step: int = 1) -> list[list[FinishedFrame]]:
    """Return the frames that each push of `step` frames returns."""
    frames = split_frames(poses, np.arange(poses.xyz.shape[1]))
    return [online.push(frames[start : start + step]) for start in range(0, len(frames), step)]


@pytest.mark.slow
@pytest.mark.parametrize(("fps", "step", "delay"), [(25.0, 1, 0.28), (25.0, 5, 0.28), (25.0, 1, 0.0), (50.0, 7, 0.2)])
def test_each_frame_equals_offline_completion_of_the_last_seconds(fps, step, delay):
    """Over more seconds than are kept; until then the whole recording is. The second to fourth come in at once."""
    second = round(fps)
    poses = with_holes(circling(0, frames=6 * second, persons=2), 0)
    completer, people = untrained(factors=((1.0,) * CLASSES,) * 2), np.arange(2)
    online = OnlineCompleter(completer, fps, delay)
    assert online.delay == round(delay * fps)
    expected = 0
    frames = split_frames(poses, people)
    ends = [*range(step, second, step), 4 * second, *range(4 * second + step, len(frames), step), len(frames)]
    for number, (start, known) in enumerate(pairwise([0, *ends])):
        first_kept = online._frames[0].number if online._frames else 0
        finished = online.push(frames[start:known])
        assert first_kept <= max(expected - 5 * fps, 0)
        assert [frame.number for frame in finished] == list(range(expected, max(known - online.delay, expected)))
        if finished and number % 10 == 0:
            whole = completer(poses.select(slice(first_kept, known)), fps)
            now = slice(expected - first_kept, known - online.delay - first_kept)
            offline, found = whole.select(now), join_frames(finished, people)
            np.testing.assert_array_equal(found.source, offline.source)
            np.testing.assert_allclose(found.xyz, offline.xyz, atol=1e-4)
            np.testing.assert_allclose(found.cov, offline.cov, rtol=1e-3)
        expected += len(finished)


def test_frames_completed_in_the_background_are_completed_alike():
    """Each is completed by what is known up to four frames later than where frames are completed one by one."""
    poses, completer = with_holes(circling(1, frames=90), 1), untrained()
    one_by_one, in_turns = OnlineCompleter(completer, FPS), OnlineCompleter(completer, FPS, turn=5)
    # Five frames come in until a turn begins, and five until it is over.
    assert in_turns.delay == one_by_one.delay + 9
    people, done = np.arange(3), []
    for online in (one_by_one, in_turns):
        returned = [frame for frames in pushed(online, poses) for frame in frames]
        assert len(returned) == 90 - online.delay
        returned += online.flush()
        assert [frame.number for frame in returned] == list(range(90))
        done.append(join_frames(returned, people))
    np.testing.assert_array_equal(done[0].xyz[poses.measured], done[1].xyz[poses.measured])
    np.testing.assert_array_equal(done[0].source[20:], done[1].source[20:])
    filled = done[0].source == Source.COMPLETED
    assert np.median(np.linalg.norm(done[0].xyz - done[1].xyz, axis=-1)[filled]) < 0.01


class Slow(Completer):
    """Completes when it is let."""

    let = Event()

    def __call__(self, *given) -> Poses3D:
        assert self.let.wait(20)
        return super().__call__(*given)


def test_pushes_do_not_wait_before_frames_are_due():
    poses, fast = with_holes(circling(1, frames=40), 1), untrained()
    quick, slow = (OnlineCompleter(kind(fast.model, fast.skeleton), FPS, turn=8) for kind in (Completer, Slow))
    frames = split_frames(poses, np.arange(3))
    # The first turn begins when eight frames are known for 0.28 s, the second eight frames later.
    early = [frame for frame in frames[:22] for frame in slow.push([frame])]
    assert not early and slow.delay == 22
    Slow.let.set()
    late = [frame for frame in frames[22:] for frame in slow.push([frame])] + slow.flush()
    expected = [frame for frame in frames for frame in quick.push([frame])] + quick.flush()
    people = np.arange(3)
    assert join_frames(late, people).xyz.tobytes() == join_frames(expected, people).xyz.tobytes()


def test_flush_returns_all_frames_that_wait():
    poses, completer = with_holes(circling(1, frames=60), 1), untrained()
    done = complete_online(completer, poses, FPS)
    offline = completer(poses, FPS)
    assert done.xyz.shape == offline.xyz.shape
    assert done.xyz[poses.measured].tobytes() == poses.xyz[poses.measured].tobytes()
    online = OnlineCompleter(completer, FPS)
    late = sum(map(len, pushed(online, poses)))
    rest = online.flush()
    assert late + len(rest) == 60 and online.flush() == []
    tail = join_frames(rest, np.arange(3))
    np.testing.assert_allclose(tail.xyz, offline.xyz[late:], atol=1e-5)


def test_a_longer_delay_reduces_the_error():
    """A joint hidden up to the last known frame is extrapolated; with more delay it is interpolated."""
    truth = circling(2, frames=100)
    poses = with_holes(truth, 2)
    errors = []
    for delay in (0.0, 1.0):
        done = complete_online(untrained(), poses, FPS, delay)
        filled = done.source == Source.COMPLETED
        errors.append(np.linalg.norm(done.xyz - truth.xyz, axis=-1)[filled].mean())
    assert errors[1] < 0.95 * errors[0]


def test_an_absent_person_is_completed_if_measured_again_within_the_delay():
    xyz = circling(3).xyz.copy()
    xyz[20:24, 0], xyz[20:40, 1] = np.nan, np.nan
    done = complete_online(untrained(), Poses3D(SHELF14, xyz), FPS, 0.4)
    assert (done.source[20:24, 0] == Source.COMPLETED).all()
    assert not done.source[20:29, 1].any()
    assert (done.source[32:40, 1] == Source.COMPLETED).all()


@pytest.mark.slow
def test_memory_does_not_grow_with_the_recording():
    frames = split_frames(with_holes(circling(4, frames=25, persons=1), 4), np.arange(1))
    online, held = OnlineCompleter(untrained(), FPS), []
    tracemalloc.start()
    for second in range(24):
        online.push([replace(frame, number=second * 25 + frame.number, people=np.array([second])) for frame in frames])
        if second % 8 == 7:
            gc.collect()
            held.append(tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()
    # The poses of 16 seconds would be 1 MB; what libraries keep for themselves is less than 100 kB.
    assert held[2] - held[0] < 250_000


def test_empty_poses_and_impossible_delays():
    nobody = Poses3D(SHELF14, np.empty((12, 0, 14, 3)))
    assert complete_online(untrained(), nobody, FPS).xyz.shape == (12, 0, 14, 3)
    assert complete_online(untrained(), circling(0).select(slice(0)), FPS).xyz.shape == (0, 3, 14, 3)
    for fps, delay in ((0.0, 0.1), (np.nan, 0.1), (FPS, -0.1), (FPS, np.nan)):
        with pytest.raises(ValueError, match="fps must be positive and delay not negative"):
            OnlineCompleter(untrained(), fps, delay)


def test_online_capture_completes_what_it_captures():
    clip = detected_clip(crossing(), views=3, miss=0.4)
    completer = untrained()
    plain, complete = (
        OnlineCapture(clip.rig, BODY25, clip.fps, CaptureConfig(), complete=given) for given in (None, completer)
    )
    # 0.28 s, until a turn begins, and until it is over.
    assert complete.delay == plain.delay + 7 + 7 + 8
    captured, finished = [], []
    for frame in range(len(clip)):
        captured += plain.push(clip.select(frames=[frame]).detections)
        finished += complete.push(clip.select(frames=[frame]).detections)
        assert len(finished) >= frame + 1 - complete.delay
    captured, finished = captured + plain.flush(), finished + complete.flush()
    assert [frame.number for frame in finished] == list(range(len(clip)))
    people = np.unique(np.concatenate([frame.people for frame in captured]))
    before, after = join_frames(captured, people), join_frames(finished, people)
    np.testing.assert_array_equal(after.xyz[before.measured], before.xyz[before.measured])
    limbs = BODY25.index(*(joint for joint in SHELF14.joints if joint in BODY25.joints))
    there = before.measured.any(-1)[:, :, None] & np.isin(np.arange(25), limbs)
    assert (before.source[there] == Source.ABSENT).mean() > 0.01
    assert (after.source[there] != Source.ABSENT).all()


def test_the_command_completes_as_online_would(tmp_path):
    poses = with_holes(circling(5), 5)
    save_clip(replace(clip_of(poses, "walk"), poses=poses), tmp_path / "clip")
    save_model(untrained().model, SHELF14, tmp_path / "model", {"denoises": False, "calibration": None})
    config = CompleteCommand(str(tmp_path / "clip"), str(tmp_path / "model"), online=True, delay=0.12)
    command.run(config, tmp_path / "out")
    # By default the command rejects and smooths; weights that were not trained to denoise do not.
    expected = complete_online(replace(untrained(), reject=True, smooth=0.1), poses, FPS, 0.12)
    np.testing.assert_array_equal(load_clip(tmp_path / "out").poses.xyz, expected.xyz)


def test_a_delay_of_whole_clips_is_refused():
    with pytest.raises(ValueError, match=r"delay=0\.2: whole clips have no delay; add online=true"):
        CompleteCommand("clip", delay=0.2)
    with pytest.raises(ValueError, match=r"delay=-5: whole clips have no delay"):
        dmae.complete(circling(5), FPS, delay=-5)
