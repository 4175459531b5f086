"""The first lines of the demo's page, which tell a newcomer what to look at."""

import os
import re
import signal
import time
from pathlib import Path

from dmae.commands.demo import training, what_to_look_at
from tests.support.commands import dmae, start_command

PLAYER = Path(__file__).parents[3] / "dmae/reporting/assets/player.js"


def result(method: str, mm: float) -> dict:
    """Scores of a method with two classes of gaps of 100 joints each."""
    gap = {"hidden": 120, "filled": 100, "mpjpe": mm}
    return {"method": method, "mean": {"gaps": [gap, gap]}}


def test_marks_are_those_of_the_player_and_errors_those_of_the_scores():
    scores = {
        "skeleton": "body25",
        "recording": "test",
        "clips": {"000000": {}, "000001": {}},
        "results": [result("dmae", 52.4), result("model", 68.6), result("linear", 95.2)],
    }
    look, errors = what_to_look_at(scores, "model", "a minute, 2 steps")
    marks = {re.search(r'"(truth|completed)', line)[1]: line for line in PLAYER.read_text().splitlines()
             if "shape('<path" in line or "shape(`<path" in line if re.search(r'"(truth|completed)', line)}  # fmt: skip
    assert "M8 2 14 8 8 14 2 8z" in marks["completed"] and 'stroke="var(--red)"' in marks["completed"]
    assert "diamonds with a red outline" in look
    assert "M1 8H15" in marks["truth"] and "thin lines are the truth" in look
    for words in ("of joints of body25, in these 2 clips", "tables under Scores on test compare",
                  "240 joints that cameras did not measure. All three fill 200 of them; there the mean error is 52",
                  "52\N{NO-BREAK SPACE}mm with these weights", "69\N{NO-BREAK SPACE}mm with the network that this demo "
                  "trained for a minute, 2 steps", "95\N{NO-BREAK SPACE}mm with straight"):  # fmt: skip
        assert words in errors


def test_a_network_of_few_steps_is_said_to_be_one():
    assert training(20, small=True) == "20 steps" and training(250, small=False) == "a minute (250 steps)"
    assert training(1, small=False) == "a minute (1 step, too few to learn much: the machine was busy)"


def test_a_folder_with_other_files_is_refused_before_anything_is_made(tmp_path):
    (tmp_path / "session").mkdir()
    (tmp_path / "session/calibration.toml").touch()
    done = dmae(tmp_path, "demo", "out=session")
    assert done.returncode == 1 and "for the demo; found a folder with calibration.toml; choose another" in done.stderr
    assert [path.name for path in (tmp_path / "session").iterdir()] == ["calibration.toml"]


def test_an_interrupted_demo_keeps_what_it_has(tmp_path):
    demo = start_command(tmp_path, "dmae", "demo", "size=small", "out=demo")
    while not (tmp_path / "demo/train").is_dir() and demo.poll() is None:
        time.sleep(0.05)
    os.killpg(demo.pid, signal.SIGINT)
    _, said = demo.communicate(timeout=60)
    assert demo.returncode == 130 and said.strip().endswith("demo holds what is finished; the same command continues")
