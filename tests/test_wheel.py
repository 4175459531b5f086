"""The project installed as a wheel, far from its checkout, finds its own configurations and scenes."""

import os
import subprocess
import sys
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dmae.completion.weights import shipped
from dmae.data.clip import Source
from dmae.data.store import load_clip, save_clip
from tests.support.circling_people import circling_people, clip_of

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """A folder of installed packages that holds the built wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def run(site, code, cwd):
    environment = os.environ | {"PYTHONPATH": str(site)}
    return subprocess.run([sys.executable, "-c", code], cwd=cwd, env=environment, capture_output=True, text=True)


def test_it_is_the_wheel_that_runs(site, tmp_path):
    done = run(site, "import dmae, synth; print(dmae.__file__, synth.__file__)", tmp_path)
    assert all(name.startswith(str(site)) for name in done.stdout.split())


@pytest.mark.slow
def test_it_generates_and_captures(site, tmp_path):
    arguments = "'synth', 'generate', 'out=set', 'clips=1', 'scene=office', 'scene.seconds=0.4'"
    done = run(site, f"import sys; sys.argv = [{arguments}]; from synth.cli import main; main()", tmp_path)
    assert done.returncode == 0, done.stderr
    arguments = "'dmae', 'capture', 'data=set', 'out=captured'"
    done = run(site, f"import sys; sys.argv = [{arguments}]; from dmae.cli import main; main()", tmp_path)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "captured/000000/clip.json").is_file()


@pytest.mark.skipif(not shipped(), reason="no weights are in this checkout")
def test_it_brings_weights_and_completes_with_them(site, tmp_path):
    poses = circling_people(20, 1, rng=np.random.default_rng(0))
    hidden = np.zeros(poses.source.shape, bool)
    hidden[8:12, :, 4] = True
    save_clip(replace(clip_of(poses, "walk"), poses=poses.without(hidden)), tmp_path / "captured")
    arguments = "'dmae', 'complete', 'clip=captured', 'out=completed'"
    done = run(site, f"import sys; sys.argv = [{arguments}]; from dmae.cli import main; main()", tmp_path)
    assert done.returncode == 0, done.stderr
    assert ((load_clip(tmp_path / "completed").poses.source == Source.COMPLETED) == hidden).all()


def test_it_checks_a_solver_and_lends_pytest_its_cases(site, tmp_path):
    (tmp_path / "test_theirs.py").write_text(
        "from dmae.regression.solvers import ours\n"
        "def test_theirs(check_triangulation):\n    check_triangulation(ours)\n"
    )
    arguments = "'dmae', 'regress', 'solver=test_theirs:ours'"
    done = run(site, f"import sys; sys.argv = [{arguments}]; from dmae.cli import main; main()", tmp_path)
    assert done.returncode == 0, done.stderr
    done = run(site, "import pytest; raise SystemExit(pytest.main(['-q', '-p', 'no:cacheprovider']))", tmp_path)
    assert done.returncode == 0, done.stdout
