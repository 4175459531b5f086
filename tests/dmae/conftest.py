"""Fixtures of the capture pipeline's tests."""

from pathlib import Path

import pytest

from dmae.data.clip import Clip
from dmae.formats.shelf import read_shelf


@pytest.fixture(scope="session")
def shelf(data_folder: Path) -> Clip:
    """The real Shelf recording, all five cameras."""
    return read_shelf(data_folder / "shelf")
