"""`import dmae` and `import synth`: light, typed, and every verb's example runs."""

import doctest
import inspect
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import MISSING, fields, replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import dmae
import synth
from dmae.data.store import MANIFEST, write_manifest
from dmae.data.typed import type_hints
from dmae.formats.calibrations import write_calibration
from dmae.formats.reading import recognise
from tests.support.benchmarks import simulate_here
from tests.support.commands import run_command

VERBS = sorted(
    (module.__name__, name)
    for module, home in ((dmae, "dmae.verbs"), (synth, "synth"))
    for name in module.__all__
    if inspect.isfunction(getattr(module, name)) and getattr(module, name).__module__.startswith(home)
)

generate, render, train = synth.generate, synth.render, dmae.train


@cache
def generated(**options) -> tuple[dmae.Clip, ...]:
    """Clips that nothing is written of are made once for all tests."""
    return tuple(generate(**options))


@pytest.fixture(scope="module")
def beginnings(tmp_path_factory) -> dict[str, Callable]:
    """Verbs that most examples begin with: the first to give options has its folder made, the others copied."""
    kept: dict[str, Path] = {}

    def once(key: str, out: str | Path, make: Callable) -> Path:
        if key in kept:
            shutil.copytree(kept[key], out)
        else:
            make()
            kept[key] = shutil.copytree(out, tmp_path_factory.mktemp("kept") / "made")
        return Path(out)

    def generate_once(*config, out=None, **options) -> Iterator[dmae.Clip]:
        if config:
            return generate(*config, out=out, **options)
        if out is None:
            return iter(generated(**options))
        return iter(dmae.load_dataset(once(f"generate {options}", out, lambda: generate(out=out, **options))))

    def render_once(data, *, out, **options) -> Iterator[dmae.Clip]:
        key = f"render {Path(data, MANIFEST).read_text()} {options}"
        return iter(dmae.load_dataset(once(key, out, lambda: render(data, out=out, **options))))

    def train_once(clips: Iterable[dmae.Clip], out, config) -> Path:
        return once(f"train {[clip.id for clip in clips]} {config}", out, lambda: train(clips, out, config))

    return {"synth.generate": generate_once, "synth.render": render_once, "dmae.train": train_once}


@pytest.fixture
def clip() -> dmae.Clip:
    return generated(seconds=1, clips=1, seed=7)[0]


@pytest.mark.parametrize("package", ["dmae", "synth"])
def test_import_is_light(package: str):
    code = f"import {package}, sys; print(*(m for m in ('torch', 'mujoco', 'hydra', 'numpy') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []


@pytest.mark.parametrize("module", [dmae, synth], ids=lambda module: module.__name__)
def test_type_checkers_see_every_name(module):
    """The imports for type checkers and the table of lazy ones name the same things."""
    source = Path(module.__file__).read_text()
    checked = [line.split(" as ")[1] for line in source.splitlines() if " import " in line and " as " in line]
    assert sorted(checked) == module.__all__
    assert (Path(module.__file__).parent / "py.typed").is_file()
    for name in module.__all__:
        assert getattr(module, name).__name__ == name
        assert name in dir(module)
    assert not {"TYPE_CHECKING", "import_module"} & set(dir(module)), "completion offers what is ours"


@pytest.mark.parametrize("module", [dmae, synth], ids=lambda module: module.__name__)
def test_unknown_name_lists_the_known_ones(module):
    with pytest.raises(AttributeError, match=r"no attribute 'captur'.*load_dataset"):
        module.captur  # noqa: B018


@pytest.mark.slow
@pytest.mark.parametrize(("package", "name"), VERBS, ids=map(".".join, VERBS))
def test_example_of_a_verb_runs(package: str, name: str, tmp_path: Path, monkeypatch, beginnings):
    monkeypatch.chdir(tmp_path)
    simulate_here(monkeypatch)
    verb = getattr(sys.modules[package], name)
    for begun, begin in beginnings.items():
        if begun != f"{package}.{name}":
            monkeypatch.setattr(begun, begin)
    names = {"dmae": dmae, "synth": synth, "np": np, "Path": Path, "replace": replace}
    examples = doctest.DocTestFinder(recurse=False).find(verb, f"{package}.{name}", globs=names)
    assert examples[0].examples, f"{package}.{name} has no example"
    assert len(examples[0].examples) <= 10
    printed: list[str] = []
    failed, _ = doctest.DocTestRunner(verbose=False).run(examples[0], out=printed.append)
    assert not failed, "".join(printed)


@pytest.mark.parametrize(("package", "name"), VERBS, ids=map(".".join, VERBS))
def test_parameters_of_a_verb_are_documented(package: str, name: str):
    verb = getattr(sys.modules[package], name)
    documented = inspect.getdoc(verb)
    for parameter in inspect.signature(verb).parameters:
        assert parameter in documented, f"{package}.{name} does not document {parameter}"


def test_a_name_of_the_other_package_is_answered_by_that_package():
    with pytest.raises(AttributeError, match=r"'dmae' has no attribute 'generate'; there are .*; synth has others$"):
        dmae.generate  # noqa: B018
    with pytest.raises(AttributeError, match=r"'synth' has no attribute 'generat'; did you mean generate\? .*dmae has"):
        synth.generat  # noqa: B018


