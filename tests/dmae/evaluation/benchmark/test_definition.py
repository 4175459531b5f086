"""Definitions of benchmarks: those that come with the package, and wrong ones."""

import json
from pathlib import Path

import pytest

from dmae.evaluation.benchmark.definition import BenchmarkSize, Definition, find_definition
from tests.support.benchmarks import IDS, TINY


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
        assert found == sorted(set(found)), figure
    assert [max(level["causes"], key=level["causes"].get) for level in levels] == [level["name"] for level in levels]


def test_every_clip_of_the_shipped_benchmark_is_frozen():
    definition = find_definition("occlusion-v2")
    frozen = json.loads(definition.checksums.read_text())["clips"]
    assert set(frozen) == {name for each in definition.sets(BenchmarkSize.full) for name in each.ids}


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
        ("seed: 5", "seed: five", "tiny.yaml.seed: expected int, found 'five'"),
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
    with pytest.raises(ValueError, match="did you mean 'occlusion-v2'"):
        find_definition("oclusion-v1")
    with pytest.raises(FileNotFoundError, match="no such file"):
        find_definition(str(tmp_path / "none.yaml"))
