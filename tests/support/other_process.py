"""Run Python code in a separate process, to test libraries that keep files or folders open."""

import json
import os
import subprocess
import sys
from pathlib import Path


def printed_lines(code: str, folder: Path, *arguments: object, **environment: str) -> list:
    """Run code in a folder; return what it printed, one JSON a line."""
    done = subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        env=os.environ | environment,
        capture_output=True,
        text=True,
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    return [json.loads(line) for line in done.stdout.splitlines()]
