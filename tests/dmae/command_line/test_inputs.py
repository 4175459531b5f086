"""Paths that a command reads: wrong ones are refused in one line, before anything heavy is loaded."""

import os
import re
import subprocess
import sys
from dataclasses import fields, is_dataclass
from typing import get_type_hints

import pytest

from dmae.cli import DMAE
from synth.cli import SYNTH

COMMANDS = [command for program in (DMAE, SYNTH) for command in program.commands.values()]
# The line of help of an option that is a path begins with one of these, unless it is written.
_PATHS = re.compile(
    r"(Folders?|Files?|A file|A video|A mesh|JSON file|YAML file|Calibration|MJCF|Data set|Model file)\b"
)
_WRITTEN = ("out", "report", "data_folder")


@pytest.fixture
def made(tmp_path, monkeypatch):
    """Some folders: a clip, a data set, a folder of a clip, one of other things, an empty one."""
    for name in (
        "clip/clip.json",
        "set/manifest.jsonl",
        "set/000000/clip.json",
        "some/one/clip.json",
        "run/captured/clip.json",
        "run/completed/clip.json",
        "run/detected/clip.json",
        "other/notes.txt",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    for second, name in enumerate(("detected", "captured", "completed")):
        os.utime(tmp_path / "run" / name / "clip.json", (second, second))
    (tmp_path / "empty").mkdir()
    (tmp_path / "lower.yaml").touch()
    monkeypatch.chdir(tmp_path)


def _answer(monkeypatch, capsys, program, *arguments: str) -> str:
    monkeypatch.setattr(sys, "argv", [program.name, *arguments])
    with pytest.raises(SystemExit) as stop:
        from dmae.cli import run_program

        run_program(program)
    return f"{stop.value.code} {capsys.readouterr().err}"


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        (
            ["complete", "clip=cilp"],
            "clip=cilp: no such file or folder; did you mean clip? Expected: Folder of a captured",
        ),
        (["complete", "clip=sets/000000"], "sets/000000: no such file or folder; did you mean set? Expected:"),
        (["complete", "clip=far/away"], "far/away: no such file or folder; there is no folder far. Expected:"),
        (["complete", "clip=other/notes.txt/x"], "no such file or folder; other/notes.txt is a file. Expected:"),
        (["complete", "clip=other"], "clip=other: expected the folder of a clip .*, found a folder without clips"),
        (["complete", "clip=some"], "found a folder of clips; name one, as clip=some/one"),
        (["report", "clip=run"], "found a folder of clips; name one, as clip=run/completed"),
        (["complete", "clip=empty"], "clip=empty: expected the folder of a clip .*, found an empty folder"),
        (
            ["review", "clip=set"],
            "clip=set: expected the folder of one clip .*, found a data set of clips; .*clip=set/0",
        ),
        (["complete", "clip=clip", "weights=papre"], "weights=papre: no such file or folder; did you mean paper?"),
        (["complete", "clip=clip", "weights=other"], "weights=other: expected a folder that .*dmae train.* wrote"),
        (["train", "data=set", "init=shiped"], "init=shiped: no such file or folder; did you mean shipped?"),
        (["train", "data=sett/000000"], "data=sett/000000: neither a folder nor a format; did you mean set?"),
        (["train", "data=set", "extra_data=[set,sett]"], "extra_data=sett: no such file or folder; did you mean set?"),
        (
            ["capture", "data=openpose", "data.path=empty"],
            "data.path=empty: expected a file, or a folder that is not empty",
        ),
        (
            ["live", "calibration=other", "fps=25", "skeleton=body52"],
            "no skeleton 'body52'; did you mean",
        ),
        (["capture", "data=other", "data.skeleton=lower.yml"], "data.skeleton=lower.yml: .*; did you mean lower.yaml?"),
        (["live", "calibration=other", "fps=25", "listen=99"], "listen=99: expected host:port, as 127.0.0.1:5555"),
        (
            ["evaluate", "data=set", "methods=[linear,paper]"],
            "no method 'paper'; .*weights=paper capture=paper scores it",
        ),
        (["stress", "data=set", "pairs=[cameras+objekts]"], "no corruption 'objekts'; did you mean objects?"),
        (["pretrain", "motion=mocap"], "motion=mocap: no such file or folder. Expected: Folder of motion files"),
    ],
)
def test_wrong_paths_are_refused_in_one_line(made, monkeypatch, capsys, arguments, answer):
    found = _answer(monkeypatch, capsys, DMAE, *arguments)
    assert re.search(answer.replace("?", r"\?"), found) and len(found.strip().splitlines()) == 1, found


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        (["split", "data=empty"], "data=empty: expected a file, or a folder that is not empty, found an empty folder"),
        (["label", "data=some"], "found a folder of clips; name one, as data=some/one"),
        (["generate", "scene.arena=offce"], r"scene.arena=offce: no such file or folder; did you mean office\?"),
        (["generate", "rig.path=rig.toml"], "rig.path=rig.toml: no such file or folder. Expected: Calibration file"),
    ],
)
def test_wrong_paths_of_synth(made, monkeypatch, capsys, arguments, answer):
    assert re.search(answer, _answer(monkeypatch, capsys, SYNTH, *arguments))


@pytest.mark.parametrize("command", COMMANDS, ids=str)
def test_each_option_that_is_a_path_is_checked(command):
    def declared(configuration: type, prefix: str = ""):
        hints = get_type_hints(configuration)
        for each in fields(configuration):
            if is_dataclass(hints[each.name]):
                yield from declared(hints[each.name], f"{prefix}{each.name}.")
            elif "reads" in each.metadata:
                yield f"{prefix}{each.name}"

    options = [each for each in command.options().walk() if hasattr(each, "kind")]
    paths = {each.key for each in options if each.kind == "text" and _PATHS.match(each.meaning)}
    written = {key for key in paths if key.rpartition(".")[2] in _WRITTEN}
    assert paths - written <= set(declared(command.configuration))


def test_wrong_paths_are_refused_before_libraries_load(tmp_path):
    code = (
        "import sys\nfrom dmae.cli import main\nsys.argv = ['dmae', 'train', 'data=clip', 'data.path=none']\n"
        "try:\n    main()\nexcept SystemExit as stop:\n    print(stop.code)\n"
        "print(sorted({'torch', 'numba', 'lightning', 'scipy', 'matplotlib'} & set(sys.modules)))"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path, check=True
    ).stdout
    assert "data.path=none: no such file or folder" in found and found.strip().endswith("[]")
