"""Fixtures that several tests of the generator share."""

import warnings

import numpy as np
import pytest

from dmae.data.clip import Poses3D
from synth.rendering.opengl import find_backend
from tests.support.detectors import occlusion_of, three_persons
from tests.support.rigs import preset


@pytest.fixture
def gl() -> None:
    """Skip tests where no OpenGL works."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if find_backend() is None:
            pytest.skip("no OpenGL works here")


@pytest.fixture(params=[pytest.param("gl", marks=pytest.mark.gl), "rays"])
def painter(request, monkeypatch) -> str:
    """Once by OpenGL, where there is one, and once by ray casting."""
    if request.param == "rays":
        monkeypatch.setattr("synth.rendering.renderer.find_backend", lambda: None)
    else:
        request.getfixturevalue("gl")
    return request.param


@pytest.fixture(scope="module")
def rig():
    """Two of Shelf's cameras."""
    return preset("shelf")[1:3]


@pytest.fixture(scope="module")
def truth() -> Poses3D:
    return three_persons()


@pytest.fixture(scope="module")
def occlusion(truth, rig):
    return occlusion_of(truth, rig)


@pytest.fixture(scope="module")
def true_xy(truth, rig) -> np.ndarray:
    return rig.project(truth.xyz[:, :, :25])[0]
