"""A data set, and the files that an exporter writes for it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from synth.datasets.exporters.export import export
from synth.datasets.splits import SplitBy, write_splits
from tests.support.data_sets import pictured_set


@pytest.fixture(scope="session")
def data(tmp_path_factory) -> Path:
    return pictured_set(tmp_path_factory.mktemp("data") / "set")


@pytest.fixture(scope="session")
def splits(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("data") / "splits.json"
    write_splits(path, {"train": ["000000", "000001"], "validation": ["000002"]}, SplitBy.person, 0)
    return path


@pytest.fixture
def exported(data, splits, tmp_path) -> Callable[..., Path]:
    def make(format: str, **options) -> Path:
        export(data, tmp_path / format, format, splits=splits, **options)
        return tmp_path / format

    return make
