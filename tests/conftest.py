"""Fixtures shared by all tests."""

import os
from pathlib import Path

import hypothesis
import pytest

# Where a red run must mean a change broke something, properties are tried on the same examples every time.
hypothesis.settings.register_profile("ci", derandomize=True)
if os.environ.get("CI"):
    hypothesis.settings.load_profile("ci")


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of real recordings, named by the environment variable DMAE_DATA."""
    folder = os.environ.get("DMAE_DATA")
    if not folder:
        pytest.skip("needs real recordings: set DMAE_DATA to the folder that holds cmu/, shelf/ and pose2sim/")
    if not Path(folder).is_dir():
        pytest.fail(f"DMAE_DATA={folder}: no such folder")
    return Path(folder)


@pytest.fixture(scope="module")
def one_thread():
    """PyTorch on one core: small networks are slower on several, and tests share the machine."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)
