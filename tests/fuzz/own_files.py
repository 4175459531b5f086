"""Readers of videos, models, and the files by which the project's own commands work together."""

import json
from functools import cache
from pathlib import Path

import numpy as np

from dmae.commands.data_sets import SETTINGS, ClipSet
from dmae.data.images import write_image, write_video
from dmae.data.resume import claim_folder
from dmae.data.skeleton import BODY25
from dmae.data.store import save_clip
from dmae.datasets import clip_files
from dmae.detection.pipeline import make_detector
from dmae.detection.recording import open_recording
from dmae.detection.registry import PoseDetectorConfig
from dmae.evaluation.benchmark.clips import find_definition
from dmae.files.checksums import find_damage, find_data_set_damage, refuse_damaged, write_checksums
from dmae.files.contents import read_text
from dmae.online.json_lines import read_frame
from dmae.registry import load_function
from tests.fuzz.reader import Reader
from tests.support.clips import full_clip


def _write_videos(folder: Path) -> None:
    images = np.random.default_rng(0).integers(0, 255, (4, 16, 16, 3)).astype(np.uint8)
    for camera in ("left", "right"):
        write_video(folder / f"videos/{camera}.mp4", images, 25)


def _write_folders(folder: Path) -> None:
    for camera in ("left", "right"):
        for frame in range(2):
            write_image("rgb", folder / f"videos/{camera}/{frame:03d}.png", np.full((16, 16, 3), 40 * frame, np.uint8))


def _read_videos(folder: Path) -> list:
    found = open_recording(folder / "videos", fps=None if (folder / "videos/left.mp4").exists() else 25.0)
    images = [list(camera.read(0, min(len(camera), 10))) for camera in found.cameras]
    return [found.alignment.fps, *images]


@cache
def _onnx_model() -> bytes:
    """A model that finds all 17 joints where the image is brightest."""
    import onnx

    make, kind = onnx.helper, onnx.TensorProto.FLOAT
    nodes = [
        make.make_node("ReduceMean", ["image"], ["grey"], axes=[1], keepdims=1),
        make.make_node("Mul", ["grey", "ones"], ["maps"]),
    ]
    maps = make.make_tensor_value_info("maps", kind, (1, 17, 64, 48))
    given = make.make_tensor_value_info("image", kind, (1, 3, 64, 48))
    ones = make.make_tensor("ones", kind, (1, 17, 1, 1), [1.0] * 17)
    graph = make.make_graph(nodes, "brightest", [given], [maps], [ones])
    return make.make_model(graph, opset_imports=[make.make_opsetid("", 13)], ir_version=8).SerializeToString()


def _read_onnx(folder: Path) -> str:
    return make_detector(PoseDetectorConfig(name="onnx", path=str(folder / "model.onnx"))).skeleton.name


def _read_function(folder: Path) -> None:
    load_function("solver", read_text(folder / "option.txt"))


def _write_sealed(folder: Path) -> None:
    save_clip(full_clip(3, 2), folder)
    write_checksums(folder)


def _read_sealed(folder: Path) -> None:
    find_damage(folder)
    find_data_set_damage(folder, ["a"])
    refuse_damaged(folder, None)


_SETTINGS = {"command": "dmae capture", "options": {"fill": "none", "draw": [2, 3]}, "data": "walks"}


def _write_data_set(folder: Path) -> None:
    claim_folder(folder / SETTINGS, _SETTINGS, "clips")
    _write_sealed(folder / "a")


def _read_clip_files(folder: Path) -> list:
    return [
        [file.read(0, 2), *(file.person(of, 0, 0, 2) for of in file.persons if file.persons[of])]
        for file in clip_files(folder)
    ]  # fmt: skip


BENCHMARK = """about: Two levels
seed: 7
options: scene.seconds=2 rig=ring
small: 1
full: 2
levels:
  - name: self
    about: One person
    options: scene.persons=[1,1]
    sets:
      alone: scene.radius=1.5
"""
LINES = [
    {"cameras": {"left": [[[812.5, 340.1, 0.93]] * 25, [None] * 25], "right": []}},
    {"cameras": {"right": [[[12, 34, 0.5]] * 25]}},
]


def _read_lines(folder: Path) -> list:
    lines = read_text(folder / "lines.jsonl").splitlines()
    return [read_frame(line, ("left", "right"), BODY25)[0] for line in lines]


OWN_FILES = [
    Reader("detection/videos", _write_videos, _read_videos),
    Reader("detection/folders of images", _write_folders, _read_videos),
    Reader("detection/onnx", lambda folder: (folder / "model.onnx").write_bytes(_onnx_model()), _read_onnx),
    Reader("option/function", lambda folder: (folder / "option.txt").write_text("dmae.regression.solvers:ours"),
           _read_function, unnamed=True),
    Reader("data set/whole clips", _write_data_set, lambda folder: sorted(ClipSet(folder, _SETTINGS).whole),
           (SETTINGS, "a/checksums.json")),
    Reader("clip/checksums", _write_sealed, _read_sealed, ("checksums.json",)),
    Reader("clip/windows", lambda folder: save_clip(full_clip(3, 2), folder), _read_clip_files),
    Reader("benchmark/definition", lambda folder: (folder / "mine.yaml").write_text(BENCHMARK),
           lambda folder: find_definition(str(folder / "mine.yaml"))),
    Reader("live/lines", lambda folder: (folder / "lines.jsonl").write_text("\n".join(map(json.dumps, LINES))),
           _read_lines, unnamed=True),
]  # fmt: skip