def test_generate_answers_a_mistyped_option():
    with pytest.raises(TypeError, match=r"generate: no option worker; did you mean workers\?"):
        synth.generate(worker=2)
    with pytest.raises(TypeError, match=r"generate: no option second; did you mean seconds\?"):
        synth.generate(second=2)
    with pytest.raises(TypeError, match=r"generate: no option views; did you mean one of rig=RigConfig\(ring=RingConf"):
        synth.generate(views=8)
    with pytest.raises(TypeError, match=r"config: expected a synth.GenerateConfig, found 'scene.seconds=2'"):
        synth.generate("scene.seconds=2")
    with pytest.raises(ValueError, match=r"quality='drft': expected one of draft, standard"):
        synth.generate(quality="drft")
    with pytest.raises(ValueError, match=r"did you mean office\?"):
        synth.generate(scene="ofice")
    with pytest.raises(ValueError, match=r"files are synth\.preset\('motion', 'recorded', path='/'\)$"):
        synth.generate(motion="/")
    with pytest.raises(ValueError, match=r"^detector\.custom=math:floor: expected a function of a synth\.detector"):
        synth.generate(clips=1, detector=synth.DetectorConfig(custom=["math:floor"]))


def test_a_configuration_with_a_value_of_another_type_is_refused(clip, tmp_path: Path):
    with pytest.raises(ValueError, match=r"CaptureConfig\.th_p: expected a number, found 'a'"):
        dmae.capture(clip, dmae.CaptureConfig(th_p="a"))
    with pytest.raises(
        ValueError,
        match=r"TrainConfig\.learning: expected the fields .*'steps'\], found \['step'\]; did you mean steps\?",
    ):
        dmae.train([clip], tmp_path, dmae.TrainConfig(learning={"step": 2}))


def test_a_configuration_and_its_changes_are_the_options_of_the_command():
    from dmae.cli import compose
    from synth.cli import SYNTH
    from synth.verbs import _configured

    command = SYNTH.commands["generate"]
    for _ in range(2):  # a list that a caller changes is the caller's own
        found = _configured("generate", None, {})
        assert found == compose(command, [])
        found.scene.persons.append(9)
    changed = _configured("generate", None, {"seconds": 2, "rig": "ring", "clips": 3, "quality": "draft"})
    assert changed == compose(command, ["scene.seconds=2", "rig=ring", "clips=3", "quality=draft"])
    config = synth.GenerateConfig(scene=synth.SceneConfig(seconds=4))
    assert _configured("generate", config, {"scene": "office"}).scene == compose(command, []).scene
    assert _configured("generate", config, {"seconds": 1, "clips": 2}) == replace(
        config, scene=synth.SceneConfig(seconds=1), clips=2
    )


def test_every_command_has_the_function_of_its_name():
    from dmae.cli import DMAE
    from synth.cli import SYNTH

    for module, program, without in ((dmae, DMAE, {"demo", "live"}), (synth, SYNTH, set())):
        functions = {name.replace("_", "-") for name in module.__all__ if inspect.isfunction(getattr(module, name))}
        assert {*program.commands} - functions == without
    readme = (Path(__file__).parents[1] / "README.md").read_text()
    assert "`demo` and `live` alone have none" in readme and inspect.isclass(dmae.OnlineCapture)


def test_verbs_have_the_defaults_of_their_commands():
    from dmae.cli import DMAE
    from synth.cli import SYNTH

    compared = 0
    for module, program in ((dmae, DMAE), (synth, SYNTH)):
        for command in program.commands.values():
            verb = getattr(module, command.name.replace("-", "_"), None)
            options = {each.name: each for each in fields(command.configuration)}
            for name, argument in inspect.signature(verb).parameters.items() if verb else ():
                # None stands for the command's default, or for nothing that is written.
                if name not in options or argument.default in (None, argument.empty):
                    continue
                made, default = options[name].default_factory, options[name].default
                wanted = default if made is MISSING else made()
                found = list(argument.default) if isinstance(argument.default, tuple) else argument.default
                # A detector is given by its name alone, a choice by its name.
                assert found in (wanted, getattr(wanted, "name", wanted)), f"{command}: {name}"
                compared += 1
    assert compared > 30


def test_generate_in_memory_makes_the_clips_of_the_command(tmp_path: Path):
    options = {"clips": 2, "seed": 3, "scene": "studio"}
    in_memory = list(synth.generate(seconds=0.4, **options))
    from_disk = list(synth.generate(seconds=0.4, **options, out=tmp_path / "set"))
    for one, other in zip(in_memory, from_disk, strict=True):
        np.testing.assert_array_equal(one.truth.xyz, other.truth.xyz)
        np.testing.assert_array_equal(one.detections.xy, other.detections.xy)


