"""Pictures that the fuzzer changes."""

from pathlib import Path

import numpy as np

from dmae.data.images import write_image, write_video

_IMAGE = np.arange(16 * 16).reshape(16, 16)
_WRITE_PICTURE = {
    "depth": lambda path, frame: write_image("depth", path, _IMAGE.astype(np.float32) / 100),
    "ids": lambda path, frame: write_image("ids", path, _IMAGE),
    "parts": lambda path, frame: write_image("parts", path, _IMAGE),
    "normals": lambda path, frame: write_image("normals", path, np.broadcast_to([0.6, 0.0, 0.8], (16, 16, 3))),
    "flow": lambda path, frame: write_image("flow", path, np.dstack([_IMAGE, -_IMAGE]) / 8.0),
    "amodal": lambda path, frame: write_image("amodal", path, _IMAGE.astype(np.uint32) << 8 * frame),
}


def write_pictures(kind: str, folder: Path) -> None:
    if kind == "rgb":
        rgb = np.random.default_rng(0).integers(0, 255, (4, 16, 16, 3)).astype(np.uint8)
        write_video(folder / "rgb/left.mp4", rgb, 25)
        return
    for frame in range(2):
        _WRITE_PICTURE[kind](folder / f"{kind}/left/{frame:06d}.png", frame)


def write_colours(ending: str, folder: Path) -> None:
    for frame in range(2):
        write_image("rgb", folder / f"rgb/left/{frame:06d}.{ending}", np.dstack([_IMAGE] * 3).astype(np.uint8))
