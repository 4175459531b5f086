"""Fixtures and settings shared by all tests."""

import gc
import os
import sys
from pathlib import Path

# Tests share the machine: networks this small take three times the processor time on two threads. Set before
# anything imports numpy or torch; commands that tests start inherit it.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import pytest

from tests.support.browser import find_chromium

# Tests start a hundred processes. Without bytecode on disk each of them compiles what it imports, for seconds.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# What is imported stays. A seventh of the processor time of tests went to looking for garbage in it.
gc.disable()

# In continuous integration a red run means that a change broke something: the same examples are tried every time. An
# example may take any time, because other processes can load the machine.
hypothesis.settings.register_profile("local", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "local")


_FIRST = ("test_compiled.py", "test_training.py")
"""In a new checkout the first capture compiles for 20 s. The one file does that, the other needs none of it: of two
processes only one compiles."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put files with slow tests first: processes are given files in this order, and none waits long for the last."""
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: (item.path.name not in _FIRST, item.path.name != _FIRST[0], item.path not in slow))


def pytest_collection_finish() -> None:
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real recordings, named by the environment variable DMAE_DATA."""
    folder = os.environ.get("DMAE_DATA")
    if not folder:
        pytest.skip("needs real recordings: set DMAE_DATA to the folder that holds cmu/, shelf/ and pose2sim/")
    if not Path(folder).is_dir():
        pytest.fail(f"DMAE_DATA={folder}: no such folder")
    return Path(folder)


@pytest.fixture(scope="session")
def browser():
    """A headless Chromium, one for all tests of a process."""
    program = find_chromium()
    if program is None:
        pytest.skip("needs Chromium: install it (`apt-get install chromium`), or name it in CHROMIUM")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield chromium
        chromium.close()


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave the benches alone unless they are asked for with `-m bench`."""
    asked = "bench" in config.getoption("markexpr")
    return None if asked or collection_path.name != "bench" else True