def test_triangulate_takes_pixels_as_detected(clip):
    """Lens distortion is removed inside."""
    rig = clip.rig
    bent = dmae.CameraRig(rig.names, rig.K, rig.dist + [0.1, -0.05, 0.001, 0, 0], rig.cam_from_world, rig.size)
    xyz = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 2), (20, 3))
    points = dmae.triangulate(bent, bent.project(xyz)[0], np.ones((20, len(rig))))
    np.testing.assert_allclose(points.xyz, xyz, atol=1e-5)


def test_triangulate_takes_axes_as_a_rig_projects_them(clip):
    rig = clip.rig
    xyz = np.random.default_rng(0).uniform((-1, -1, 0), (1, 1, 2), (4, 3, 7, 3))
    points = dmae.triangulate(rig, rig.project(xyz)[0])
    np.testing.assert_allclose(points.xyz, xyz, atol=1e-5)
    assert points.used.shape == (4, 3, 7, len(rig)) and points.residual.shape == (4, 3, 7)
    with pytest.raises(ValueError, match=r"expected xy \(F, 5, \.\.\., 2\) px, found shape \(4, 3, 7, 5, 2\)"):
        dmae.triangulate(rig, np.moveaxis(rig.project(xyz)[0], 1, -2))
    with pytest.raises(ValueError, match=r"confidence: expected shape \(4, 5, 3, 7\)"):
        dmae.triangulate(rig, rig.project(xyz)[0], np.ones(4))
    with pytest.raises(ValueError, match=r"rig.project returns xy and depth, give the first"):
        dmae.triangulate(rig, rig.project(xyz))


def test_capture_of_nobody_warns_of_the_likely_cause(clip):
    poses = clip.rig.cam_from_world.copy()
    poses[:, :3, 3] *= 1000
    with pytest.warns(UserWarning, match="no person was captured: lengths of the calibration are in mm"):
        dmae.capture(replace(clip, rig=replace(clip.rig, cam_from_world=poses), true_rig=None))


def test_people_are_simulated_with_cameras_that_exist(clip, tmp_path: Path):
    rig = clip.rig
    rig = dmae.CameraRig([f"cam_{name}" for name in rig.names], rig.K, rig.dist, rig.cam_from_world, rig.size)
    clip = next(synth.generate(seconds=0.2, clips=1, rig=rig))
    assert clip.rig.names == rig.names
    np.testing.assert_allclose(clip.rig.projections, rig.projections)
    write_calibration(rig, tmp_path / "rig.toml", "pose2sim")
    again = next(synth.generate(seconds=0.2, clips=1, rig=tmp_path / "rig.toml")).rig
    np.testing.assert_allclose(again.projections, rig.projections, rtol=1e-6, atol=1e-3)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda clip: synth.generate(scene=3), "scene: expected a synth.SceneConfig or the name of a preset, found 3"),
        (
            lambda clip: synth.generate(rig=clip),
            "rig: expected a synth.RigConfig, a dmae.CameraRig or the name of a preset",
        ),
        (lambda clip: dmae.capture(clip, 3), "config: expected a dmae.CaptureConfig or the name of a preset"),
        (lambda clip: dmae.train([clip], "model", 3), "config: expected a dmae.TrainConfig or the name of a preset"),
    ],
)
def test_a_configuration_of_another_type_is_refused(call, message, clip):
    with pytest.raises(TypeError, match=message):
        call(clip)


def test_a_preset_is_given_by_its_name(clip):
    paper = dmae.capture(clip, dmae.preset("capture", "paper"))
    np.testing.assert_array_equal(dmae.capture(clip, "paper").xyz, paper.xyz)


def test_poses_are_converted_to_another_skeleton(clip):
    truth = clip.truth
    found = dmae.to_skeleton(truth, "coco17")
    nose = dmae.get_skeleton("body25").joints.index("nose")
    np.testing.assert_array_equal(found.xyz[:, :, found.skeleton.joints.index("nose")], truth.xyz[:, :, nose])
    with pytest.raises(KeyError, match="did you mean coco17"):
        dmae.to_skeleton(truth, "coco7")


def test_presets_are_those_of_the_command():
    assert dmae.preset("capture", "default") == dmae.CaptureConfig()
    assert dmae.preset("capture", "paper").th_v == 3
    assert dmae.preset("train", "paper", seed=3).learning.loss == "mse"
    shorter = dmae.preset("train", "paper", learning={"steps": 5}, model={"encoder": {"dim": 64}})
    assert (shorter.learning.steps, shorter.learning.loss, shorter.learning.lr) == (5, "mse", 0.002)
    assert shorter.model.encoder == replace(dmae.preset("train", "paper").model.encoder, dim=64)
    openpose = synth.preset("detector", "shelf_openpose").noise
    assert openpose != synth.DetectorConfig().noise
    changed = replace(openpose, bias=0.5)
    assert synth.preset("detector", "shelf_openpose", noise={"bias": 0.5}).noise == changed
    with pytest.raises(TypeError, match=r"^LearningConfig: no field step; did you mean steps\?"):
        dmae.preset("train", "paper", learning={"step": 5})
    with pytest.raises(ValueError, match="capture=papr: no preset 'papr'; did you mean paper"):
        dmae.preset("capture", "papr")


