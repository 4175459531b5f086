"""Submissions that do not fit the benchmark are refused, and the error names the mismatch."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.completion.methods import find_method
from dmae.data.clip import Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import BODY25, COCO17, Skeleton
from dmae.data.store import save_clip
from dmae.evaluation.benchmark.clips import (
    CLIPS,
    GIVEN,
    Definition,
    clip_checksums,
    clip_of,
    freeze,
    given_clip,
    make_clips,
)
from dmae.evaluation.benchmark.holes import holes_of_capture
from dmae.evaluation.benchmark.page import benchmark_tables
from dmae.evaluation.benchmark.run import HandIn, Task, benchmark, check_same, differences
from dmae.evaluation.config import BenchmarkConfig, BenchmarkSize
from dmae.formats.own import export_npz
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from tests.support.benchmarks import IDS, simulate_here
from tests.support.clips import full_clip, walkers
from tests.support.commands import dmae

NAME = "1_self/apart/000000"
CAPTURED = walkers()
ODD = Skeleton("odd", ("tail",), (-1,))


def scaled(poses: Poses3D, factor: float) -> Poses3D:
    return replace(poses, xyz=poses.xyz * np.float32(factor))


def handed_in(poses: Poses3D, task: Task) -> Poses3D:
    return HandIn("mine", task, own=lambda *_: poses).poses(NAME, replace(full_clip(), poses=CAPTURED))


@pytest.mark.parametrize(
    ("poses", "message"),
    [
        (CAPTURED.xyz, "expected dmae.Poses3D, found ndarray"),
        (CAPTURED.select(slice(1, None)), "expected 12 frames .*found 11"),
        (walkers(persons=3), "expected 2 persons.*found 3"),
        (Poses3D(ODD, np.zeros((12, 2, 1, 3))), "no way from skeleton 'odd' to 'body25'"),
        (scaled(CAPTURED, 1000), "1000 times as long as the true ones, as if in mm"),
        (scaled(CAPTURED, 100), "as if in cm"),
        (replace(CAPTURED, xyz=np.where(CAPTURED.xyz > 1.6, np.inf, CAPTURED.xyz)), "infinite coordinates"),
    ],
)
def test_what_does_not_fit_is_named(poses, message):
    with pytest.raises(ValueError, match=f"mine, clip {NAME}: .*{message}"):
        handed_in(poses, Task.completion)


def test_poses_on_another_skeleton_are_converted():
    found = handed_in(convert(CAPTURED, COCO17), Task.completion)
    wrist = BODY25.index("r_wrist")
    np.testing.assert_array_equal(found.xyz[:, :, wrist], CAPTURED.xyz[:, :, wrist])
    assert found.skeleton == BODY25


def test_captures_may_have_any_number_of_persons_and_nothing_may_be_handed_in():
    handed_in(walkers(persons=3), Task.capture)
    handed_in(CAPTURED.without(np.ones(CAPTURED.source.shape, bool)), Task.completion)


@pytest.mark.parametrize("kind", ["npz", "clip"])
def test_folders_of_poses_are_read(tmp_path: Path, kind: str):
    clip = replace(full_clip(), poses=CAPTURED)
    if kind == "npz":
        export_npz(CAPTURED, 25.0, tmp_path / f"{NAME}.npz")
    else:
        save_clip(clip, tmp_path / NAME)
    hand_in = HandIn(str(tmp_path), Task.completion)
    hand_in.check([NAME])
    np.testing.assert_array_equal(hand_in.poses(NAME, clip).xyz, CAPTURED.xyz)
    with pytest.raises(ValueError, match=r"clip 1_self/apart/000000: expected 50 frames per second, found 25"):
        hand_in.poses(NAME, replace(clip, fps=50.0))


def test_clips_that_a_folder_lacks_are_named(tmp_path: Path):
    export_npz(CAPTURED, 25.0, tmp_path / f"{NAME}.npz")
    others = [f"2_edge/standing/00000{number}" for number in range(5)]
    with pytest.raises(FileNotFoundError, match=r"lacks 5 of 6 clips: 2_edge/standing/000000, .* and 2 more"):
        HandIn(str(tmp_path), Task.completion).check([NAME, *others])


def test_a_clip_without_poses_is_named(tmp_path: Path):
    save_clip(full_clip(), tmp_path / NAME)
    with pytest.raises(ValueError, match="000000"):
        HandIn(str(tmp_path), Task.completion).poses(NAME, replace(full_clip(), poses=CAPTURED))


@pytest.mark.parametrize(
    ("name", "task", "message"),
    [
        ("linar", Task.completion, "did you mean linear"),
        ("no_such_module:fill", Task.completion, "cannot import no_such_module"),
        ("triangulate", Task.capture, "captures=triangulate: expected capture, 4d_association, mvpose, "),
        ("tests.support.clips:nothing", Task.capture, "has no function 'nothing'"),
    ],
)
def test_unknown_hand_ins_are_refused_before_anything_is_computed(name, task, message):
    with pytest.raises(ValueError, match=message):
        HandIn(name, task).check([NAME])


def test_a_folder_called_as_a_method_does_not_hide_it(tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "linear").mkdir()
    assert HandIn("linear", Task.completion).folder is None
    assert HandIn("./linear", Task.completion).folder is not None


def test_a_published_system_is_a_capture():
    clip = full_clip()
    poses = HandIn("mvpose", Task.capture).poses(NAME, replace(clip, poses=CAPTURED))
    np.testing.assert_array_equal(poses.xyz, capture(clip, CaptureConfig(method="mvpose")).xyz)


@pytest.mark.parametrize(
    ("task", "body", "message"),
    [
        (Task.completion, "poses.nothing", r"AttributeError: .*nothing.* \(breaking_fill\.py, line 2\)"),
        (Task.completion, "{}['wrist']", r"KeyError: 'wrist' \(breaking_fill\.py, line 2\)"),
        (Task.capture, "int('x')", r"ValueError: .* \(breaking_fill\.py, line 2\)"),
    ],
)
def test_what_a_function_raises_is_told_with_the_function_and_the_clip(
    tmp_path: Path, monkeypatch, task, body, message
):
    arguments = "poses, fps" if task == Task.completion else "clip"
    (tmp_path / "breaking_fill.py").write_text(f"def fill({arguments}):\n    return {body}\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "breaking_fill", raising=False)
    hand_in = HandIn("breaking_fill:fill", task)
    with pytest.raises(ValueError, match=f"^breaking_fill:fill, clip 1_self/apart/000000: {message}$"):
        hand_in.poses(NAME, replace(full_clip(), poses=CAPTURED))


# The whole benchmark, on two clips of a second.


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


@pytest.mark.slow
def test_methods_see_no_truth(made: Path):
    given = given_clip(made, IDS[0])
    assert given.truth is given.occlusion is given.detection_labels is given.true_rig is None
    assert given.poses is not None and given.provenance == {}


@pytest.mark.slow
def test_clips_made_again_are_the_same_and_whole_ones_are_kept(
    tiny: Definition, made: Path, tmp_path: Path, monkeypatch
):
    simulate_here(monkeypatch)
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


@pytest.mark.slow
def test_a_mistake_in_a_function_is_found_on_the_first_set_of_clips(tiny: Definition, tmp_path: Path, monkeypatch):
    simulate_here(monkeypatch)
    asked = []

    def broken(poses, fps):
        asked.append([path.parent.name for path in (tmp_path / "data" / CLIPS).glob("*/*/[0-9]*")])
        raise ValueError("no such joint")

    config = BenchmarkConfig(name=tiny.file, methods=[], captures=[], out=str(tmp_path))
    with pytest.raises(ValueError, match=f"clip {IDS[0]}: ValueError: no such joint"):
        benchmark(config, methods=[broken])
    assert asked == [[Path(IDS[0]).parent.name]] and len({Path(name).parent for name in IDS}) > 1


@pytest.mark.slow
def test_another_benchmark_in_the_same_folder_is_refused(tiny: Definition, made: Path, tmp_path: Path):
    other = tmp_path / "tiny.yaml"
    other.write_text(Path(tiny.file).read_text().replace("seed: 5", "seed: 6"))
    with pytest.raises(ValueError, match=r"benchmark.json differs in seed"):
        benchmark(BenchmarkConfig(name=str(other), data_folder=str(made), out=str(tmp_path)))


@pytest.mark.slow
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
    with pytest.raises(
        ValueError, match=rf"clip {IDS[1]}: its detections differ from the benchmark .*mujoco 3.0.0, here"
    ):
        benchmark(config)


@pytest.mark.slow
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
    function = "dmae.completion.fillings:fill_pchip_body"
    methods = [truth, files, function, "pchip_body", nothing]
    scores = run(tiny, made, tmp_path, methods=methods, captures=["capture"], angles=True)
    completion = scores["completion"]
    assert completion[truth]["summary"]["mm"]["value"] == 0 and completion[truth]["summary"]["filled"] == 100
    assert completion[files] == completion[function] == completion["pchip_body"]
    assert completion["pchip_body"]["summary"]["mm"]["value"] > 5
    assert completion[nothing]["summary"]["mm"] is None and completion[nothing]["summary"]["seen"] is None
    assert scores["capture"][f"capture + {nothing}"]["summary"]["pcp"] is None
    assert scores["capture"][f"capture + {truth}"]["summary"]["pcp"] > scores["capture"]["capture"]["summary"]["pcp"]
    turned = {name: completion[name]["summary"]["angles"] for name in methods}
    assert turned[truth]["degrees"]["value"] < 0.5 < turned[files]["degrees"]["value"] < 20
    assert turned[truth]["determined"] == 100 and turned[nothing]["degrees"]["value"] is None
    text = [" ".join(row) for table in benchmark_tables(scores).values() for row in table.rows]
    assert any(row.startswith(f"{nothing} not measured") for row in text)
    json.dumps(scores, allow_nan=False)


@pytest.mark.slow
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
    assert (
        wrong.returncode == 1 and "expected scores of tiny size=full, found scores of tiny size=small" in wrong.stderr
    )


@pytest.mark.slow
def test_earlier_scores_of_other_holes_or_files_are_refused(tiny: Definition, made: Path, tmp_path: Path):
    scores = run(tiny, made, tmp_path, methods=["linear"], captures=[])
    other = json.loads(json.dumps(scores))
    cells = other["completion"]["linear"]["clips"][IDS[1]]
    cells["holes"][cells["holes"].index(max(cells["holes"]))] += 1
    with pytest.raises(ValueError, match=rf"clip {IDS[1]} has \d+ holes, then it had \d+"):
        differences(scores, other)
    with pytest.raises(ValueError, match="found scores of no benchmark"):
        check_same({"results": []}, "tiny", "small")
