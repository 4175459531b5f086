"""Provenance of a file of results: date, commit and versions, in one format for all files."""

import platform
import subprocess
from datetime import date
from importlib import metadata
from pathlib import Path

_ROOT = Path(__file__).parents[2]


def provenance(*packages: str) -> dict[str, str]:
    """Return the date, the commit, and the versions of Python, of this project and of packages."""
    commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=_ROOT, capture_output=True, text=True).stdout
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("dmae-synth", "numpy", *packages))
    return {
        "date": date.today().isoformat(),
        "commit": commit.strip(),
        "versions": f"python {platform.python_version()}, {versions}",
    }


def measured(*packages: str) -> str:
    """Return the same as one line."""
    found = provenance(*packages)
    return f"{found['date']}, commit {found['commit']}, {found['versions']}"
