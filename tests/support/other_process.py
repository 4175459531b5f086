"""Python code run in a process of its own: libraries that keep files open, or folders of theirs, are tested so."""

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
