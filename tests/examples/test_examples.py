"""Every script in `examples/` runs, prints what its page shows, and draws something."""

import json
import re
import runpy
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from tests.support.benchmarks import simulate_here

EXAMPLES = Path(__file__).parents[2] / "examples"
EXECUTED = EXAMPLES.parent / "docs/tutorials/executed"
_NUMBER = re.compile(r"(?<![\w.-])-?\d+(?:\.\d+)?")
_ROUNDING = re.compile(r"(?<=far-world: worst )[\d.]+ mm")
"""What a solver without enough digits is off by, 5400 km from the origin: 5.5 mm on one processor, 8.3 on another."""
SCRIPTS = sorted(EXAMPLES.glob("*.py"))
NEEDS_RECORDINGS = {"pose2sim_recording", "gait_cycles"}
SMALLER = {
    "dataset_and_model": (
        ["4"],
        {"seconds=3, clips=10": "seconds=1, clips=2", "seconds=4": "seconds=2"},
        """2 clips, 50 frames, 28% of the joints not measured
        measured         PCP  75.1 %   completes  0% of the joints
        linear           PCP  95.7 %   completes 21% of the joints   the same joints: 159 mm off
        this model       PCP  98.6 %   completes 28% of the joints   the same joints: 80 mm off
        shipped weights  PCP  98.9 %   completes 28% of the joints   the same joints: 62 mm off""",
    ),
    "benchmark_method": (
        [str(EXAMPLES.parent / "tests/data/tiny_benchmark.yaml")],
        {"workers=2": "workers=1"},
        """2 clips, checksums: unchecked; mean error in gaps, mm, by level
                              self    edge     all
        linear                  30      57      44
        gaussian_process        24      33      28
        dmae                    19      22      20
        nearest                 34      66      50""",
    ),
    "train_a_detector": (
        ["2"],
        {"clips=5, seconds=1": "clips=2, seconds=0.4"},
        """10 images of 1 clips, loss 0.81 after 2 epochs
        people it has not seen: 0.39 in cells with a nose, 0.41 in others""",
    ),
}
"""Arguments and changes of the text with which a script does less, and what it prints then."""
MOST_LINES = 60


@pytest.mark.slow
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_example_runs_and_draws(script: Path, tmp_path: Path, request, monkeypatch, capsys):
    if script.stem in NEEDS_RECORDINGS:
        request.getfixturevalue("data_folder")
    arguments, changes, shown = SMALLER.get(script.stem, ([], {}, None))
    text = script.read_text()
    for old, new in changes.items():
        assert text.count(old) == 1
        text = text.replace(old, new)
    (tmp_path / script.name).write_text(text)
    # As `python script.py` does; in this process, because imports take seconds.
    monkeypatch.chdir(tmp_path)
    simulate_here(monkeypatch)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "argv", [script.name, str(tmp_path), *arguments])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        warnings.simplefilter("error", UserWarning)
        runpy.run_path(str(tmp_path / script.name), run_name="__main__")
    printed = capsys.readouterr().out.strip()
    assert printed and "nan" not in printed
    shown = shown or json.loads((EXECUTED / f"{script.stem}.json").read_text())["printed"]
    assert _NUMBER.sub("#", printed).split() == _NUMBER.sub("#", shown).split()
    found, stated = (np.array(_NUMBER.findall(_ROUNDING.sub("", text)), float) for text in (printed, shown))
    # Processors round differently, which moves scores.
    np.testing.assert_allclose(found, stated, rtol=0.2, atol=0.5)
    assert (tmp_path / f"{script.stem}.png").stat().st_size > 5_000


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_example_is_short_and_introduced(script: Path):
    source = script.read_text()
    assert source.startswith('"""')
    assert len(source.splitlines()) <= MOST_LINES


def test_triangulation_example_runs_under_pytest(tmp_path: Path):
    """The plugin makes one test a case; the textbook's method fails where the pack says that it does."""
    script = EXAMPLES / "triangulation_check.py"
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--tb=line", str(script)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 1, done.stderr
    assert "8 failed, 17 passed" in done.stdout
