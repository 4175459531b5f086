"""Run sub-commands one after another, each in a process of its own."""

import shlex
import subprocess
import sys
from collections.abc import Sequence


def run_steps(steps: Sequence[Sequence[str]]) -> None:
    """Run sub-commands in order, each printed first as the line that a user would type.

    Args:
        steps: Words of a command line each: program (`dmae` or `synth`), sub-command, `key=value` ...

    Raises:
        ValueError: a step did not end with status 0. Later steps are not run.
    """
    for number, step in enumerate(steps, 1):
        line = shlex.join(step)
        print(f"[{number}/{len(steps)}] {line}", flush=True)
        program, *arguments = step
        process = subprocess.Popen([sys.executable, "-m", program, *arguments])
        try:
            status = process.wait()
        except BaseException:
            # Ctrl-C in a terminal also reaches the step; a signal to this process alone does not.
            process.terminate()
            process.wait()
            raise
        if status:
            raise ValueError(f"step {number} of {len(steps)} ended with status {status}: {line}")
