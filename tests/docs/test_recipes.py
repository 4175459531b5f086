"""The code of the front page and of the how-to page that adds something: it runs, and what it adds works."""

import importlib
import json
import re
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml
from scipy.spatial.transform import Rotation

import dmae
import synth
from dmae.completion.methods import completion_method
from dmae.data.clip import Detections2D
from dmae.evaluation.corruption.registry import corruption
from dmae.formats.registry import reader
from dmae.metrics.registry import metric
from synth.datasets.exporters import exporter
from synth.interactions.registry import interaction
from tests.support.animal_files import write_deeplabcut
from tests.support.animals import DOG, dog_clip
from tests.support.commands import run_command

PAGES = Path(__file__).parents[2] / "docs/how-to"


@pytest.fixture
def recipe(tmp_path: Path, monkeypatch):
    """Import the code of a section of the page as a module of its own, registered until the end of the test."""
    monkeypatch.syspath_prepend(tmp_path)
    for registry in (reader, metric, completion_method, corruption, interaction, exporter):
        monkeypatch.setattr(registry, "_added", {})

    def load(title: str):
        section = (PAGES / "add.md").read_text().split(f"\n## {title}\n")[1].split("\n## ")[0]
        (code,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
        name = f"recipe_{title.split()[-1]}"
        (tmp_path / f"{name}.py").write_text(code)
        sys.modules.pop(name, None)
        return importlib.import_module(name)

    return load


@pytest.mark.slow
def test_the_front_page(tmp_path: Path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", (PAGES.parents[1] / "README.md").read_text(), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(code, {})
    score, _, unit = capsys.readouterr().out.partition(" ")
    assert float(score) > 80 and unit == "% strict PCP\n"
    assert (tmp_path / "frame.png").is_file() and list(tmp_path.glob("poses*.trc"))


def test_a_format(recipe, small_clip, tmp_path: Path):
    from dmae.formats.calibrations import write_calibration

    recipe("A format")
    found = small_clip.detections
    values = np.concatenate([found.xy, found.score[..., None]], -1)
    (tmp_path / "lizard.json").write_text(json.dumps(values.tolist()))
    write_calibration(small_clip.rig, tmp_path / "calibration.toml", "pose2sim")
    for clip in (dmae.read(tmp_path, fps=25), dmae.read(tmp_path, format="recipe_format:read_lizard")):
        np.testing.assert_array_equal(clip.detections.xy, found.xy)
    (tmp_path / "lizard.json").write_text("[" * 100_000)
    with pytest.raises(ValueError, match=r"lizard\.json: expected JSON, "):
        dmae.read(tmp_path, fps=25)


def test_a_metric(recipe, small_clip):
    recipe("A metric")
    scores = dmae.evaluate(small_clip, dmae.capture(small_clip))
    assert scores["jerkiness"] > 0


def test_a_corruption(recipe, small_clip):
    recipe("A corruption")
    for name in ("shade", "recipe_corruption:shade"):
        shaded = dmae.corrupt(small_clip, {name: 20}).detections
        assert 0 < shaded.observed.sum() < small_clip.detections.observed.sum()


def test_a_completion_method(recipe, small_clip):
    recipe("A completion method")
    captured = dmae.capture(small_clip)
    filled = dmae.capture(small_clip, fill="recipe_method:fill_midpoint")
    np.testing.assert_array_equal(filled.xyz[captured.measured], captured.xyz[captured.measured])
    assert (filled.source == dmae.Source.COMPLETED).any()


def test_an_interaction(recipe):
    recipe("An interaction")
    interaction = synth.InteractionConfig(kind="recipe_interaction:face_off")
    clip = next(synth.generate(clips=1, seconds=1, interaction=interaction, scene="studio", seed=1))
    assert clip.truth.xyz.shape[1] == 2


def test_a_detector_error(recipe, tmp_path: Path):
    module = recipe("A detector error")
    (tmp_path / "keeps_views.py").write_text(
        "VIEWS = []\n\ndef keep(view, *, rng):\n    VIEWS.append(view)\n    return view\n"
    )
    detector = synth.preset("detector", "shelf_openpose", custom=["keeps_views:keep"])
    next(synth.generate(clips=1, seconds=1, detector=detector))
    for view in importlib.import_module("keeps_views").VIEWS:
        np.testing.assert_array_equal(module.Blackouts().apply(view).score, view.score)
        band = module.Blackouts(share=0.5).apply(view).xy[..., 1]
        assert not (band > view.size[1] / 2).any()


def test_a_layout(recipe, small_clip, tmp_path: Path):
    recipe("An export layout")
    dmae.save(small_clip, tmp_path / "walk")
    for index, layout in enumerate(("nose_paths", "recipe_layout:export_nose_paths")):
        synth.export(tmp_path / "walk", tmp_path / f"noses{index}", layout)
        (table,) = (tmp_path / f"noses{index}").glob("train_*.csv")
        persons = small_clip.truth.xyz.shape[1]
        assert np.loadtxt(table, delimiter=",", ndmin=2).shape == (len(small_clip), 3 * persons)


def test_a_skeleton(tmp_path: Path):
    """The page's file is a skeleton, and its commands run on a recording of such animals."""
    pytest.importorskip("tables", reason="pandas writes DeepLabCut's files by PyTables")
    page = (PAGES / "skeleton.md").read_text()
    (tmp_path / "dog.yaml").write_text(re.search(r"```yaml\n(.*?)```", page, re.DOTALL)[1])
    skeleton = dmae.get_skeleton(str(tmp_path / "dog.yaml"))
    clip = dog_clip(45)
    joints = DOG.index(*(name.replace("_paw", "_fore_paw") for name in skeleton.joints))
    detections = Detections2D(skeleton, clip.detections.xy[..., joints, :], clip.detections.score[..., joints])
    (tmp_path / "recordings/dog").mkdir(parents=True)
    write_deeplabcut(tmp_path / "recordings/dog", replace(clip, detections=detections, truth=None))
    first, *_ = re.findall(r"```text\n(.*?)```", page, re.DOTALL)
    for line in first.splitlines():
        done = run_command(tmp_path, *shlex.split(line, comments=True))
        assert done.returncode == 0, done.stderr
    for name in ("dog_review.csv", "dog/report.html", "dog.nc", "dog.c3d"):
        assert (tmp_path / "runs" / name).is_file()
    poses = dmae.read_poses(tmp_path / "runs/dog.nc").poses
    assert poses.skeleton == skeleton
    error = np.linalg.norm(poses.xyz[:, 0] - clip.truth.xyz[:, 0, joints], axis=-1)
    assert np.nanmedian(error) < 0.02


@pytest.mark.slow
def test_a_training_loop_of_your_own(small_clip, tmp_path: Path, monkeypatch):
    section = (PAGES / "fine_tune.md").read_text().split("\n## In your own training loop\n")[1]
    (code,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    torch.manual_seed(0)
    exec(code, names)
    truth = dmae.to_skeleton(small_clip.truth, "coco17").xyz
    windows = np.concatenate([truth[start : start + 15].swapaxes(0, 1) for start in range(len(truth) - 14)])
    hips = windows[:, :, names["skeleton"].index("l_hip", "r_hip")].mean((1, 2), keepdims=True)
    x = torch.tensor(windows - hips, dtype=torch.float32)
    losses = [names["step"](x[torch.randperm(len(x))[:8]]) for _ in range(10)]
    assert losses[-1] < 0.5 * losses[0]

    captured = dmae.to_skeleton(dmae.capture(small_clip), "coco17")
    holes = np.zeros(captured.source.shape, bool)
    holes[3:6, :, captured.skeleton.index("l_wrist", "r_ankle")] = True
    names["save_model"](names["network"], names["skeleton"], "own", {})
    completed = dmae.complete(captured.without(holes), small_clip.fps, weights="own", smooth=0)
    assert (completed.source[holes] == dmae.Source.COMPLETED).all()
    np.testing.assert_array_equal(completed.xyz[captured.measured & ~holes], captured.xyz[captured.measured & ~holes])


def test_a_table_of_joints_has_the_errors_of_evaluate(small_clip, tmp_path: Path, monkeypatch, capsys):
    section = (PAGES / "benchmark.md").read_text().split("\n## Joint by joint, in pandas\n")[1]
    code, comparison = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    dmae.save(small_clip, "runs/test")
    names: dict = {}
    exec(code, names)
    assert "l_wrist" in capsys.readouterr().out
    exec(comparison, names)
    assert re.match(r"-?\d+\.\d+ \[nan, nan\] False$", capsys.readouterr().out)
    table, poses = names["table"], dmae.complete(dmae.capture(small_clip), small_clip.fps)
    scores = dmae.evaluate(small_clip, poses, skeleton="body25")["mpjpe"]
    assert table["error"].mean() == pytest.approx(scores["all"], rel=1e-4)
    assert names["completed"]["error"].mean() == pytest.approx(scores["completed"], rel=1e-4)
    assert (table[["visible", "hidden_by_self", "hidden_by_person"]].sum(axis=1) <= len(small_clip.rig)).all()
    assert (names["completed"]["gap"] > 0).all() and (table[table["source"] == "DENOISED"]["gap"] == 0).all()


def test_joint_angles_without_a_recording(tmp_path: Path):
    """The page's commands run as they stand, and write what it says."""
    section = (PAGES / "biomechanics.md").read_text().split("\n## To try")[1]
    (commands,) = re.findall(r"```text\n(.*?)```", section.split("\n## ")[0], re.DOTALL)
    for line in commands.splitlines():
        done = run_command(tmp_path, *line.split())
        assert done.returncode == 0, done.stderr
    assert all((tmp_path / name).is_file() for name in ("walk.mot", "walk.angles.csv", "walk.trc"))
    angles, *_ = (
        line.split() for line in done.stdout.split("Joint angles of the legs")[1].splitlines() if " dmae " in line
    )
    assert all(0 < float(error) < 10 for error in angles[2:5])


@pytest.fixture(scope="module")
def small_clip():
    return next(synth.generate(seconds=1, clips=1, seed=2)).select(views=[0, 1, 3])


@pytest.mark.slow
def test_the_workflow_that_guards_scores_runs(tmp_path: Path):
    """The commands of the page make a baseline, and the steps of the workflow compare with it."""
    page = (PAGES / "gates.md").read_text()
    steps = yaml.safe_load(re.search(r"```yaml\n(.*?)```", page, re.DOTALL)[1])["jobs"]["scores"]["steps"]
    runs = [step["run"].split() for step in steps if step.get("run", "").startswith(("synth", "dmae"))]
    first, *_ = re.findall(r"```text\n(.*?)```", page, re.DOTALL)
    baseline = [line.split() for line in first.splitlines() if line.startswith(("synth", "dmae"))]
    assert [each[0] for each in (*baseline, *runs)] == ["synth", "dmae", "synth", "dmae"]
    assert baseline[0] == runs[0]
    for program, *arguments in (*baseline, runs[1]):
        done = run_command(tmp_path, program, *arguments)
        assert done.returncode == 0, done.stderr
    assert "passed: of" in done.stdout


def test_angles_are_plotted_and_compared_with_those_of_a_laboratory(tmp_path: Path, monkeypatch, capsys):
    """The laboratory is our own export, 0.4 s later and 3 degrees more, and our own joints."""
    page = (PAGES / "biomechanics.md").read_text()
    plot, pelvis, compare, joints = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    clip = next(synth.generate(seconds=3, clips=1, persons=[1, 1], scene="studio", seed=7))
    clip = replace(clip, occlusion=None, detection_labels=None)
    poses = dmae.to_skeleton(clip.truth, "body25")
    turned = poses.xyz @ Rotation.from_euler("y", -20, degrees=True).as_matrix().astype(np.float32)
    poses = replace(poses, xyz=turned)  # The person does not face x, and one side is lower
    dmae.save(replace(clip, poses=poses), "runs/completed")
    dmae.export(clip, "walk.mot", poses=poses)
    dmae.export(clip, "lab.trc", poses=poses)
    exec(plot + pelvis, found := {})
    assert Path("knee.png").stat().st_size > 10_000
    left, right = poses.xyz[:, 0, poses.skeleton.index("l_hip", "r_hip")].swapaxes(0, 1)
    across, forward = left - right, np.cross(left - right, (0, 0, 1))
    rise = np.degrees(np.arcsin(across[:, 2] / np.linalg.norm(across, axis=1)))
    # y of the TRC's world is up, z is x of the clip's, and x is its y.
    facing = np.degrees(np.arctan2(-forward[:, 0], forward[:, 1]))
    assert np.abs(rise).min() > 10
    np.testing.assert_allclose(found["obliquity"], rise, atol=4)
    np.testing.assert_allclose((found["rotation"] - facing + 180) % 360 - 180, 0, atol=7)
    names, *rows = Path("walk.mot").read_text().split("endheader\n")[1].splitlines()
    values = [[float(cell) for cell in row.split("\t")] for row in rows]
    moved = [[row[0] + 0.4, *(value + 3 for value in row[1:])] for row in values]
    lines = ["lab", "endheader", names, *("\t".join(map(str, row)) for row in moved)]
    Path("lab.mot").write_text("\n".join(lines) + "\n")
    exec(compare, {})
    assert capsys.readouterr().out == "0.40 s later; bias -3.0, RMSE without it 0.0 degrees\n"
    exec(joints, {})
    assert "'all': 0.0" in capsys.readouterr().out
