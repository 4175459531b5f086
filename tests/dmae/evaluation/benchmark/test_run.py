"""The whole benchmark, on two clips of a second."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from dmae.completion.methods.registry import find_method
from dmae.data.clip import Poses3D
from dmae.evaluation.benchmark.checksums import clip_checksums, freeze
from dmae.evaluation.benchmark.clips import CLIPS, GIVEN, clip_of, given_clip, make_clips
from dmae.evaluation.benchmark.definition import BenchmarkSize, Definition
from dmae.evaluation.benchmark.differences import check_same, differences
from dmae.evaluation.benchmark.holes import holes_of_capture
from dmae.evaluation.benchmark.run import BenchmarkConfig, benchmark
from dmae.evaluation.benchmark.tables import benchmark_tables
from dmae.formats.npz import export_npz
from tests.support.benchmarks import IDS
from tests.support.commands import dmae

pytestmark = pytest.mark.slow


def run(tiny: Definition, made: Path, tmp_path: Path, **options) -> dict:
    return benchmark(BenchmarkConfig(name=tiny.file, data_folder=str(made), out=str(tmp_path), **options))


def hand_in(folder: Path, made: Path, poses_of) -> str:
    """Write what `poses_of(id, given clip)` makes of each clip, and return the folder."""
    for name in IDS:
        given = given_clip(made, name)
        export_npz(poses_of(name, given), given.fps, folder / f"{name}.npz")
    return str(folder)


def truth_of(made: Path, name: str, given) -> Poses3D:
    """The true poses in the order of the captured persons."""
    holes = holes_of_capture(clip_of(made, name), given.poses)
    xyz = given.poses.xyz.copy()
    frame, person = np.nonzero(holes.matches >= 0)
    xyz[frame, holes.matches[frame, person]] = holes.truth.xyz[frame, person]
    return Poses3D(given.poses.skeleton, xyz)


def test_methods_see_no_truth(made: Path):
    given = given_clip(made, IDS[0])
    assert given.truth is given.occlusion is given.detection_labels is given.true_rig is None
    assert given.poses is not None and given.provenance == {}


def test_clips_made_again_are_the_same_and_whole_ones_are_kept(tiny: Definition, made: Path, tmp_path: Path):
    data = tmp_path / "data"
    shutil.copytree(made, data)
    for lost in (data / CLIPS / IDS[0], data / GIVEN / IDS[0]):
        shutil.rmtree(lost)
    kept = (data / CLIPS / IDS[1] / "clip.json").stat().st_mtime_ns
    make_clips(tiny, BenchmarkSize.small, data)
    assert (data / CLIPS / IDS[1] / "clip.json").stat().st_mtime_ns == kept
    for name in IDS:
        assert clip_checksums(clip_of(data, name)) == clip_checksums(clip_of(made, name))
        np.testing.assert_array_equal(given_clip(data, name).poses.xyz, given_clip(made, name).poses.xyz)


def test_another_benchmark_in_the_same_folder_is_refused(tiny: Definition, made: Path, tmp_path: Path):
    other = tmp_path / "tiny.yaml"
    other.write_text(Path(tiny.file).read_text().replace("seed: 5", "seed: 6"))
    with pytest.raises(ValueError, match=r"benchmark.json differs in seed"):
        benchmark(BenchmarkConfig(name=str(other), data_folder=str(made), out=str(tmp_path)))


def test_frozen_checksums_are_compared(tiny: Definition, made: Path, tmp_path: Path):
    definition = tmp_path / "tiny.yaml"
    shutil.copy(tiny.file, definition)
    checksums = tmp_path / "tiny.checksums.json"
    config = BenchmarkConfig(
        name=str(definition), data_folder=str(made), out=str(tmp_path), methods=["linear"], captures=[]
    )
    assert benchmark(config)["checksums"] == "unchecked"
    freeze({name: clip_of(made, name) for name in IDS}, checksums)
    assert benchmark(config)["checksums"] == "equal"
    frozen = json.loads(checksums.read_text())
    frozen["clips"][IDS[1]]["detections"] = "0" * 64
    frozen["versions"]["mujoco"] = "3.0.0"
    checksums.write_text(json.dumps(frozen))
    with pytest.raises(ValueError, match=rf"clip {IDS[1]}: its detections are not those.*mujoco 3.0.0, here"):
        benchmark(config)


def test_the_truth_scores_0_files_as_functions_and_nothing_is_not_measured(
    tiny: Definition, made: Path, tmp_path: Path
):
    truth = hand_in(tmp_path / "truth", made, lambda name, given: truth_of(made, name, given))
    filled = find_method("pchip_body").function
    files = hand_in(tmp_path / "files", made, lambda name, given: filled(given.poses, given.fps))
    nothing = hand_in(
        tmp_path / "nothing",
        made,
        lambda name, given: given.poses.without(np.ones(given.poses.source.shape, bool)),
    )
    function = "dmae.completion.methods.pchip_body:fill_pchip_body"
    scores = run(tiny, made, tmp_path, methods=[truth, files, function, "pchip_body", nothing], captures=["capture"])
    completion = scores["completion"]
    assert completion[truth]["summary"]["mm"]["value"] == 0 and completion[truth]["summary"]["filled"] == 100
    assert completion[files] == completion[function] == completion["pchip_body"]
    assert completion["pchip_body"]["summary"]["mm"]["value"] > 5
    assert completion[nothing]["summary"]["mm"] is None and completion[nothing]["summary"]["seen"] is None
    assert scores["capture"][f"capture + {nothing}"]["summary"]["pcp"] is None
    assert scores["capture"][f"capture + {truth}"]["summary"]["pcp"] > scores["capture"]["capture"]["summary"]["pcp"]
    text = [" ".join(row) for table in benchmark_tables(scores).values() for row in table.rows]
    assert any(row.startswith(f"{nothing} not measured") for row in text)
    json.dumps(scores, allow_nan=False)


def test_a_command_prints_the_tables_and_a_second_hand_in_is_compared(tiny: Definition, made: Path, tmp_path: Path):
    (tmp_path / "mine.py").write_text(
        "from dmae.numerics.filling import fill_world\n"
        "from dmae.numerics.paths import hold\n"
        "def fill(poses, fps):\n"
        "    return fill_world(poses, fps, hold)\n"
    )
    shared = (f"name={tiny.file}", f"data_folder={made}")
    first = dmae(tmp_path, "benchmark", *shared, "methods=[linear,measured]", "out=first")
    assert first.returncode == 0, first.stderr
    assert "measured not measured" in " ".join(first.stdout.split())
    assert "There are no published checksums" in first.stdout
    assert {path.name for path in (tmp_path / "first").iterdir()} == {"scores.json", "benchmark.html", "config.yaml"}
    second = dmae(
        tmp_path, "benchmark", *shared, "methods=[mine:fill,linear]", "captures=[]", "against=first", "out=second"
    )
    assert second.returncode == 0, second.stderr
    found = json.loads((tmp_path / "second/scores.json").read_text())["differences"]
    assert [(each["method"], each["against"]) for each in found] == [("mine:fill", "linear"), ("linear", "linear")]
    assert found[1]["mm"]["value"] == 0 and found[0]["mm"]["value"] != 0
    wrong = dmae(tmp_path, "benchmark", *shared, "size=full", "against=first", "out=third")
    assert wrong.returncode == 1 and "expected scores of tiny size=full, found those of tiny size=small" in wrong.stderr


def test_earlier_scores_of_other_holes_or_files_are_refused(tiny: Definition, made: Path, tmp_path: Path):
    scores = run(tiny, made, tmp_path, methods=["linear"], captures=[])
    other = json.loads(json.dumps(scores))
    cells = other["completion"]["linear"]["clips"][IDS[1]]
    cells["holes"][cells["holes"].index(max(cells["holes"]))] += 1
    with pytest.raises(ValueError, match=rf"clip {IDS[1]} has \d+ holes, then it had \d+"):
        differences(scores, other)
    with pytest.raises(ValueError, match="found those of no benchmark"):
        check_same({"results": []}, "tiny", "small")
