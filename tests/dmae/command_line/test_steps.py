"""Steps run in order, each shown, until one fails."""

import pytest

from dmae.command_line.steps import run_steps


def test_steps_are_printed_and_run(capfd):
    run_steps([["dmae", "--version"], ["synth", "--version"]])
    printed = capfd.readouterr().out
    assert [line.split()[0] for line in printed.splitlines()] == ["[1/2]", "dmae", "[2/2]", "synth"]


def test_a_step_that_fails_ends_the_run_and_is_named(capfd):
    with pytest.raises(ValueError, match=r"step 1 of 2 ended with status 1: dmae no-such 'a=\[b,c\]'"):
        run_steps([["dmae", "no-such", "a=[b,c]"], ["synth", "--version"]])
    printed = capfd.readouterr()
    assert "[2/2]" not in printed.out
    assert "no command 'no-such'" in printed.err