@pytest.mark.parametrize(
    "verb",
    ["capture", "draw", "review", "doctor", "calibrate", "decide", "save", "export", "convert", "show"],
)
def test_the_wrong_type_is_named_with_what_to_do(verb: str, tmp_path: Path):
    out = [tmp_path / "a"] if verb in ("save", "export", "convert", "show") else [[]] if verb == "decide" else []
    with pytest.raises(TypeError, match=r"clip: expected a dmae\.Clip, found 'walk'; dmae\.load reads a clip"):
        getattr(dmae, verb)("walk", *out)
    assert not list(tmp_path.iterdir())


def test_results_are_printed_in_words_or_a_few_lines(clip):
    assert re.match(r"1\. |nothing found wrong", repr(dmae.doctor(clip)))
    refined = dmae.calibrate(clip)
    assert "array(" not in repr(refined) and "covariance=float64" in repr(refined)
    assert repr(dmae.triangulate(clip.rig, clip.rig.project(clip.truth.xyz)[0])).startswith("Points(xyz=float64[")


def test_poses_are_drawn_and_reported_with_their_clip(clip, tmp_path: Path):
    poses = dmae.to_skeleton(clip.truth, "body25")
    assert clip.poses is None
    dmae.report(clip, tmp_path / "report.html", poses=poses)
    assert "not captured" not in (tmp_path / "report.html").read_text()
    layers = dmae.LayersConfig(measured=True)
    drawn = [
        dmae.show(clip, tmp_path / str(len(given)), dmae.ShowConfig(frames=1, layers=layers), **given)[0].read_bytes()
        for given in ({}, {"poses": poses})
    ]
    assert drawn[0] != drawn[1]
    with pytest.raises(ValueError, match=r"^poses=.*expected one clip, found several"):
        dmae.report([clip, clip], tmp_path / "report.html", poses=poses)


@pytest.mark.parametrize("verb", ["show", "contact_sheet"])
def test_the_wrong_type_is_named_by_synth_as_well(verb: str, tmp_path: Path):
    with pytest.raises(TypeError, match=r"clip: expected a dmae\.Clip, found 'walk'; dmae\.load reads a clip"):
        getattr(synth, verb)("walk", tmp_path / "a")


@pytest.mark.parametrize("kind", ["ndarray", "PoseFile"])
def test_an_array_or_a_file_of_poses_is_answered_with_how_to_give_it(kind: str, clip, tmp_path: Path):
    poses = clip.truth.xyz if kind == "ndarray" else dmae.read_poses(dmae.export(clip, tmp_path / "a.npz")[0])
    for call in (
        lambda: dmae.evaluate(clip, poses),
        lambda: dmae.draw(clip, poses),
        lambda: dmae.export(clip, tmp_path / "b.npz", poses=poses),
        lambda: dmae.complete(poses, 25),
        lambda: dmae.to_skeleton(poses, "coco17"),
    ):
        with pytest.raises(TypeError, match=rf"^poses: expected a dmae\.Poses3D, found {kind}; .*\(path\)\.poses "):
            call()


def test_a_training_without_clips_is_answered_with_what_it_takes(clip, tmp_path: Path):
    for given in (clip, tmp_path):
        with pytest.raises(TypeError, match=r"^clips: expected several clips, as dmae\.load_dataset\(path\), found "):
            train(given, tmp_path / "model")
    with pytest.raises(ValueError, match=r"^nothing to learn from"):
        train([], tmp_path / "model")


def test_options_of_generate_of_another_type_are_named():
    with pytest.raises(ValueError, match=r"^GenerateConfig\.occlusion: expected a synth\.OcclusionConfig, found 0\.4"):
        synth.generate(clips=1, occlusion=0.4)
    with pytest.raises(ValueError, match=r"^SceneConfig\.persons: expected a list of whole numbers, found 2$"):
        synth.generate(clips=1, scene=synth.SceneConfig(persons=2))


def test_stress_takes_one_clip_as_well(clip):
    config = dmae.StressConfig(axes=["cameras"], levels={"cameras": [1]}, pairs=[], methods=["linear"])
    assert dmae.stress(clip, None, config)["axes"] == dmae.stress([clip], None, config)["axes"]


def test_options_are_also_given_in_a_dictionary(clip, tmp_path: Path):
    assert dmae.show(clip, tmp_path, {"frames": 1, "width": 160, "layers": {"detections": True}})
    with pytest.raises(TypeError, match=r"config: expected the fields .*'axes'.*\], found \['axis'\]"):
        dmae.stress([clip], config={"axis": ["cameras"]})
    with pytest.raises(TypeError, match=r"config\.layers: expected a dmae\.LayersConfig, found 'truth'"):
        dmae.show(clip, tmp_path, {"layers": "truth"})
    with pytest.raises(TypeError, match=r"about\.name: expected a text, found 3"):
        synth.export(tmp_path, tmp_path / "out", about={"name": 3})


def test_a_unit_that_does_not_exist_is_answered_with_those_that_do(clip, tmp_path: Path):
    with pytest.raises(ValueError, match="unit='inch': expected one of m, cm, mm"):
        dmae.export(clip, tmp_path / "a.trc", "trc", unit="inch")


