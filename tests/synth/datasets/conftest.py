"""A data set without faults, and copies of it to damage."""

import shutil
from pathlib import Path

import pytest

from dmae.data.store import CHECKSUMS
from synth.datasets.config import GenerateConfig
from synth.datasets.generate import generate
from synth.rendering.config import ImageQuality
from synth.rigs.config import RigConfig, RingConfig
from synth.scene.config import SceneConfig


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    """Make two clips of two people in five frames of two cameras, with all images; every person is detected."""
    out = tmp_path_factory.mktemp("sound") / "data"
    generate(
        GenerateConfig(
            out=str(out),
            seed=3,
            clips=2,
            images=["all"],
            quality=ImageQuality.draft,
            scene=SceneConfig(persons=[2, 2], seconds=0.2),
            rig=RigConfig(ring=RingConfig(views=2, focal=180, size=[192, 144])),
        )
    )
    return out


@pytest.fixture
def data(sound, tmp_path) -> Path:
    """Return a copy without checksums: what is wrong has to be found in the contents."""
    copy = Path(shutil.copytree(sound, tmp_path / "data"))
    for path in copy.rglob(CHECKSUMS):
        path.unlink()
    return copy
