"""A fixed corpus of changed files: each is read, or refused with its name, in bounded time and memory."""

from pathlib import Path

import pytest

from tests.fuzz.bombs import NO_FILES, count
from tests.fuzz.readers import READERS, registered
from tests.fuzz.run import WRONG, fuzz

pytestmark = pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="memory is limited as Linux does it")
COUNT = 10
"""Inputs for each reader; `make fuzz` takes as many as asked for."""
FOUND = [
    ("benchmark/definition", 44), ("calibration/shelf", 1022), ("clip/physics", 880), ("clip/physics", 882),
    ("clip/physics", 1860), ("clip/physics", 3388), ("clip/windows", 37), ("clip/windows", 131),
    ("detection/onnx", 116), ("detection/onnx", 199), ("detection/videos", 2264), ("images/normals", 4386),
    ("live/lines", 17), ("live/lines", 113), ("mesh/obj", 1039), ("model/checkpoint", 20066),
    ("model/checkpoint", 20107), ("model/weights", 650), ("model/weights", 1039),
    ("motion/amc", 20037), ("motion/list", 434), ("motion/list", 616), ("recording/clip", 358),
    ("recording/clip", 1065), ("recording/clip", 60302), ("recording/coco", 2701), ("recording/coco", 3668),
    ("recording/coco", 3939), ("recording/easymocap", 60217), ("recording/panoptic", 1056),
    ("poses/movement", 6903), ("recording/pose2sim", 150), ("recording/shelf", 6545), ("room/mjcf", 2163),
    ("room/mjcf", 20166), ("run/settings", 4796), ("scene/spec", 280), ("scores/scores", 1746),
]  # fmt: skip
"""Inputs that failed once, by reader and index."""


def test_every_reader_is_fuzzed():
    names = [reader.name for reader in READERS]
    assert len(set(names)) == len(names)
    assert registered() <= set(names)


@pytest.fixture(scope="module")
def outcomes():
    """What becomes of all inputs; the child process is started once."""
    bombs = [(reader.name, -count(reader), count(reader)) for reader in READERS]
    changed = [(reader.name, 0, COUNT) for reader in READERS] + [(name, index, 1) for name, index in FOUND]
    return list(fuzz(bombs + changed))


@pytest.mark.slow
def test_bombs_and_what_is_no_file_are_refused_with_their_name(outcomes):
    planted = [each for each in outcomes if each[1] < 0]
    assert len(planted) == sum(map(count, READERS))
    assert [each for each in planted if each[2] in WRONG] == []
    bombs = [each for each in planted if -1 - each[1] >= len(NO_FILES)]
    assert [each for each in bombs if each[2] != "refused"] == []


@pytest.mark.slow
def test_changed_files_are_read_or_refused_with_their_name(outcomes):
    changed = [each for each in outcomes if each[1] >= 0]
    assert len(changed) == len(READERS) * COUNT + len(FOUND)
    assert [each for each in changed if each[2] in WRONG] == []
