"""The tiny benchmark, made once."""

from pathlib import Path

import pytest

from dmae.evaluation.benchmark.clips import Definition, find_definition, make_clips
from dmae.evaluation.config import BenchmarkSize
from tests.support.benchmarks import simulate_here, write_tiny


@pytest.fixture(scope="session")
def tiny(tmp_path_factory) -> Definition:
    return find_definition(str(write_tiny(tmp_path_factory.mktemp("definition"))))


@pytest.fixture(scope="session")
def made(tiny: Definition, tmp_path_factory) -> Path:
    """The folder of its clips. Tests leave it as it is."""
    data = tmp_path_factory.mktemp("benchmark") / "data"
    with pytest.MonkeyPatch.context() as monkeypatch:
        simulate_here(monkeypatch)
        make_clips(tiny, BenchmarkSize.small, data)
    return data
