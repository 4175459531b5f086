"""Presets that people share are data: they never write another file or call a function."""

import json

import pytest

import synth
from tests.support.commands import run_command

BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 40)
)
HARMFUL = {
    "callback": "# @package _global_\nhydra:\n  callbacks:\n    evil:\n      _target_: evil.Callback\n",
    "log file": "# @package _global_\nhydra: {job_logging: {handlers: {f: {filename: HARM}}}}",
    "run folder": "# @package _global_\nhydra: {run: {dir: HARM}, output_subdir: x, job: {chdir: true}}\n",
    "out": "# @package _global_\nout: HARM\n",
    "package of hydra": "# @package hydra.run\ndir: HARM\n",
    "package in the middle": "# A preset.\n#@package hydra\noutput_subdir: HARM\n",
    "defaults": "defaults:\n  - /hydra/job_logging: default\n",
    "override in defaults": "defaults:\n  - override /hydra/job_logging: default\n",
    "package in defaults": "defaults:\n  - shelf_openpose@hydra\n",
    "target": "name: x\nparts: {nose: {_target_: os.system}}\n",
    "target at the top": "_target_: os.system\n",
    "environment": "name: ${oc.env:SECRET}\n",
    "environment in a part": "parts: {nose: {noise: '${oc.decode:${oc.env:SECRET}}'}}\n",
    "environment in a key": "parts: {'${oc.env:SECRET}': {noise: 1}}\n",
    "reference": "name: ${out}\n",
    "function": "custom: ['os:system']\n",
    "option of another group": "scene: {seconds: 9}\n",
    "hydra within the group": "hydra: {run: {dir: HARM}}\n",
    "aliases": BOMB,
    "deep": "name: " + "[" * 10_000,
    "python": "name: !!python/object/apply:os.mkdir [HARM]\n",
    "list": "- 1\n",
    "key twice": "name: a\nname: b\n",
    "no text": "\ud800",
    "large": "# " + "x" * (1 << 20) + "\n",
}  # fmt: skip


@pytest.fixture
def presets(tmp_path):
    (tmp_path / "presets/detector").mkdir(parents=True)
    return tmp_path / "presets"


def tree(folder):
    return sorted(path.relative_to(folder) for path in folder.rglob("*"))


@pytest.mark.parametrize("name", HARMFUL)
def test_a_harmful_preset_is_refused_and_leaves_nothing(name, presets, tmp_path, monkeypatch):
    monkeypatch.setenv("SECRET", "hunter2")
    file = presets / "detector/mine.yaml"
    file.write_bytes(HARMFUL[name].replace("HARM", str(tmp_path / "harm")).encode(errors="surrogatepass"))
    before = tree(tmp_path)
    for flags in (["detector=mine", "out=set", "clips=1"], ["detector=mine", "out=set", "--cfg", "job"]):
        done = run_command(tmp_path, "synth", "generate", f"--config-dir={presets}", *flags)
        assert done.returncode == 1, done.stdout
        assert str(file) in done.stderr and len(done.stderr.splitlines()) == 1
        assert "hunter2" not in done.stdout + done.stderr
        assert tree(tmp_path) == before


def test_files_outside_the_groups_of_a_command_are_never_read(presets, tmp_path):
    for name in ("generate.yaml", "base.yaml", "hydra/job_logging/none.yaml", "hydra/callbacks/evil.yaml", "x/y.yaml"):
        (presets / name).parent.mkdir(parents=True, exist_ok=True)
        (presets / name).write_text("name: not read\nhydra: {run: {dir: harm}}\n")
    (presets / "detector/mine.yaml").write_text("name: mine\n")
    done = run_command(tmp_path, "synth", "generate", f"--config-dir={presets}", "detector=mine", "--cfg", "job")
    assert done.returncode == 0, done.stderr
    assert "name: mine" in done.stdout and "not read" not in done.stdout
    done = run_command(tmp_path, "synth", "generate", f"--config-dir={presets}", "+x=y", "out=set")
    assert done.returncode == 1 and not (tmp_path / "set").exists()


def test_a_preset_can_start_from_one_that_is_shipped(presets, tmp_path):
    (presets / "detector/mine.yaml").write_text(
        "# Like a real one.\n# @package detector\ndefaults: [terrible, _self_]\nname: mine\n"
    )
    done = run_command(
        tmp_path, "synth", "generate", f"--config-dir={presets}", "detector=mine", "--cfg", "job", "out=x"
    )
    assert done.returncode == 0, done.stderr
    assert "name: mine" in done.stdout and "unsynchronised: 1.0" in done.stdout
    (presets / "detector/mine.yaml").write_text("defaults: [mine]\n")
    done = run_command(tmp_path, "synth", "generate", f"--config-dir={presets}", "detector=mine", "out=x")
    assert done.returncode == 1 and "expected a list of presets of detector" in done.stderr


