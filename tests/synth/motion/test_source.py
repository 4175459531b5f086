"""Draw takes and cut them."""

import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf
from scipy.spatial.transform import Rotation

from dmae.data.resources import resource_folder
from synth.motion.config import MotionConfig
from synth.motion.motion import Motion
from synth.motion.source import cut, load_motion, read_take, takes
from synth.people.body import SEGMENTS
from tests.support.motion_files import amc, bvh


def turning(frames: int, fps: float = 30.0, rate: float = 1.0) -> Motion:
    """All segments turn about the vertical at `rate`, rad/s, as the root moves along y at 1 m/s."""
    times = np.arange(frames) / fps
    turns = Rotation.from_euler("z", rate * times[:, None]).as_matrix()
    root = np.stack([np.zeros(frames), times, np.ones(frames)], axis=1)
    return Motion("turning", fps, root, np.repeat(turns[:, None], len(SEGMENTS), axis=1), 0.9)


def heading(motion: Motion) -> np.ndarray:
    return np.unwrap(np.arctan2(motion.rotations[:, 0, 1, 0], motion.rotations[:, 0, 0, 0]))


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 1), st.floats(0.1, 3.9), st.floats(10, 240))
def test_cuts_follow_the_take_at_any_rate(start, seconds, fps):
    take = turning(121)
    motion = cut(take, start=start, seconds=seconds, fps=fps)
    assert len(motion) == max(round(seconds * fps), 1)
    times = motion.root[:, 1]
    assert np.allclose(np.diff(times), 1 / fps)
    assert times[0] >= -1e-9
    assert times[-1] <= 4 + 1e-9
    assert np.allclose(np.exp(1j * heading(motion)), np.exp(1j * times), atol=1e-9), "slerp is exact for uniform turns"


def test_a_whole_take_at_its_own_rate_is_unchanged():
    take = turning(121)
    motion = cut(take, start=0.7, seconds=121 / 30, fps=30)
    assert np.allclose(motion.root, take.root)
    assert np.allclose(motion.rotations, take.rotations)


@settings(max_examples=50, deadline=None)
@given(st.floats(0, 1), st.integers(2, 60))
def test_short_takes_are_played_back_and_forth_smoothly(start, frames):
    take = turning(frames)
    motion = cut(take, start=start, seconds=10, fps=120)
    assert len(motion) == 1200
    times = motion.root[:, 1]
    assert times.min() > -1e-9
    assert times.max() < (frames - 1) / 30 + 1e-9
    assert np.ptp(times) == pytest.approx((frames - 1) / 30, abs=0.01), "the whole take"
    speed = np.diff(times) * 120
    assert np.abs(speed).max() < 1 + 1e-6
    ease = min(0.3, (frames - 1) / 30)
    assert np.abs(np.diff(speed)).max() * 120 < 1 / ease * 1.01, "turns without a jerk"


def test_a_single_frame_is_held():
    motion = cut(turning(1), start=0.5, seconds=1, fps=50)
    assert len(motion) == 50
    assert np.ptp(motion.root, axis=0).max() == 0


def bent(frames: int) -> list[dict]:
    return [{"lShldr": (-80, 0, 0), "rShldr": (80, 0, 0), "lThigh": (0, -i / 4, 0)} for i in range(frames)]


def test_takes_are_drawn_from_all_files_of_a_folder(tmp_path):
    (tmp_path / "deeper").mkdir()
    for name in ("b.bvh", "a.bvh", "deeper/c.BVH"):
        bvh(tmp_path / name, bent(60))
    amc(tmp_path / "99_01.amc", [{}] * 3)
    config = MotionConfig(kind="bvh", path=str(tmp_path))
    assert [path.name for path in takes(config)] == ["a.bvh", "b.bvh", "c.BVH"]
    rng = np.random.default_rng(0)
    drawn = [load_motion(config, seconds=0.5, fps=25, rng=rng) for _ in range(20)]
    assert {motion.name[0] for motion in drawn} == {"a", "b", "c"}
    assert {len(motion) for motion in drawn} == {12}
    assert len({motion.name for motion in drawn}) > 10, "starts differ"
    again = load_motion(config, seconds=0.5, fps=25, rng=np.random.default_rng(0))
    assert np.array_equal(again.rotations, drawn[0].rotations)
    config = MotionConfig(kind="amc", path=str(tmp_path / "99_01.amc"))
    assert len(load_motion(config, seconds=2, fps=25, rng=rng)) == 50


def test_a_stated_rate_can_be_replaced(tmp_path):
    path = bvh(tmp_path / "take.bvh", bent(61), fps=120)
    assert read_take(path).fps == pytest.approx(120, abs=1e-3)
    assert read_take(path, 60.0).fps == 60


def test_takes_are_cached_until_their_file_changes(tmp_path):
    path = bvh(tmp_path / "take.bvh", bent(60))
    first = read_take(path)
    assert read_take(path) is first
    with pytest.raises(ValueError, match="read-only"):
        first.root[0] = 0
    bvh(path, bent(30))
    os.utime(path, ns=(1, 1))
    assert len(read_take(path)) == 30


@pytest.mark.parametrize(
    ("kind", "path", "error", "message"),
    [
        ("bvh", None, ValueError, r"motion=bvh: expected motion.path=<file, folder or list>"),
        ("bvh", "nowhere", FileNotFoundError, "nowhere: no such file or folder"),
        ("bvh", "empty", FileNotFoundError, r"empty: expected \.bvh files, found no files"),
        ("bvh", "others", FileNotFoundError, r"others: expected \.bvh files, found \['\.amc', '\.asf'\]"),
        ("amc", "others/99.asf", FileNotFoundError, r"99\.asf: expected \.amc files, found \['\.asf'\]"),
    ],
)
def test_missing_paths_and_files_are_refused(tmp_path, monkeypatch, kind, path, error, message):
    monkeypatch.chdir(tmp_path)
    for folder in ("empty", "others"):
        (tmp_path / folder).mkdir()
    amc(tmp_path / "others" / "99_01.amc", [{}])
    with pytest.raises(error, match=message):
        load_motion(MotionConfig(kind=kind, path=path), seconds=1, fps=25, rng=np.random.default_rng(0))


def test_procedural_motion_has_no_takes():
    with pytest.raises(
        ValueError, match=r"motion=procedural: expected motion=recorded\|.* and motion.path=<file, folder"
    ):
        takes(MotionConfig(path="walks"))


def test_the_procedural_preset_is_the_default():
    given = OmegaConf.load(resource_folder("dmae", "configs") / "motion/procedural.yaml")
    config = OmegaConf.to_object(OmegaConf.merge(OmegaConf.structured(MotionConfig), given))
    assert config == MotionConfig()