def test_evaluate_without_poses_says_what_to_do(clip):
    with pytest.raises(ValueError, match=r"has no poses; run dmae\.capture"):
        dmae.evaluate(clip)


def write_clips(clip: dmae.Clip, count: int, folder: Path) -> None:
    """Write a data set of copies of a clip, named 0, 1, ..."""
    for number in range(count):
        dmae.save(replace(clip, id=f"{number}"), folder / f"{number}")
    write_manifest(folder, [{"id": f"{number}", "status": "ok"} for number in range(count)])


def test_evaluate_scores_methods_as_its_command(clip, tmp_path: Path):
    write_clips(clip, 2, tmp_path / "walks")
    config = dmae.EvaluateConfig(methods=["measured", "linear"], views=[5])
    clips = dmae.load_dataset(tmp_path / "walks")
    scores = dmae.evaluate(clips, config=config)
    assert scores["recording"] == "2 clips of walks"
    run_command(tmp_path, "dmae", "evaluate", "data=walks", "methods=[measured,linear]", "views=[5]", "out=out")
    assert dmae.compare_scores(tmp_path / "out", scores).passed
    written = json.loads((tmp_path / "out/scores.json").read_text())
    assert written["results"] == json.loads(json.dumps(scores["results"]))
    in_memory = dmae.evaluate(list(clips), config=config)
    assert in_memory["results"] == scores["results"] and in_memory["recording"] == "2 clips"
    assert list(dmae.evaluate(clips[1:], config=config)["clips"]) == ["1"]
    with pytest.raises(ValueError, match=r"^several clips are scored by methods: give config=dmae\.EvaluateConfig"):
        dmae.evaluate(clips)
    with pytest.raises(ValueError, match=r"^config: methods make the poses"):
        dmae.evaluate(clip, clip.truth, config)
    for wrong, found in (([clip, clip], "two with the id '000000'"), ([], "none"), (clips[2:], "none")):
        with pytest.raises(ValueError, match=f"each with an id of its own; found {found}$"):
            dmae.evaluate(wrong, config=config)


def test_a_part_of_a_data_set_is_stressed(clip, tmp_path: Path):
    write_clips(clip, 3, tmp_path)
    config = dmae.StressConfig(axes=["cameras"], levels={"cameras": [1]}, pairs=[], methods=["linear"])
    assert dmae.stress(dmae.load_dataset(tmp_path)[1:], None, config)["clips"] == ["1", "2"]
    assert dmae.stress(dmae.load_dataset(tmp_path)[1:], None, replace(config, first=1))["clips"] == ["2"]


