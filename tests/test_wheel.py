"""The project installed as a wheel, far from its checkout, finds its own configurations and scenes."""

import json
import os
import shutil
import subprocess
import sys
import venv
from itertools import chain
from pathlib import Path
from site import getsitepackages

import numpy as np
import pytest

import dmae
from dmae.data.clip import Source
from dmae.data.store import load_clip
from dmae.evaluation.report.findings import examine
from dmae.metrics.score_tables import compared_error

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="module")
def bin(tmp_path_factory) -> Path:
    """Return the programs of a new environment that has the built wheel and the packages it needs, but no checkout."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    subprocess.run(build, cwd=ROOT, check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    venv.create(folder / "env")
    # Packages are those of the tests' environment. A folder that a `.pth` file names is searched, but `.pth` files in
    # it, such as that of the checkout, are not read.
    (site,) = folder.glob("env/**/site-packages")
    (site / "needed.pth").write_text("\n".join(getsitepackages()))
    bin = folder / "env" / ("Scripts" if os.name == "nt" else "bin")
    pip = [sys.executable, "-m", "pip", f"--python={bin / 'python'}", "install", "--quiet", "--no-deps", str(wheel)]
    subprocess.run(pip, check=True, capture_output=True)
    # Machine code of the same sources, which Numba knows by their size and time: compiling it again would take half a
    # minute.
    for code in chain.from_iterable(ROOT.glob(f"{part}/**/__pycache__/*.nb[ci]") for part in ("dmae", "synth")):
        source = code.parents[1] / f"{code.name.partition('.')[0]}.py"
        if source.is_file():  # code of a module that is gone stays behind
            copy = site / code.relative_to(ROOT)
            copy.parent.mkdir(exist_ok=True)
            shutil.copy(code, copy)
            shutil.copystat(source, site / source.relative_to(ROOT))
    return bin


def run(cwd: Path, program: Path, *arguments: str) -> str:
    """Run a program in a folder, with status 0, and return what it printed."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([program, *arguments], cwd=cwd, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_it_is_the_wheel_that_runs(bin, tmp_path):
    printed = run(tmp_path, bin / "python", "-c", "import dmae, synth; print(dmae.__file__, synth.__file__)")
    assert all(name.startswith(str(bin.parent)) for name in printed.split())


@pytest.mark.slow
def test_the_demo_goes_from_an_empty_folder_to_a_page(bin, tmp_path):
    # To start workers would take longer than these clips.
    printed = run(tmp_path, bin / "dmae", "demo", "workers=1", "out='demo,2'")
    assert "[8/8] report" in printed and "Look at demo,2/report.html; what the steps printed" in printed
    assert len(printed.splitlines()) < 30
    out = tmp_path / "demo,2"
    assert (load_clip(out / "captured/000000").poses.source == Source.MEASURED).mean() > 0.8
    results = json.loads((out / "scores/scores.json").read_text())["results"]
    assert [result["method"] for result in results] == ["measured", "linear", "dmae", "model"]
    # People on the page are completed by the weights of the package, not by those of a minute's training.
    captured, completed = (load_clip(out / folder / "000000") for folder in ("captured", "completed"))
    np.testing.assert_allclose(completed.poses.xyz, dmae.complete(captured.poses, 25).xyz, atol=1e-3)
    wrong = [moment.size for moment in examine(completed).moments if moment.kind == "error"]
    assert wrong and max(wrong) < 300, "mm; the worst joint is what the page shows first"
    page = (out / "report.html").read_text()
    assert "<html" in page[:200] and "What to look at: press Play." in page
    hidden = [f"{compared_error(result['mean']):.0f}\N{NO-BREAK SPACE}mm" for result in results[1:]]
    assert f"{hidden[1]} with these weights, {hidden[2]} with the network" in page


def test_it_lends_pytest_its_cases(bin, tmp_path):
    (tmp_path / "test_theirs.py").write_text(
        "from dmae.regression.solvers import ours\n"
        "def test_theirs(check_triangulation):\n    check_triangulation(ours)\n"
    )
    run(tmp_path, bin / "python", "-m", "pytest", "-q", "-p", "no:cacheprovider")
