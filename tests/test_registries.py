"""To add one of a kind is to write one file: each is put into a copy of the packages, and the commands take it.

The files are those of the how-to page, where it has one.
"""

import json
import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from dmae.data.store import load_clip, save_clip
from dmae.formats.calibrations import write_calibration
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from tests.support.clips import full_clip

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[1]
MOTION_READER = '''
import numpy as np

from synth.motion.motion import Motion
from synth.motion.readers import reader


@reader("tall")
def read_motion(path, options):
    """One number, the hip height of a person who stands, m."""
    height = float(path.read_text())
    root = np.tile((0.0, 0.0, height), (30, 1))
    return Motion(path.stem, options.fps or 30.0, root, np.tile(np.eye(3), (30, 16, 1, 1)), height)
'''
COMMANDS = {
    "format": ("dmae capture --help data", "dmae capture data=lizard data.path=recording out=captured"),
    "completion method": ("dmae capture --help", "dmae evaluate data=walk methods=[linear,midpoint] out=scores"),
    "metric": ("dmae evaluate --help", "dmae report scores=[scores] out=report.html"),
    "corruption": ("dmae stress --help", "dmae stress data=walk axes=[shade] methods=[linear] out=stressed"),
    "interaction": (
        "synth generate --help interaction",
        "synth generate interaction=face_off out=facing clips=1 scene.seconds=0.2",
    ),
    "layout": ("synth export --help", "synth export data=facing format=nose_paths out=noses"),
    "room": ("synth generate --help scene", "synth generate scene=kitchen out=inside clips=1 scene.seconds=0.2"),
    "motion reader": (
        "synth generate --help motion",
        "synth generate motion=tall motion.path=takes out=standing clips=1 scene.seconds=0.2",
    ),
    "detector error": (
        "synth generate --help detector.blackouts",
        "synth generate detector.blackouts.share=1 out=blind clips=1 scene.seconds=0.2",
    ),
}  # fmt: skip
"""By kind: help that lists the new one, and a command that uses it."""
BLACKOUTS = "from synth.detector.blackouts import Blackouts"
RUN = """
import json, sys
from pathlib import Path
from tests.support.commands import run_command
done = [run_command(Path.cwd(), *line.split()) for line in json.loads(sys.argv[1])]
print(json.dumps([vars(each) for each in done]))
"""


def code_of(title: str) -> str:
    """Return the file that a section of the page says to write."""
    section = (ROOT / "docs/how-to/add.md").read_text().split(f"\n## {title}\n")[1].split("\n## ")[0]
    (code,) = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    return code