def test_a_preset_is_also_given_by_its_file(presets, tmp_path):
    (presets / "detector/mine.yaml").write_text("defaults: [terrible, _self_]\nname: mine\n")
    done = run_command(tmp_path, "synth", "generate", "detector=presets/detector/mine.yaml", "--cfg", "job", "out=x")
    assert done.returncode == 0, done.stderr
    assert "name: mine" in done.stdout and "unsynchronised: 1.0" in done.stdout
    (presets / "detector/mine.yaml").write_text("nmae: mine\n")
    done = run_command(tmp_path, "synth", "generate", "detector=presets/detector/mine.yaml", "out=x")
    assert done.returncode == 1 and "detector.nmae: no such option" in done.stderr


def test_a_preset_with_the_name_of_a_shipped_one_is_refused_rather_than_ignored(presets, tmp_path):
    (presets / "detector/clean.yaml").write_text("name: mine\n")
    for given in (f"--config-dir={presets}", "detector=presets/detector/clean.yaml"):
        done = run_command(tmp_path, "synth", "generate", given, "out=x", "--cfg", "job")
        assert done.returncode == 1 and "give the file another name" in done.stderr


def test_a_mistyped_field_of_a_listed_camera_is_named_with_the_nearest(tmp_path):
    listed = "rig.cameras=[{name: a, postion: [3,0,2]}]"
    done = run_command(tmp_path, "synth", "generate", listed, "out=x")
    assert "Key 'postion' not in 'CameraConfig'; did you mean position? There are name, size, K" in done.stderr
    shown = run_command(tmp_path, "synth", "generate", "--help", "rig.cameras").stdout
    assert "position: [" in shown and "cam_from_world" in shown


def test_python_takes_the_file_of_a_preset(presets, tmp_path):
    file = presets / "detector/mine.yaml"
    for name in ("first", "second"):
        file.write_text(f"defaults: [terrible, _self_]\nname: {name}\n")
        taken = synth.preset("detector", file, custom=["a:b"])
        assert (taken.name, taken.timing.unsynchronised, taken.custom) == (name, 1, ["a:b"])
    (presets / "rig").mkdir()
    file = presets / "rig/lab.yaml"
    file.write_text("cameras: [{name: a, size: [640, 480], focal: 500, position: [3, 0, 2], target: [0, 0, 1]}]\n")
    assert [camera.name for camera in synth.preset("rig", file).cameras] == ["a"]
    clip = next(synth.generate(clips=1, seconds=0.2, rig=file, detector=str(presets / "detector/mine.yaml")))
    assert clip.rig.names == ("a",)


@pytest.mark.parametrize("flag", ["--config-name=x", "--config-path=x", "-cp=x", "--experimental-rerun=x.pickle"])
def test_whole_configurations_and_pickled_ones_are_not_taken(flag, tmp_path):
    done = run_command(tmp_path, "synth", "generate", flag, "out=set")
    assert done.returncode == 1 and "no such flag" in done.stderr


@pytest.mark.parametrize(
    "flags, printed",
    [
        (["--cfg", "job", "--resolve"], "data:"),
        (["-c", "job", "-p", "learning"], "steps: 6000"),
        (["--info", "defaults"], "Defaults List"),
    ],
)
def test_flags_of_hydra_that_print_the_configuration_need_no_data(flags, printed, tmp_path):
    done = run_command(tmp_path, "dmae", "train", *flags, "data=clip")
    assert done.returncode == 0 and printed in done.stdout


@pytest.mark.parametrize(
    "line",
    [
        "dmae run videos=session calibration=rig.toml",
        "dmae complete clip=captured online=true",
        "synth split data=set by=rig",
    ],
)
def test_flags_take_options_called_as_folders_of_the_package(line, tmp_path):
    """Hydra takes the folders dmae/data, dmae/online and dmae/calibration for groups of presets."""
    done = run_command(tmp_path, *line.split(), "--cfg", "job")
    last = line.split()[-1].replace("=", ": ")
    assert done.returncode == 0 and last in done.stdout.splitlines(), done.stderr


def test_a_sweep_of_a_command_that_writes_a_file_has_one_in_each_folder(tmp_path):
    list(synth.generate(clips=3, seconds=0.2, persons=[1, 1], out=tmp_path / "set"))
    done = run_command(tmp_path, "synth", "split", "-m", "data=set", "by=person,motion", "out=splits")
    assert done.returncode == 0, done.stderr
    found = [json.loads((tmp_path / f"splits/{number}/splits").read_text())["by"] for number in (0, 1)]
    assert found == ["person", "motion"]
