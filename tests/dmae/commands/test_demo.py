"""The demo runs the commands that it prints, and stops at the first that fails."""

from pathlib import Path

import pytest

from dmae.cli import DMAE
from dmae.command_line.spelling import check, expand_data
from dmae.commands import demo
from dmae.commands.config import DemoCommand, DemoSize
from synth.cli import SYNTH


@pytest.fixture
def lines(monkeypatch) -> list:
    """The steps that would be run."""
    found = []
    monkeypatch.setattr(demo, "run_steps", found.extend)
    return found


@pytest.mark.parametrize("size", DemoSize)
def test_every_step_is_a_command_with_options_that_it_has(size, lines, tmp_path):
    demo.run(DemoCommand(size=size, shelf="recordings/shelf"), tmp_path / "demo")
    assert [line[1] for line in lines] == [
        "generate", "capture", "generate", "train", "capture", "complete", "evaluate", "evaluate", "report",
    ]  # fmt: skip
    for program, command, *overrides in lines:
        for override in overrides:
            if override.startswith(("data=/", "clip=")):
                Path(override.partition("=")[2]).mkdir(parents=True, exist_ok=True)
        options = {"dmae": DMAE, "synth": SYNTH}[program].commands[command].options()
        check(options, expand_data(options, overrides), [])


def test_without_a_recording_only_simulated_people_are_scored(lines, tmp_path):
    demo.run(DemoCommand(), tmp_path)
    assert [line[1] for line in lines].count("evaluate") == 1
    assert lines[-1][-2:] == [f"scores=[{tmp_path}/scores]", f"out={tmp_path}/report.html"]


def test_a_path_that_options_cannot_carry_is_refused_before_the_first_step(lines, tmp_path):
    with pytest.raises(ValueError, match="expected a path without quotes"):
        demo.run(DemoCommand(), tmp_path / "demo,2")
    assert not lines
