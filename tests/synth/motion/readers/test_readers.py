"""Every reader of motion files, on a small file of its format; and how a reader is added."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import synth
from synth.motion.config import MotionConfig, ProceduralConfig
from synth.motion.procedural.gait import make_motion
from synth.motion.readers import ReadOptions, reader, reader_of
from synth.motion.source import load_motion, read_take, takes
from synth.people.body import SEGMENTS
from tests.support.marker_files import c3d, t_pose
from tests.support.motion_files import amc, bvh
from tests.support.smpl_files import write_smpl


def write_walk(path: Path) -> None:
    walk = make_motion(ProceduralConfig(standing=1), seconds=1, fps=60, rng=np.random.default_rng(0))
    write_smpl(path, walk)


def write_markers(path: Path) -> None:
    pytest.importorskip("ezc3d")
    c3d(path, t_pose(), frames=60)


SAMPLES = {
    "amc": lambda path: amc(path, [{}] * 60),
    "bvh": lambda path: bvh(path, [{}] * 60),
    "c3d": write_markers,
    "npz": write_walk,
}
"""Functions of a path that write 60 frames of an upright person, for every reader."""


@pytest.fixture(params=reader)
def sample(request, tmp_path) -> Path:
    assert request.param in SAMPLES, f"add a sample of .{request.param} files to SAMPLES"
    path = tmp_path / f"01_01.{request.param}"
    SAMPLES[request.param](path)
    return path


def test_a_sample_is_read_as_an_upright_person_on_the_floor(sample):
    motion = read_take(sample)
    assert 50 < len(motion) <= 60
    assert 0.6 < motion.hip_height < 1.2
    np.testing.assert_allclose(motion.root[:, 2], motion.hip_height, atol=0.05)
    assert (motion.rotations[:, SEGMENTS.index("chest"), 2, 2] > 0.9).all()
    turns = motion.rotations
    np.testing.assert_allclose(turns @ turns.swapaxes(-1, -2), np.broadcast_to(np.eye(3), turns.shape), atol=1e-9)
    assert motion.name.startswith("01_01 (")


def test_reading_is_deterministic(sample):
    one, other = (reader_of(sample).function(sample, ReadOptions()) for _ in range(2))
    assert one.name == other.name
    assert np.array_equal(one.root, other.root)
    assert np.array_equal(one.rotations, other.rotations)


def test_the_frame_rate_can_be_given(sample):
    assert read_take(sample, 50.0).fps == 50


def test_an_empty_file_is_refused_by_name(sample):
    sample.write_bytes(b"")
    with pytest.raises(ValueError, match=r"01_01\."):
        read_take(sample)


def test_each_reader_is_a_choice_of_motion(sample):
    kind = sample.suffix[1:]
    motion = load_motion(
        MotionConfig(kind=kind, path=str(sample.parent)), seconds=0.4, fps=25, rng=np.random.default_rng(0)
    )
    assert len(motion) == 10


@pytest.mark.parametrize("name", reader)
def test_sources_and_registry_agree(name):
    found = reader.find(name)
    assert found.name == name
    assert found.function.__module__ == f"synth.motion.readers.{name}"
    assert found.help.endswith(".")
    assert len(found.help) < 90


def test_a_file_of_an_unknown_format_is_refused_with_the_known_ones(tmp_path):
    (tmp_path / "take.fbx").write_text("x")
    with pytest.raises(ValueError, match=r"one of the formats \.amc, \.bvh, \.c3d, \.npz, found '\.fbx'"):
        read_take(tmp_path / "take.fbx")


MINE = '''
"""A format of one number: the hip height of a person who stands for a second."""

import numpy as np

from synth.motion.motion import Motion
from synth.motion.readers import reader


@reader("tall")
def read_motion(path, options):
    """One number, the hip height, m."""
    height = float(path.read_text())
    root = np.tile((0.0, 0.0, height), (30, 1))
    return Motion(path.stem, options.fps or 30.0, root, np.tile(np.eye(3), (30, 16, 1, 1)), height)
'''


@pytest.fixture
def mine(tmp_path, monkeypatch):
    (tmp_path / "my_readers.py").write_text(MINE)
    (tmp_path / "take.tall").write_text("0.93")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(reader, "_added", {})
    yield "my_readers:read_motion"
    sys.modules.pop("my_readers", None)


def test_a_reader_of_your_own_is_one_function(mine, tmp_path):
    config = MotionConfig(kind=mine, path=str(tmp_path), fps=15)
    motion = load_motion(config, seconds=0.5, fps=20, rng=np.random.default_rng(0))
    assert (len(motion), motion.hip_height) == (10, 0.93)
    assert read_take(tmp_path / "take.tall").fps == 30


_USE = """
import numpy as np
from synth.cli import REGISTRIES
from synth.motion.source import MotionConfig, load_motion
preset = REGISTRIES["motion"]()["tall"]
print(preset.meaning)
config = MotionConfig(**preset.values, path=".")
print(load_motion(config, seconds=0.5, fps=20, rng=np.random.default_rng(0)).hip_height)
"""


def test_a_new_module_of_the_package_is_a_choice_of_motion(tmp_path):
    source = Path(synth.__file__).parent
    shutil.copytree(source, tmp_path / "synth", ignore=shutil.ignore_patterns("__pycache__"))
    (tmp_path / "synth/motion/readers/tall.py").write_text(MINE)
    (tmp_path / "take.tall").write_text("0.93")
    paths = os.pathsep.join(map(str, (tmp_path, source.parent)))
    done = subprocess.run(
        [sys.executable, "-c", _USE],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": paths},
        capture_output=True,
        text=True,
    )
    assert done.stdout.splitlines() == ["One number, the hip height, m.", "0.93"], done.stderr


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("bhv", "no motion 'bhv'; did you mean bvh? There are procedural, recorded, amc, bvh, c3d, npz, and"),
        ("my_readers:write", "my_readers has no function 'write'; it has ['read_motion']"),
        ("no_such_module:read", "motion.kind=no_such_module:read: cannot import no_such_module"),
    ],
)
def test_unknown_kinds_are_refused(mine, tmp_path, kind, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        takes(MotionConfig(kind=kind, path=str(tmp_path)))


def test_two_readers_of_one_extension_are_refused():
    def read(path, options):
        """Another one."""

    with pytest.raises(ValueError, match=r"'bvh': there is one already, synth\.motion\.readers\.bvh:read_motion"):
        reader("bvh")(read)
