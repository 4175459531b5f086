"""Recordings with faults: frozen and jumping frames, rates that gravity contradicts, feet on platforms."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from synth.motion.motion import Motion
from synth.motion.readers.takes import partner
from synth.motion.retargeting import correct_rate, level_floor, repair
from synth.motion.source import read_take
from synth.people.body import SEGMENTS
from tests.support.stick_figure import elbows, joints, soles

_PATH = Path("take.bvh")


def walk(frames: int = 480, fps: float = 120.0) -> Motion:
    """A body that glides along x at 1 m/s and sways a little."""
    time = np.arange(frames) / fps
    root = np.stack([time, 0.05 * np.sin(3 * time), np.full(frames, 0.9)], 1)
    turns = Rotation.from_euler("z", 0.2 * np.sin(2 * time)[:, None]).as_matrix()
    return Motion("take", fps, root, np.repeat(turns[:, None], len(SEGMENTS), axis=1), 0.9)


def changed(motion: Motion, frames: slice, root: np.ndarray) -> Motion:
    moved = motion.root.copy()
    moved[frames] = root
    return Motion(motion.name, motion.fps, moved, motion.rotations, motion.hip_height)


def test_sound_motion_is_returned_as_it_is():
    motion = walk()
    assert repair(motion, _PATH) is motion


def test_frozen_frames_before_a_jump_are_bridged():
    motion = walk()
    frozen = changed(motion, slice(200, 223), motion.root[200])
    frozen.rotations[200:223] = frozen.rotations[200]
    frozen.root[223:, 0] += 0.2
    mended = repair(frozen, _PATH)
    assert "22 frames bridged" in mended.name
    assert len(mended) == len(motion)
    assert np.linalg.norm(np.diff(mended.root, axis=0), axis=1).max() * 120 < 2.5
    assert np.abs(mended.root[:201] - motion.root[:201]).max() == 0


def test_a_person_who_stands_still_is_no_fault():
    motion = walk()
    still = changed(motion, slice(200, 300), motion.root[200])
    still.root[300:] -= motion.root[300] - still.root[299]
    still.rotations[200:] = still.rotations[200]
    assert repair(still, _PATH) is still


def test_a_jump_is_cut_and_the_longest_stretch_is_left():
    jumped = changed(walk(), slice(100, None), walk().root[100:] + (0, 0.5, 0))
    mended = repair(jumped, _PATH)
    assert (len(mended), mended.first) == (380, 100)
    assert "frames 101-480 of 480" in mended.name


def test_takes_with_nothing_sound_are_refused():
    motion = walk(200)
    motion.root[::40, 1] += np.where(np.arange(5) % 2, 0.0, 0.4)
    motion.root[20:, 1] += 0.5 * (np.arange(180) // 60)
    with pytest.raises(ValueError, match=r"take.bvh: joints jump .* are valid; expected at least 1 s"):
        repair(motion, _PATH)


@pytest.mark.parametrize(("true", "stated", "read"), [(60, 120, 60), (120, 120, 120), (100, 100, 100), (50, 100, 100)])
def test_a_stated_120_at_which_people_fall_too_fast_is_halved(true, stated, read):
    time = np.arange(true * 2) / true
    motion = walk(len(time), stated)
    air = (time > 0.8) & (time < 1.4)
    height = np.where(air, 0.9 + 9.81 / 2 * (time - 0.8) * (1.4 - time), 0.9)
    motion.root[:, 2] = height
    assert correct_rate(motion).fps == read


def test_feet_on_platforms_do_not_raise_the_floor():
    rng = np.random.default_rng(0)
    ankles = np.zeros((1200, 2, 3))
    for spot in range(24):
        place = (*rng.uniform(-2, 2, 2), 0.1 if spot % 3 == 0 else 0.9)
        ankles[50 * spot : 50 * spot + 50] = place
        ankles[50 * spot : 50 * spot + 50, 1, 2] += 0.3
    turn, height = level_floor(ankles, 120, 0.08)
    assert height == pytest.approx(0.02, abs=0.003)
    assert np.degrees(np.arccos(turn[2, 2])) < 0.2


@pytest.fixture(scope="module")
def more(data_folder) -> Path:
    return data_folder / "cmu_more"


@pytest.mark.slow
@pytest.mark.parametrize("take", ["01_03", "01_06", "01_07", "01_11"])
def test_climbers_stand_on_the_floor_and_hang_above_it(more, take):
    motion = read_take(more / f"asf_amc/{take}.amc.xz")
    lowest = soles(motion)[..., 2].min((1, 2))
    assert -0.12 < lowest.min() < 0.02, "the floor of the file is y = 0"
    assert 0.7 < motion.root[:, 2].max() < 1.9
    speed = np.linalg.norm(np.diff(motion.root, axis=0), axis=1) * motion.fps
    assert speed.max() < 5, "01_07 freezes for 23 frames and then jumps at 25 m/s"


@pytest.mark.parametrize(("take", "fps"), [("backflip", 60), ("pirouette", 120), ("kick", 120)])
def test_character1_is_read(more, take, fps):
    motion = read_take(more / f"bvh_mass/{take}.bvh.xz")
    assert round(motion.fps) == fps
    lowest = soles(motion)[..., 2].min((1, 2))
    assert abs(np.median(lowest)) < 0.03
    assert 0.45 < motion.root[:, 2].min() < motion.root[:, 2].max() < 1.6
    assert np.degrees(elbows(motion).min()) > -3
    # The elbow bends in the plane given by the upper arm.
    for upper, lower in (("l_upper_arm", "l_forearm"), ("r_upper_arm", "r_forearm")):
        forearm = motion.rotations[:, SEGMENTS.index(lower), :, 1]
        out = np.einsum("fi,fi->f", motion.rotations[:, SEGMENTS.index(upper), :, 2], forearm)
        assert np.abs(out).max() < 0.2


def test_the_two_files_of_a_pirouette_agree(more):
    one, other = (read_take(more / name) for name in ("bvh_mass/pirouette.bvh.xz", "bvh_cc/005_13.bvh.xz"))
    # Frame 0 of the one is frame 231 of the other, which has half as many a second.
    count = min(len(one) // 2, len(other) - 231)
    heights = [joints(one)[: 2 * count : 2, 0, 2], joints(other)[231 : 231 + count, 0, 2]]
    assert np.corrcoef(*heights)[0, 1] > 0.8


@pytest.mark.slow
def test_partners_stay_together_where_one_take_is_cut(more):
    path = more / "bvh_daz/salsa_11.bvh.xz"
    one, other = read_take(path), read_take(partner(path))
    assert one.first > 0
    apart = one.root - other.root[one.first : one.first + len(one)]
    assert 0.5 < np.median(np.linalg.norm(apart[:, :2], axis=1)) < 0.95