WRONG_TYPES = [
    (lambda it: dmae.complete(it.poses, "25"), "fps: expected a number, found '25'"),
    (lambda it: dmae.complete(it.poses, None), "fps: expected a number, found None"),
    (lambda it: dmae.complete(it.poses, 25, smooth="0.1"), "smooth: expected a number, found '0.1'"),
    (lambda it: dmae.complete(it.poses, 25, smooth=True), "smooth: expected a number, found True"),
    (lambda it: dmae.complete(it.poses, 25, denoise="yes"), "denoise: expected True or False, found 'yes'"),
    (lambda it: dmae.complete(it.poses, 25, weights=3), "weights: expected a path, found 3"),
    (lambda it: dmae.complete(it.poses, 25, smoth=0), "complete: no argument smoth; did you mean smooth?"),
    (lambda it: dmae.completer(it.poses), "skeleton: expected a dmae.Skeleton or a text, found Poses3D"),
    (lambda it: dmae.completer("body25")(it.poses, "25"), "fps: expected a number, found '25'"),
    (lambda it: dmae.completer("body25")(it.clip, 25), "poses: expected a dmae.Poses3D, found Clip"),
    (lambda it: dmae.capture([it.clip]), "clip: expected a dmae.Clip, found ["),
    (lambda it: dmae.capture(it.clip, fill=None), "fill: expected a text, found None"),
    (lambda it: dmae.draw(it.clip, it.poses, "1"), "frame: expected a whole number, found '1'"),
    (lambda it: dmae.draw(it.clip, it.poses, 1.5), "frame: expected a whole number, found 1.5"),
    (lambda it: dmae.evaluate("walk"), "clip: expected a dmae.Clip or several clips, as dmae.load_dataset(path)"),
    (lambda it: dmae.report("walk", "a"), "clip: expected a dmae.Clip or several clips, as dmae.load_dataset(path)"),
    (lambda it: dmae.report(["walk"], "a"), "clip[0]: expected a dmae.Clip, found 'walk'"),
    (lambda it: dmae.report(it.clip, "a", scores=["scores.json"]), "scores[0]: expected a dictionary"),
    (lambda it: dmae.compare_scores([1], [2]), "baseline: expected a dictionary or a path, found [1]"),
    (lambda it: dmae.benchmark(workers="2"), "workers: expected a whole number, found '2'"),
    (lambda it: dmae.regress(3), "solver: expected a function or a text, found 3"),
    (lambda it: dmae.corrupt(it.clip, "objects"), "levels: expected a dictionary, found 'objects'"),
    (lambda it: dmae.corrupt(it.clip, {"cameras": [2]}), "levels.cameras: expected a number, found [2]"),
    (lambda it: dmae.corrupt(it.clip, {"objects": 4}, seed=1.5), "seed: expected a whole number, found 1.5"),
    (lambda it: dmae.stress(["walk"]), "clips[0]: expected a dmae.Clip, found 'walk'"),
    (lambda it: dmae.stress(it.clip, dmae.StressConfig()), "out: expected a path, found StressConfig"),
    (lambda it: dmae.decide(replace(it.clip, poses=it.poses), ["a"]), "decisions[0]: expected a dmae.Decision"),
    (lambda it: dmae.table("1", "walk", "a"), "number: expected a whole number, found '1'"),
    (lambda it: dmae.train([it.poses], "a"), "clips[0]: expected a dmae.Clip, found Poses3D"),
    (lambda it: dmae.train([it.clip], "a", validation_data=it.clip), "validation_data: expected several clips"),
    (lambda it: dmae.pretrain(dmae.PretrainCommand()), "out: expected a path, found PretrainCommand"),
    (lambda it: dmae.triangulate(it.clip, it.xy), "rig: expected a dmae.CameraRig, found Clip; clip.rig has"),
    (lambda it: dmae.triangulate(it.rig, it.clip.detections), "xy: expected an array of numbers, found Detections2D"),
    (lambda it: dmae.doctor(it.clip, max_offset=2.5), "max_offset: expected a whole number, found 2.5"),
    (lambda it: dmae.run(3), "source: expected a path or a dmae.Clip, found 3"),
    (lambda it: dmae.read(it.clip), "path: expected a path, found Clip"),
    (lambda it: dmae.load(it.clip), "folder: expected a path, found Clip"),
    (lambda it: dmae.load_dataset(["a"]), "path: expected a path, found ['a']"),
    (lambda it: dmae.export(it.clip, "a.npz", it.poses), "format: expected a text, found Poses3D"),
    (lambda it: dmae.export(it.clip, "a.npz", keep_mm="20"), "keep_mm: expected a number, found '20'"),
    (lambda it: dmae.to_skeleton(it.poses, 3), "skeleton: expected a path or a dmae.Skeleton, found 3"),
    (lambda it: dmae.get_skeleton(3), "skeleton: expected its name, its file or a dmae.Skeleton, found int"),
    (lambda it: dmae.preset("capture", "paper", thv=2), "CaptureConfig: no field thv; did you mean th_v?"),
    (
        lambda it: dmae.Clip("a", 25, it.rig, it.clip.detections, images="x"),
        "Clip.images: expected a dmae.Images, found 'x'",
    ),
    (lambda it: dmae.Poses3D(it.poses.skeleton, "a"), "Poses3D.xyz: expected an array of numbers, found 'a'"),
    (
        lambda it: dmae.Poses3D(it.poses.skeleton, [[1], [1, 2]]),
        "Poses3D.xyz: expected an array of numbers, found list with parts that are no numbers, or of different lengths",
    ),
    (lambda it: dmae.CameraRig(5, it.rig.K, None, None, None), "CameraRig.names: expected a list of names"),
    (lambda it: synth.generate(clips="2"), "clips: expected a whole number, found '2'"),
    (lambda it: synth.generate(persons=2), "persons: expected a list of whole numbers, found 2"),
    (lambda it: synth.generate(out=3), "out: expected a path, found 3"),
    (lambda it: synth.preset("scene", "office", second=3), "SceneConfig: no field second; did you mean seconds?"),
    (lambda it: synth.render(it.clip, out="a"), "data: expected a path, found Clip"),
    (lambda it: synth.body_state(it.clip), "clip: expected a path, found Clip"),
    (lambda it: synth.contact_sheet(it.clip, "a.png", frames="1"), "frames: expected a whole number, found '1'"),
    (lambda it: synth.show(it.clip, "a", 3), "config: expected a dmae.ShowConfig, found 3"),
    (lambda it: synth.compare("walk", "walks"), "real: expected a dmae.Clip, found 'walk'"),
    (lambda it: synth.compare(it.clip, it.clip), "sim: expected several clips, as dmae.load_dataset(path), found Clip"),
    (lambda it: synth.compare(it.clip, [it.clip], limits=3), "limits: expected a synth.Limits, found 3"),
    (lambda it: synth.compare_motion([it.clip], "walks"), "sim: expected several clips"),
    (lambda it: synth.fit_detector(it.clip, ["walks"]), "clips[0]: expected a dmae.Clip, found 'walks'"),
    (lambda it: synth.realism(it.clip), "path: expected a path, found Clip"),
    (lambda it: synth.plan(views=4), "views: expected a list of whole numbers, found 4"),
    (lambda it: synth.split("walks", train="0.6"), "train: expected a number, found '0.6'"),
]


