"""Run commands as users type them, in this process, because starting a process takes seconds each time."""

import contextlib
import io
import os
import re
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from unittest import mock

from hydra.core.global_hydra import GlobalHydra

from dmae.cli import DMAE
from synth.cli import SYNTH

COMMANDS = [*DMAE.commands.values(), *SYNTH.commands.values()]


@dataclass(frozen=True)
class Done:
    """The result of a command."""

    returncode: int
    stdout: str
    stderr: str


def run_command(folder: Path, program: str, *arguments: str) -> Done:
    """Run `dmae` or `synth` in a folder. Whatever the input, there is never a traceback."""
    main = import_module(f"{program}.cli").main
    out, err = io.StringIO(), io.StringIO()
    with contextlib.ExitStack() as stack:
        # Help is wrapped at the width of the terminal, whatever the tests' own is.
        stack.enter_context(mock.patch.dict(os.environ, COLUMNS="120"))
        stack.enter_context(mock.patch.object(sys, "argv", [program, *map(str, arguments)]))
        stack.enter_context(mock.patch.object(sys, "path", [*sys.path]))
        stack.enter_context(contextlib.chdir(folder))
        stack.enter_context(contextlib.redirect_stdout(out))
        stack.enter_context(contextlib.redirect_stderr(err))
        GlobalHydra.instance().clear()
        try:
            main()
            status = 0
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
            if isinstance(end.code, str):
                print(end.code, file=sys.stderr)
    assert "Traceback" not in err.getvalue(), err.getvalue()
    if not status and "dry_run=true" not in arguments:
        lacking = [path for path in announced(out.getvalue(), arguments) if not (folder / path).exists()]
        assert not lacking, f"{program} {' '.join(map(str, arguments))} names {lacking}, which do not exist"
    return Done(status, out.getvalue(), err.getvalue())


def announced(printed: str, arguments: Sequence[str]) -> list[str]:
    """Return the paths below `out=...`, and files, that a command prints."""
    out = next((each.removeprefix("out=") for each in map(str, arguments) if each.startswith("out=")), None)
    if not out:
        return []
    words = [word.strip(".,:;()") for word in re.split(r"[\s=\[\],]+", printed)]
    return [word for word in words if word.startswith(f"{out}/") or (word == out and Path(out).suffix)]


def dmae(folder: Path, *arguments: str) -> Done:
    """Run a command of `dmae` in a folder."""
    return run_command(folder, "dmae", *arguments)


def synth(folder: Path, *arguments: str) -> Done:
    """Run a command of `synth` in a folder."""
    return run_command(folder, "synth", *arguments)


def command_line(program: str, *arguments: str) -> list[str]:
    """The command line of a command in a process of its own."""
    return [sys.executable, "-c", f"from {program}.cli import main; main()", *map(str, arguments)]


def start_command(folder: Path, program: str, *arguments: str) -> subprocess.Popen:
    """Start `dmae` or `synth` in a process, and a process group, of its own."""
    line = command_line(program, *arguments)
    pipe = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}

    def listen() -> None:
        # A suite that runs in the background of a shell ignores Ctrl-C, and so would what it starts.
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    return subprocess.Popen(line, cwd=folder, start_new_session=True, preexec_fn=listen, **pipe)
