"""Definitions of benchmarks: those that come with the package, and wrong ones."""

import json
import re
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from dmae.data.clip import Clip
from dmae.evaluation.benchmark.clips import (
    Definition,
    FrozenMatch,
    check_clip,
    clip_checksums,
    find_definition,
    freeze,
    make_clips,
)
from dmae.evaluation.config import BenchmarkSize
from tests.support.benchmarks import IDS, TINY
from tests.support.clips import full_clip


def test_the_shipped_benchmark_has_five_levels_of_one_cause_each():
    definition = find_definition("occlusion-v2")
    assert [level.name for level in definition.levels] == ["self", "person", "thing", "edge", "burst"]
    small, full = definition.sets(BenchmarkSize.small), definition.sets(BenchmarkSize.full)
    assert {each.level for each in small} == set(range(5))
    assert {name for each in small for name in each.ids} < {name for each in full for name in each.ids}
    assert len({each.seed for each in full}) == len(full)
    assert [(each.folder, each.options, each.seed) for each in small] == [
        (each.folder, each.options, each.seed) for each in full
    ]


def test_the_published_levels_rise_in_difficulty_and_are_of_their_cause():
    file = Path(__file__).parents[4] / "docs/results/benchmark_occlusion_v2.json"
    levels = json.loads(file.read_text())["scores"]["levels"]
    for figure in ("hidden", "linear"):
        found = [level[figure] for level in levels]
        assert all(harder >= 1.1 * easier for easier, harder in pairwise(found)), (figure, found)
    assert [level["name"] for level in levels if level["causes"][level["name"]] > 50] == [
        level.name for level in find_definition("occlusion-v2").levels
    ]


def test_every_clip_of_the_shipped_benchmark_is_frozen():
    definition = find_definition("occlusion-v2")
    frozen = json.loads(definition.checksums.read_text())["clips"]
    assert set(frozen) == {name for each in definition.sets(BenchmarkSize.full) for name in each.ids}


@pytest.mark.slow
def test_the_shipped_benchmark_is_made(tmp_path: Path, monkeypatch):
    """A generator that makes other clips needs other checksums: with the old ones every clip is refused."""
    definition = find_definition("occlusion-v2")
    (one,) = [each for each in definition.sets(BenchmarkSize.small) if each.folder == "2_person/crossing"]
    monkeypatch.setattr(Definition, "sets", lambda self, size: [one])
    make_clips(definition, BenchmarkSize.small, tmp_path)


def test_options_of_sets_come_after_those_of_levels_and_of_all(tiny: Definition):
    first, second = tiny.sets(BenchmarkSize.small)
    assert first.ids + second.ids == IDS
    assert second.options.index("rig.ring.focal=500") < second.options.index("rig.ring.focal=700")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("seed: 5", "seed: -1", "expected seed >= 0"),
        ("small: 1", "small: 3", "1 <= small <= full"),
        ("seed: 5", "sed: 5", r"expected the fields \[.*'seed'"),
        ("seed: 5", "seed: five", "tiny.yaml.seed: expected a whole number, found 'five'"),
        ("scene.gathering=1.0", "out=elsewhere", "option 'out=elsewhere': expected key=value of one of scene"),
        ("scene.gathering=1.0", "hydra.run.dir=elsewhere", "option 'hydra.run.dir=elsewhere'"),
        ("scene.gathering=1.0", "gathering", "option 'gathering'"),
        ("name: edge", "name: ../edge", "expected names of small letters.*'../edge'"),
        ("name: edge", "name: self", "each with a name of its own"),
        ("about: Apart", "about: [", "expected a benchmark"),
    ],
)
def test_a_wrong_definition_is_refused_with_its_file(tmp_path: Path, old: str, new: str, message: str):
    path = tmp_path / "tiny.yaml"
    path.write_text(TINY.replace(old, new))
    with pytest.raises(ValueError, match=message) as error:
        find_definition(str(path))
    assert str(path) in str(error.value)


def test_an_unknown_name_is_answered_with_the_nearest(tmp_path: Path):
    with pytest.raises(ValueError, match="did you mean occlusion-v2"):
        find_definition("oclusion-v1")
    with pytest.raises(FileNotFoundError, match="no such file"):
        find_definition(str(tmp_path / "none.yaml"))


# Frozen checksums: one changed byte is found, and rounding differences are distinguished from other clips.

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
    with pytest.raises(ValueError, match=r"clip 1_self/a/000000: its labels differ from.*the generator was changed"):
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