@pytest.mark.parametrize(("call", "message"), WRONG_TYPES, ids=[message for _, message in WRONG_TYPES])
def test_a_wrong_type_is_answered_in_a_line(call, message: str, clip, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    poses, xy = dmae.to_skeleton(clip.truth, "body25"), clip.rig.project(clip.truth.xyz)[0]
    with pytest.raises(TypeError) as error:
        call(SimpleNamespace(clip=clip, poses=poses, rig=clip.rig, xy=xy))
    assert str(error.value).startswith(message) and "\n" not in str(error.value)
    assert not list(tmp_path.iterdir())


def test_every_number_text_and_path_of_a_verb_is_checked():
    """Configurations are left to the verb; anything else that a verb takes is a type that is checked."""
    for package, name in VERBS:
        verb = getattr(sys.modules[package], name)
        annotations = {each: text for each, text in verb.__annotations__.items() if each != "return"}
        others = {each: text for each, text in annotations.items() if each not in type_hints(verb.__wrapped__)}
        allowed = r"Config|Command|np\.ndarray|Limits|Decision|Any|object"
        assert all(re.search(allowed, str(text)) for text in others.values()), (package, name, others)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: dmae.CaptureConfig(th_v="2"), "CaptureConfig.th_v: expected a whole number, found '2'"),
        (
            lambda: dmae.StressConfig(methods=["linear", write_clips]),
            f"StressConfig.methods[1]: expected a text, found function; name it, as '{__name__}:write_clips'",
        ),
        (
            lambda: dmae.EvaluateConfig(methods=[lambda poses, fps: poses]),
            "EvaluateConfig.methods[0]: expected a text, found function; define it in a module and name it, as "
            "'module:function'",
        ),
        (lambda: dmae.LearningConfig(steps="2"), "LearningConfig.steps: expected a whole number, found '2'"),
        (lambda: dmae.PretrainCommand(clips="2"), "PretrainCommand.clips: expected a whole number, found '2'"),
        (lambda: synth.SceneConfig(seconds="a"), "SceneConfig.seconds: expected a number, found 'a'"),
        (lambda: synth.RigConfig(cameras=3), "RigConfig.cameras: expected a list, found 3"),
        (lambda: dmae.ShowConfig(frames="2"), "ShowConfig.frames: expected a whole number, found '2'"),
        (
            lambda: synth.DetectorConfig(noise={"bias": "a"}),
            "DetectorConfig.noise.bias: expected a number, found 'a'",
        ),
    ],
)
def test_a_configuration_is_checked_where_it_is_made(make, message: str):
    with pytest.raises(ValueError, match=f"^{re.escape(message)}$"):
        make()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: dmae.TrainConfig(steps=2), "TrainConfig: no field steps; did you mean learning=LearningConfig("),
        (lambda: dmae.LearningConfig(device="cuda"), "LearningConfig: no field device; did you mean devices?"),
        (lambda: dmae.CaptureConfig(trackng=2), "CaptureConfig: no field trackng; did you mean tracking?"),
        (lambda: synth.RigConfig(zzz=2), "RigConfig: no field zzz; there are name, "),
        (lambda: synth.preset("rig", "ring", sise=2), "RigConfig: no field sise; did you mean size?"),
    ],
)
def test_a_mistyped_field_of_a_configuration_is_answered_by_the_field_meant(make, message: str):
    with pytest.raises(TypeError, match=f"^{re.escape(message)}"):
        make()


def test_every_public_configuration_answers_a_mistyped_field():
    public = [getattr(package, name) for package in (dmae, synth) for name in package.__all__]
    kinds = [kind for kind in public if isinstance(kind, type) and kind.__name__.endswith(("Config", "Command"))]
    assert len(kinds) > 20
    for kind in kinds:
        with pytest.raises(TypeError, match=rf"^{kind.__name__}: no field nope; "):
            kind(nope=1)


def test_every_public_configuration_is_taken_by_a_verb():
    public = {name: getattr(package, name) for package in (dmae, synth) for name in package.__all__}
    kinds = {name: kind for name, kind in public.items() if name.endswith(("Config", "Command"))}
    verbs = [verb for verb in public.values() if inspect.isfunction(verb)]
    taken = " ".join(str(text) for verb in verbs for text in verb.__annotations__.values())
    parts = " ".join(str(field.type) for kind in kinds.values() for field in fields(kind))
    assert not [name for name in kinds if not re.search(rf"\b{name}\b", f"{taken} {parts}")]


def test_one_text_is_taken_for_a_list_of_it(clip, tmp_path: Path):
    """As on the command line."""
    assert synth.GenerateConfig(images="rgb").images == ["rgb"]
    assert dmae.show(clip, tmp_path, dmae.ShowConfig(frames=1, cameras="0"))
    with pytest.raises(ValueError, match="no completion method 'linera'"):
        dmae.benchmark(methods="linera", out=tmp_path)
    with pytest.raises(ValueError, match=r"^detector=clea: no preset 'clea'; did you mean clean"):
        synth.detector_errors(tmp_path, simulated="clea")


def test_formats_that_would_not_be_written_are_refused(clip):
    with pytest.raises(ValueError, match=r"^export=\.\.\.: formats are written to a folder; give out=\.\.\., or leave"):
        dmae.run(clip, export=["trk"])


