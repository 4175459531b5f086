"""Frozen checksums: one changed byte is found, and rounding differences are distinguished from other clips."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dmae.data.clip import Clip
from dmae.evaluation.benchmark.checksums import FrozenMatch, check_clip, clip_checksums, freeze
from tests.support.clips import full_clip

VERSIONS = {"numpy": "2.0", "mujoco": "3.6", "python": "3.11.1"}


@pytest.fixture
def clip() -> Clip:
    return replace(full_clip(), provenance={"versions": VERSIONS})


@pytest.fixture
def frozen(clip: Clip, tmp_path):
    file = tmp_path / "frozen.json"
    freeze({"1_self/a/000000": clip}, file)
    return file


def moved(clip: Clip, metres: float) -> Clip:
    return replace(clip, truth=replace(clip.truth, xyz=clip.truth.xyz + np.float32(metres)))


def test_the_same_clip_is_equal(clip: Clip, frozen):
    assert check_clip("1_self/a/000000", clip, frozen) == FrozenMatch.equal


def test_one_changed_byte_of_any_part_changes_its_checksum(clip: Clip):
    own = clip_checksums(clip)
    xy = clip.detections.xy.copy()
    xy.view(np.uint8)[0, 0, 0, 0, 0] ^= 1
    other = clip_checksums(replace(clip, detections=replace(clip.detections, xy=xy)))
    assert other["labels"] == own["labels"] and other["detections"] != own["detections"]
    visibility = clip.occlusion.visibility.copy()
    visibility[0, 0, 0, 0] ^= 1
    other = clip_checksums(replace(clip, occlusion=replace(clip.occlusion, visibility=visibility)))
    assert other["labels"] != own["labels"] and other["detections"] == own["detections"]


def test_other_bits_of_nan_are_the_same(clip: Clip):
    score = clip.detections.score.copy()
    bits = score.view(np.uint32)
    bits[np.isnan(score)] |= 1
    assert clip_checksums(replace(clip, detections=replace(clip.detections, score=score))) == clip_checksums(clip)


def test_clips_that_only_round_otherwise_are_near(clip: Clip, frozen):
    assert check_clip("1_self/a/000000", moved(clip, 0.002), frozen) == FrozenMatch.near
    python = replace(moved(clip, 0.002), provenance={"versions": VERSIONS | {"python": "3.12.0"}})
    assert check_clip("1_self/a/000000", python, frozen) == FrozenMatch.near


def test_another_clip_is_refused_with_its_name_and_the_likely_reason(clip: Clip, frozen):
    with pytest.raises(ValueError, match=r"clip 1_self/a/000000: its labels are not.*the generator was changed"):
        check_clip("1_self/a/000000", moved(clip, 0.2), frozen)
    other = replace(moved(clip, 0.002), provenance={"versions": VERSIONS | {"mujoco": "3.9"}})
    with pytest.raises(ValueError, match=re.escape("frozen with mujoco 3.6, here 3.9. Install the pinned versions")):
        check_clip("1_self/a/000000", other, frozen)
    with pytest.raises(ValueError, match="clip 1_self/a/000001: has no checksum"):
        check_clip("1_self/a/000001", clip, frozen)


def test_frozen_checksums_are_not_written_over(clip: Clip, frozen):
    before = frozen.read_text()
    with pytest.raises(ValueError, match="stored checksums are not overwritten"):
        freeze({"1_self/a/000000": moved(clip, 1)}, frozen)
    assert frozen.read_text() == before
