"""Real takes: the same motion from each format, on the floor, heads up, with natural bending of joints."""

import csv
from pathlib import Path

import numpy as np
import pytest

from synth.motion.readers.takes import partner, true_fps
from synth.motion.source import read_take
from synth.people.body import SEGMENTS
from tests.support.stick_figure import elbows, joints, knees, soles

_TAKES = [
    ("asf_amc/02_01.amc", 343, 120),
    ("asf_amc/02_04.amc", 483, 120),
    ("asf_amc/49_18.amc", 1102, 120),
    # One frame of T-pose.
    ("bvh_mb/01_01.bvh", 2751, 120),
    ("bvh_mb/cmu_12_01_walk.bvh", 523, 120),
    # Six frames of it and out of it; the salsa's header says 120.
    ("bvh_daz/martial_07.bvh", 1467, 120),
    ("bvh_daz/salsa_05.bvh", 1673, 60),
    # Roots on the floor, and at the hips; with a T-pose, and without.
    ("bvh_cc/002_01.bvh", 171, 60),
    ("bvh_cc/005_01.bvh", 299, 60),
    ("bvh_cc/007_04.bvh", 224, 60),
]


@pytest.fixture(scope="module")
def cmu(data_folder) -> Path:
    return data_folder / "cmu"


@pytest.mark.parametrize(("take", "frames", "fps"), _TAKES)
def test_people_stand_on_the_floor_upright(cmu, take, frames, fps):
    motion = read_take(cmu / take)
    assert (len(motion), round(motion.fps)) == (frames, fps)
    # Even in jumps and kicks, the lower foot is on the floor most of the time.
    lowest = soles(motion)[..., 2].min((1, 2))
    assert abs(np.median(lowest)) < 0.03
    assert np.percentile(lowest, 2) > -0.06
    assert np.percentile(joints(motion)[:, SEGMENTS.index("head"), 2], 10) > 0.8
    assert np.median(motion.rotations[:, SEGMENTS.index("head"), 2, 2]) > 0.5


@pytest.mark.parametrize(("take", "frames", "fps"), _TAKES)
def test_hinges_bend_within_human_range(cmu, take, frames, fps):
    motion = read_take(cmu / take)
    assert np.degrees(knees(motion).min()) > -3
    assert np.degrees(elbows(motion).min()) > -3
    assert np.degrees(elbows(motion).max()) < 165
    # The elbow bends in the plane given by the upper arm.
    for upper, lower in (("l_upper_arm", "l_forearm"), ("r_upper_arm", "r_forearm")):
        forearm = motion.rotations[:, SEGMENTS.index(lower), :, 1]
        out_of_plane = np.einsum("fi,fi->f", motion.rotations[:, SEGMENTS.index(upper), :, 2], forearm)
        assert np.abs(out_of_plane).max() < 0.15


@pytest.mark.parametrize(
    "take", ["asf_amc/02_01.amc", "bvh_mb/cmu_12_01_walk.bvh", "bvh_cc/007_01.bvh", "bvh_cc/007_12.bvh"]
)  # fmt: skip
def test_walking_is_forward_with_opposite_limbs(cmu, take):
    motion = read_take(cmu / take)
    step = np.diff(motion.root[:, :2], axis=0)
    facing = motion.rotations[:-1, 0, :2, 0]
    cosine = (step * facing).sum(1) / np.linalg.norm(step, axis=1) / np.linalg.norm(facing, axis=1)
    assert cosine.mean() > 0.95
    ahead = np.einsum("fji,fi->fj", joints(motion) - motion.root[:, None], motion.rotations[:, 0, :, 0])
    left, right = (
        np.corrcoef(*(ahead[:, SEGMENTS.index(name)] for name in pair))[0, 1]
        for pair in (("l_hand", "r_foot"), ("r_hand", "l_foot"))
    )
    assert min(left, right) > 0.5


def test_amc_and_bvh_of_one_take_agree(cmu):
    acclaim, builder = read_take(cmu / "asf_amc/01_01.amc"), read_take(cmu / "bvh_mb/01_01.bvh")
    apart = np.linalg.norm(joints(acclaim) - joints(builder), axis=-1)
    assert apart.max() < 0.005


def test_amc_and_another_skeleton_of_one_take_agree(cmu):
    # Every second frame, on an avatar whose feet another program put back on the floor.
    acclaim, avatar = joints(read_take(cmu / "asf_amc/02_01.amc"))[1::2], joints(read_take(cmu / "bvh_cc/002_01.bvh"))
    assert len(acclaim) == len(avatar)
    assert np.abs(acclaim[:, 0, 2] - avatar[:, 0, 2]).mean() < 0.03
    apart = np.linalg.norm((acclaim - acclaim[:, :1]) - (avatar - avatar[:, :1]), axis=-1).mean(0)
    assert apart.max() < 0.03
    trunk_and_arms = slice(0, SEGMENTS.index("l_thigh"))
    assert apart[trunk_and_arms].max() < 0.012


def test_partners_dance_together(cmu):
    path = cmu / "bvh_daz/salsa_05.bvh"
    one, other = read_take(path), read_take(partner(path))
    assert partner(path).name == "salsa_20.bvh"
    assert partner(partner(path)) == path
    assert len(one) == len(other)
    apart = np.linalg.norm((one.root - other.root)[:, :2], axis=1)
    assert 0.5 < np.median(apart) < 0.9
    towards = other.root - one.root
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    assert np.median((towards * one.rotations[:, 0, :, 0]).sum(1)) > 0.5, "they face each other"
    hands = [joints(motion)[:, [SEGMENTS.index("l_hand"), SEGMENTS.index("r_hand")]] for motion in (one, other)]
    assert np.linalg.norm(hands[0][:, :, None] - hands[1][:, None], axis=-1).min((1, 2)).min() < 0.25


def test_takes_of_one_person_have_no_partner(cmu):
    assert partner(cmu / "bvh_daz/martial_04.bvh") is None
    assert partner(cmu / "asf_amc/02_01.amc") is None


@pytest.mark.parametrize(
    ("stem", "stated", "fps"),
    [
        ("salsa_05", 120.0, 60.0),
        ("60_05", 120.0, 60.0),
        ("061_05", 60.0, 60.0),
        ("60_05", 30.0, 30.0),
        ("02_01", 120.0, 120.0),
        ("take", 120.0, 120.0),
    ],
)
def test_wrongly_stated_rates_are_corrected(stem, stated, fps):
    assert true_fps(stem, stated) == fps


def test_rates_agree_with_the_index_of_the_database(cmu):
    with (cmu / "cmu_index_framerates.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["framerate"] in ("60", "120")]
    assert len(rows) > 2000
    # Conversions state 120 for all.
    told = {(row["Subject"], row["Trial #"]): true_fps(f"{row['Subject']}_{row['Trial #']}", 120.0) for row in rows}
    index = {(row["Subject"], row["Trial #"]): float(row["framerate"]) for row in rows}
    assert told == index
