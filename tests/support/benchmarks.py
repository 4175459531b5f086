"""A benchmark of two clips of a second each."""

import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests.support.commands import Done, synth

TINY = (Path(__file__).parents[1] / "data/tiny_benchmark.yaml").read_text()
IDS = ["1_self/apart/000000", "2_edge/standing/000000"]


def write_tiny(folder: Path) -> Path:
    """Write the definition, without frozen checksums, and return its file."""
    path = folder / "tiny.yaml"
    path.write_text(TINY)
    return path


def simulate_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have benchmarks generate clips in this process: to start one for each set takes longer than clips of a second."""

    def run(command: list[str], **_) -> Done:
        _python, _m, _module, *arguments = command
        return synth(Path.cwd(), *arguments)

    here = SimpleNamespace(run=run, PIPE=subprocess.PIPE)
    monkeypatch.setattr("dmae.evaluation.benchmark.clips.subprocess", here)