def replace_in(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert text.count(old) == 1, (file, old)
    file.write_text(text.replace(old, new))


def add_one_of_each(checkout: Path) -> None:
    """Write one file of each kind; an error of the detector is also a field of its configuration."""
    (checkout / "dmae/formats/lizard.py").write_text(code_of("A format"))
    (checkout / "dmae/completion/midpoint.py").write_text(code_of("A completion method"))
    (checkout / "dmae/metrics/jerkiness.py").write_text(code_of("A metric"))
    (checkout / "dmae/evaluation/corruption/shade.py").write_text(code_of("A corruption"))
    (checkout / "synth/interactions/face_off.py").write_text(code_of("An interaction"))
    (checkout / "synth/datasets/exporters/nose_paths.py").write_text(code_of("An export layout"))
    (checkout / "synth/motion/readers/tall.py").write_text(MOTION_READER)
    (checkout / "synth/detector/blackouts.py").write_text(code_of("A detector error"))
    config = checkout / "synth/detector/config.py"
    replace_in(config, "from synth.detector.errors_of_persons", f"{BLACKOUTS}\nfrom synth.detector.errors_of_persons")
    replace_in(
        config, "    custom: list", "    blackouts: Blackouts = field(default_factory=Blackouts)\n    custom: list"
    )
    room = (checkout / "scenes/studio.xml").read_text()
    (checkout / "scenes/kitchen.xml").write_text(
        re.sub(r'(name="help" data=)"[^"]*"', r'\1"A kitchen with an island."', room)
    )


@dataclass(frozen=True)
class Ran:
    """A folder in which the commands of a copy of the packages have run, and what they printed.

    Attributes:
        folder: Of inputs and outputs.
        help: By kind.
        printed: By kind.
    """

    folder: Path
    help: dict[str, str]
    printed: dict[str, str]


@pytest.fixture(scope="module")
def ran(tmp_path_factory) -> Ran:
    checkout, work, clip = tmp_path_factory.mktemp("checkout"), tmp_path_factory.mktemp("work"), full_clip(frames=20)
    # What it compiles, in half a minute, other tests use as well; compiled in the copy it would be lost.
    capture(clip, CaptureConfig())
    for part in ("dmae", "synth", "configs", "scenes"):
        shutil.copytree(ROOT / part, checkout / part)
    add_one_of_each(checkout)
    save_clip(clip, work / "walk")
    (work / "recording").mkdir()
    values = np.concatenate([clip.detections.xy, clip.detections.score[..., None]], -1)
    (work / "recording/lizard.json").write_text(json.dumps(values.tolist()))
    write_calibration(clip.rig, work / "recording/calibration.toml", "pose2sim")
    (work / "takes").mkdir()
    (work / "takes/one.tall").write_text("0.93")
    lines = [line for each in COMMANDS.values() for line in each]
    done = subprocess.run(
        [sys.executable, "-c", RUN, json.dumps(lines)],
        cwd=work,
        env=os.environ | {"PYTHONPATH": f"{checkout}{os.pathsep}{ROOT}"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout.splitlines()[-1])
    for line, result in zip(lines, results, strict=True):
        assert result["returncode"] == 0, (line, result["stderr"])
    printed = [result["stdout"] for result in results]
    return Ran(work, dict(zip(COMMANDS, printed[::2], strict=True)), dict(zip(COMMANDS, printed[1::2], strict=True)))


@pytest.mark.parametrize(
    ("kind", "choice", "meaning"),
    [
        ("format", "data=lizard", "The Lizard tracker's JSON"),
        ("completion method", "midpoint", ""),
        ("corruption", "shade", ""),
        ("interaction", "interaction=face_off", "Two people stand still and look at each other."),
        ("layout", "nose_paths", ""),
        ("room", "scene=kitchen", "A kitchen with an island."),
        ("motion reader", "motion=tall", "One number, the hip height of a person who stands, m."),
        ("detector error", "detector.blackouts.share", "Height of the band, as a share of the image's."),
    ],
)
def test_help_lists_the_new_choice(ran, kind, choice, meaning):
    assert choice in ran.help[kind] and meaning in ran.help[kind]


def test_a_new_format_is_read(ran):
    assert load_clip(ran.folder / "captured").poses.xyz.shape[:2] == (20, 2)


def test_a_new_completion_method_and_a_new_metric_are_scored(ran):
    results = json.loads((ran.folder / "scores/scores.json").read_text())["results"]
    assert {result["method"] for result in results} == {"linear", "midpoint"}
    assert all(result["mean"]["jerkiness"] > 0 for result in results)
    assert "jerk" in (ran.folder / "report.html").read_text()


def test_a_new_corruption_is_an_axis(ran):
    (axis,) = json.loads((ran.folder / "stressed/stress.json").read_text())["axes"]
    assert (axis["name"], axis["unit"]) == ("shade", "% of the image")


def test_a_new_interaction_places_people(ran):
    xyz = load_clip(ran.folder / "facing/000000").truth.xyz
    assert xyz.shape[1] == 2


def test_a_new_layout_is_written(ran):
    xyz = load_clip(ran.folder / "facing/000000").truth.xyz
    noses = np.loadtxt(ran.folder / "noses/train_000000.csv", delimiter=",").reshape(len(xyz), -1, 3)
    np.testing.assert_allclose(noses, xyz[:, :, 0])


def test_a_new_room_is_simulated_in(ran):
    assert load_clip(ran.folder / "inside/000000").provenance["spec"]["arena"] == "kitchen"


def test_a_new_motion_reader_moves_people(ran):
    clip = load_clip(ran.folder / "standing/000000")
    assert all("one" in person["motion"] for person in clip.provenance["spec"]["persons"])


def test_a_new_detector_error_is_applied(ran):
    clip = load_clip(ran.folder / "blind/000000")
    assert np.isfinite(clip.truth.xyz).all() and not np.isfinite(clip.detections.xy).any()
