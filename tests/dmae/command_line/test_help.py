"""Help needs no arguments, loads nothing heavy, and fits on a screen or two."""

import resource
import subprocess
import sys
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import pytest
from omegaconf import MISSING as REQUIRED_BY_HYDRA

from dmae.command_line.options import Command, Option
from dmae.command_line.presets import read_presets
from dmae.data.typed import REQUIRED
from tests.support.commands import COMMANDS, command_line, run_command

HEAVY = {"torch", "lightning", "mujoco", "hydra", "omegaconf", "cv2", "scipy", "numba", "joblib", "matplotlib"}


@pytest.mark.parametrize("program", ["dmae", "synth"])
@pytest.mark.parametrize("arguments", [(), ("--help",), ("-h",), ("help",)])
def test_a_program_lists_its_commands(tmp_path, program, arguments):
    done = run_command(tmp_path, program, *arguments)
    assert done.returncode == 0
    for command in (each for each in COMMANDS if each.program == program):
        assert f"  {command.name} " in done.stdout and command.summary in done.stdout


@pytest.mark.parametrize("command", COMMANDS, ids=str)
def test_help_of_a_command_lists_every_option_and_example(tmp_path, command):
    done = run_command(tmp_path, command.program, command.name, "--help")
    assert (done.returncode, done.stderr) == (0, "")
    lines = done.stdout.splitlines()
    assert len(lines) <= 80
    assert max(map(len, lines)) <= 130
    assert "\033" not in done.stdout
    for member in command.options().members:
        assert member.key in done.stdout
    for example in command.examples:
        assert f"  {example}" in lines


@pytest.mark.parametrize("command", COMMANDS, ids=str)
def test_help_in_full_has_every_option_at_any_depth(tmp_path, command):
    done = run_command(tmp_path, command.program, command.name, "--help", "all")
    for member in command.options().walk():
        assert member.key in done.stdout


def test_a_group_is_printed_with_presets_types_choices_and_what_they_mean(tmp_path):
    done = run_command(tmp_path, "synth", "generate", "--help", "rig")
    assert "rig=shelf (default)" in done.stdout
    assert "rig.placement=ring" in done.stdout and "{ring, dome, random}" in done.stdout
    assert "more: synth generate --help rig.ring" in done.stdout
    assert run_command(tmp_path, "synth", "help", "generate", "rig").stdout == done.stdout
    assert run_command(tmp_path, "synth", "generate", "--help=rig").stdout == done.stdout
    assert run_command(tmp_path, "synth", "--help=generate", "rig").stdout == done.stdout
    done = run_command(tmp_path, "synth", "generate", "--help", "rig.ring")
    assert "rig.ring.views=5" in done.stdout and "[whole number]" in done.stdout
    done = run_command(tmp_path, "synth", "generate", "--help", "rigg")
    assert done.returncode == 1 and "did you mean rig?" in done.stderr


def test_defaults_are_those_of_the_presets_that_are_used(tmp_path):
    done = run_command(tmp_path, "synth", "generate", "--help", "scene")
    assert "scene.arena=office" in done.stdout and "scene.props=[0,2]" in done.stdout


def test_presets_of_your_own_folder_are_found(tmp_path):
    (tmp_path / "mine/rig").mkdir(parents=True)
    (tmp_path / "mine/rig/hall.yaml").write_text("name: hall\n")
    (command,) = (each for each in COMMANDS if str(each) == "synth generate")
    own = read_presets(command, tmp_path / "mine")
    assert "hall" in command.options(own).find("rig").presets
    assert "hall" not in command.options().find("rig").presets


@pytest.mark.parametrize("program", ["dmae", "synth"])
def test_the_version_is_printed(tmp_path, program):
    done = run_command(tmp_path, program, "--version")
    assert done.stdout.startswith(f"{program} 0.")


def test_every_example_is_a_valid_command_line():
    from dmae.command_line.spelling import checked, split_flags

    by_name = {str(command): command for command in COMMANDS}
    for command in COMMANDS:
        for example in command.examples:
            if "--config-dir" in example:
                continue
            program, name, *arguments = example.replace('"', "").split(" ")
            options = by_name[f"{program} {name}"].options()
            flags, _, overrides = split_flags([each for each in arguments if "=" in each or each.startswith("-")])
            given = None
            if options.find("data.path"):
                # The folder of an example does not exist.
                named = [each for each in overrides if each.startswith("data=runs")]
                overrides = [each for each in overrides if each not in named]
                overrides += [f"data.path={each.split('=')[1]}" for each in named]
                given = "data=clip" if named else None
            checked(options, [*filter(None, [given]), *overrides], flags)


@pytest.mark.parametrize("arguments", [("dmae", "--help"), ("synth", "generate", "--help"), ("dmae", "train", "-h")])
def test_help_loads_nothing_heavy_and_is_quick(tmp_path, arguments):
    program = arguments[0]
    code = (
        f"import sys; sys.argv = {list(arguments)}; from {program}.cli import main; main();"
        "print(*{name.partition('.')[0] for name in sys.modules}, file=sys.stderr)"
    )
    runs = [_seconds(code, tmp_path) for _ in range(3)]
    assert not set(runs[0][1].split()) & HEAVY
    # Compared with a peer in the same run, as machines differ: help takes 1 to 3.8 times as long on a quiet one.
    assert min(seconds for seconds, _ in runs) < 5 * _seconds_of_numpy()


@cache
def _seconds_of_numpy() -> float:
    return min(_seconds("import numpy", Path.cwd())[0] for _ in range(3))


def _seconds(code: str, folder: Path) -> tuple[float, str]:
    """Return the processor time of a process, and what it prints as errors."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime, done.stderr


def test_help_cut_short_by_a_pipe_is_no_error(tmp_path):
    line = " ".join(f"'{part}'" for part in command_line("synth", "generate", "--help", "all"))
    done = subprocess.run(f"{line} | head -1", shell=True, cwd=tmp_path, capture_output=True, text=True)
    assert done.stdout.startswith("usage: synth generate") and done.stderr == ""


@pytest.mark.parametrize("command", COMMANDS, ids=str)
def test_every_option_is_explained(command):
    options = command.options()
    assert options.meaning
    assert [member.key for member in options.walk() if not member.meaning] == []


@dataclass(frozen=True)
class Base:
    """What is inherited."""

    length: float | None = None
    """m; below
    the field."""


@dataclass(frozen=True)
class Mine(Base):
    """A meaning.

    Attributes:
        names: In the docstring.
    """

    names: list[str] = field(default_factory=lambda: ["a"], metadata={"choices": ("a", "b")})
    levels: dict[str, list[float]] = field(default_factory=dict)
    base: Base = field(default_factory=Base)
    """Nested."""


def test_options_are_the_fields_of_a_dataclass():
    found = Command("", f"{__name__}:Mine", ()).options()
    assert found.meaning == "A meaning."
    assert [(each.key, each.meaning) for each in found.walk()] == [
        ("length", "m; below the field."),
        ("names", "In the docstring."),
        ("levels", ""),
        ("base", "Nested."),
        ("base.length", "m; below the field."),
    ]
    assert found.find("length") == Option("length", "number", None, "m; below the field.", optional=True)
    assert found.find("names") == Option("names", "text", ["a"], "In the docstring.", ("a", "b"), many=True)
    assert found.find("levels").keyed


def test_required_is_what_hydra_calls_missing():
    assert REQUIRED == REQUIRED_BY_HYDRA