def test_a_format_whose_library_is_missing_is_refused_before_anything_is_done(clip, tmp_path: Path, monkeypatch):
    dmae.save(clip, tmp_path / "clip")
    monkeypatch.setattr("dmae.formats.registry.find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"^format=c3d needs ezc3d: pip install ezc3d$"):
        dmae.run(tmp_path / "clip", out=tmp_path / "out", export=["trc", "c3d"])
    assert not (tmp_path / "out").exists()
    with pytest.raises(ValueError, match=r"^format=movement needs xarray and h5netcdf: pip install 'dmae-synth\[anim"):
        dmae.export(clip, tmp_path / "poses.nc", "movement")


def test_compare_says_of_which_set_a_clip_is(clip):
    few = clip.select(views=[0, 1])
    with pytest.raises(ValueError, match=r"^real: clip '000000': errors are measured against the other views"):
        synth.compare(few, [clip])
    with pytest.raises(ValueError, match=r"^sim: clip '000000': errors are measured against the other views"):
        synth.compare(clip, [few])


def test_a_skeleton_is_given_by_name_or_itself(clip):
    poses, coco = dmae.to_skeleton(clip.truth, "body25"), dmae.get_skeleton("coco17")
    assert dmae.get_skeleton(coco) is coco
    assert dmae.evaluate(clip, poses, skeleton=coco)["pcp"] == dmae.evaluate(clip, poses, skeleton="coco17")["pcp"]


def test_a_clip_of_a_data_set_is_found_by_its_name(clip, tmp_path: Path):
    for _ in synth.generate(seconds=0.2, clips=2, persons=[1, 1], seed=7, out=tmp_path / "walks"):
        pass
    clips = dmae.load_dataset(tmp_path / "walks")
    assert clips["000001"].id == clips[1].id == "000001" and "000001" in clips and "9" not in clips
    with pytest.raises(KeyError, match=r"walks: no clip '00001' among 2; did you mean '000001'\?"):
        clips["00001"]
    with pytest.raises(IndexError, match=r"walks: no clip 2; there are 2, from 0"):
        clips[2]
    with pytest.raises(TypeError, match=r"walks: expected the number or the name of a clip, found 1\.5"):
        clips[1.5]


@pytest.mark.parametrize(
    ("files", "format"),
    [
        (["clip.json"], "clip"),
        (["calibration.json", "detection/0.txt"], "shelf"),
        (["pose/cam1_json/cam1.0.json"], "pose2sim"),
        (["intri.yml", "annots/1/000000.json"], "easymocap"),
        (["cam0/cam0_000000000000_keypoints.json", "calibration.toml"], "openpose"),
        (["calibration_171204.json", "hdPose3d_stage1_coco19/body3DScene_00000001.json"], "panoptic"),
        (["camera_params.npy"], "released"),
        (["person_keypoints.json"], "coco"),
    ],
)
def test_format_is_recognised_by_its_files(files: list[str], format: str, tmp_path: Path):
    for name in files:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    assert recognise(tmp_path) == format


def test_unrecognised_folder_is_answered_with_the_formats(tmp_path: Path):
    (tmp_path / "notes.txt").touch()
    with pytest.raises(ValueError, match=r"found notes\.txt; no format is recognised, .*clip, coco"):
        dmae.read(tmp_path)


def test_errors_of_read_name_its_arguments(clip, tmp_path: Path):
    dmae.convert(clip, tmp_path / "walk", "openpose")
    for given, message in (
        ({}, r"no file states the frame rate; give fps=\.\.\.$"),
        ({"fps": 25, "calibration": "none.toml"}, r"^calibration none\.toml: no such file"),
        ({"fps": 25, "cameras": ["9"]}, r"^cameras=\[9\]: expected"),
        ({"fps": 25, "images": "a", "videos": "b"}, "^videos and images: expected one of them"),
    ):
        with pytest.raises((ValueError, FileNotFoundError), match=message):
            dmae.read(tmp_path / "walk", **given)
    with pytest.raises(TypeError, match=r"^read: no argument camera; did you mean cameras"):
        dmae.read(tmp_path / "walk", camera=["0"])
    (tmp_path / "clip.json").touch()
    (tmp_path / "annots").mkdir()
    with pytest.raises(ValueError, match=r"found clip, easymocap; name it by format=\.\.\.$"):
        dmae.read(tmp_path)


@pytest.mark.parametrize("folder", [".", "videos"])
def test_a_folder_of_videos_is_answered_with_the_commands_for_them(tmp_path: Path, folder):
    (tmp_path / "Calib.toml").touch()
    (tmp_path / folder).mkdir(exist_ok=True)
    (tmp_path / folder / "left.MP4").touch()
    videos = re.escape(str(tmp_path / folder))
    with pytest.raises(ValueError, match=rf"found videos, .* dmae run videos={videos} .* dmae detect videos={videos} "):
        dmae.read(tmp_path)


def test_read_recognises_real_recordings(data_folder: Path):
    assert dmae.read(data_folder / "shelf", cameras=[0, 1]).provenance["format"] == "shelf"
    trial = data_folder / "pose2sim/S00_P00_SingleParticipant/S00_P00_T01_BalancingTrial"
    assert len(dmae.read(trial)) == 100
