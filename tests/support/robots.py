"""The robot that people are retargeted to."""

import pytest

from dmae.formats.retargeting import find_model


def needs_robot() -> None:
    """Skip a test where mink or the model of the robot is absent."""
    pytest.importorskip("mink", reason="mink, of the extra `robots`, is not installed")
    try:
        find_model()
    except FileNotFoundError as error:
        pytest.skip(str(error))
