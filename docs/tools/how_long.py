"""Measure what simulation, images, capture and completion take, and how large they get: `how_long.json`.

    python docs/tools/how_long.py             # two CPU minutes

Each step is timed in processor seconds of one core on clips of two lengths. The difference is the cost of a frame, the
rest that of a clip. A million frames are computed from the cost of a frame.
"""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from provenance import measured

import dmae
import synth
from dmae.data.json_values import json_text
from dmae.progress import duration

FILE = Path(__file__).parents[2] / "docs/results/how_long.json"
_SECONDS = 1.0, 8.0
"""Lengths of the two clips, s."""
_MILLION = 1_000_000
_CORES = 1, 2, 8, 32


def main() -> None:
    command = {"command": "python docs/tools/how_long.py"}
    with tempfile.TemporaryDirectory() as folder:
        _clip(1.0, 1, 2, folder)  # imports and compiled functions
    labels = {(people, cameras): _labels(people, cameras) for people, cameras in ((1, 5), (2, 5), (4, 5), (2, 10))}
    images = {(quality, people): _images(quality, people) for quality in ("draft", "standard") for people in (2, 4)}
    steps = _steps()
    tables = {
        "labels": {
            "columns": ["people", "cameras", "CPU s a clip", "CPU ms a frame", "kB a frame"],
            "rows": [[str(p), str(c), f"{fixed:.1f}", f"{1000 * each:.0f}", f"{size / 1000:.1f}"]
                     for (p, c), (fixed, each, size) in labels.items()],
        },
        "images": {
            "columns": ["rgb, 1032 x 776 px", "people", "CPU s a clip", "CPU ms an image", "kB an image (video)"],
            "rows": [[quality, str(people), f"{fixed:.1f}", f"{1000 * each:.0f}", f"{size / 1000:.0f}"]
                     for (quality, people), (fixed, each, size) in images.items()],
        },
        "steps": {
            "columns": ["step, two people in five cameras", "CPU s a recording", "CPU ms a frame"],
            "rows": [[name, f"{fixed:.2f}", f"{1000 * each:.1f}"] for name, (fixed, each) in steps.items()],
        },
        "million": {
            "columns": ["a million frames of two people in five cameras", *(f"{n} core{'s' * (n > 1)}" for n in _CORES),
                        "on disk"],
            "rows": [
                _row("simulate, label, detect", labels[2, 5][1], labels[2, 5][2]),
                _row("draft images of five cameras", *(5 * each for each in images["draft", 2][1:])),
                *(_row(name, each, None) for name, (_, each) in steps.items()),
            ],
        },
    }  # fmt: skip
    made = {name: command | table for name, table in tables.items()}
    FILE.write_text(json_text({"measured": measured("mujoco", "torch"), "tables": made}) + "\n")


def _row(name: str, seconds: float, size: float | None) -> list[str]:
    """Return a row of the table of a million frames: time by cores, and GB."""
    spent = [seconds * _MILLION / cores for cores in _CORES]
    times = [f"{each / 86400:.1f} days" if each > 48 * 3600 else duration(each) for each in spent]
    return [name, *times, "" if size is None else f"{size * _MILLION / 1e9:.0f} GB"]


def _spent(function) -> float:
    begun = time.process_time()
    function()
    return time.process_time() - begun


def _clip(seconds: float, people: int, cameras: int, out: str | Path) -> dmae.Clip:
    """Make a data set of one clip, as `synth generate` does, and return the clip."""
    rig = synth.RigConfig(ring=synth.RingConfig(views=cameras))
    return next(synth.generate(clips=1, seed=3, seconds=seconds, persons=[people, people], rig=rig, out=out))


def _labels(people: int, cameras: int) -> tuple[float, float, float]:
    """Return the CPU seconds of a clip and of a frame, and the bytes of a frame."""
    took, sizes, frames = [], [], []
    for seconds in _SECONDS:
        spent = []
        for _ in range(3):  # the least is disturbed least by other programs
            with tempfile.TemporaryDirectory() as folder:
                begun = time.process_time()
                clip = _clip(seconds, people, cameras, folder)
                spent.append(time.process_time() - begun)
                size = sum(path.stat().st_size for path in Path(folder, clip.id).iterdir())
        took.append(min(spent))
        sizes.append(size)
        frames.append(len(clip))
    each, size = (np.diff(values)[0] / np.diff(frames)[0] for values in (took, sizes))
    return max(0.0, took[0] - frames[0] * each), each, size


def _images(quality: str, people: int) -> tuple[float, float, float]:
    """Return the CPU seconds of a clip and of an image, and the bytes of an image."""
    took, sizes, images = [], [], []
    for seconds in (0.04, 0.16, 0.48):  # the first compiles shaders
        with tempfile.TemporaryDirectory() as folder:
            rig, data = synth.preset("rig", "shelf"), Path(folder, "data")
            list(synth.generate(clips=1, seed=3, seconds=seconds, persons=[people, people], rig=rig, out=data))
            begun = time.process_time()
            (clip,) = synth.render(data, images=["rgb"], quality=quality, out=Path(folder, "seen"))
            took.append(time.process_time() - begun)
            sizes.append(sum(path.stat().st_size for path in Path(folder, "seen").rglob("*.mp4")))
            images.append(len(clip) * len(clip.rig))
    took, sizes, images = took[1:], sizes[1:], images[1:]
    each = (took[1] - took[0]) / (images[1] - images[0])
    return max(0.0, took[0] - images[0] * each), each, sizes[1] / images[1]


def _steps() -> dict[str, tuple[float, float]]:
    """Return the CPU seconds of a recording and of a frame of two people in five cameras, by step."""
    with tempfile.TemporaryDirectory() as folder:
        long, short = (_clip(seconds, 2, 5, Path(folder, str(seconds))) for seconds in (10.0, 5.0))
    complete = dmae.completer(long.detections.skeleton)
    dmae.capture(short)
    captured = {id(clip): dmae.capture(clip) for clip in (long, short)}
    complete(captured[id(short)], short.fps)

    def costs(step) -> tuple[float, float]:
        of_long, of_short = (min(_spent(lambda clip=clip: step(clip)) for _ in range(2)) for clip in (long, short))
        each = (of_long - of_short) / (len(long) - len(short))
        return max(0.0, of_short - each * len(short)), each

    return {
        "capture": costs(dmae.capture),
        "complete": costs(lambda clip: complete(captured[id(clip)], clip.fps)),
    }


if __name__ == "__main__":
    sys.exit(main())
