"""Cost of capture, by cameras, people, ghosts and rate, offline and frame by frame: `python -m tests.bench.costs`.

All in processor time of one thread, so that another program on the machine changes little. Clips are made up; frame by
frame, the Shelf recording is captured where DMAE_DATA names its folder.
"""

import argparse
import json
import os
import platform
import subprocess
import time
from dataclasses import fields, replace
from datetime import date
from importlib import metadata
from pathlib import Path
from typing import ClassVar

import matplotlib.pyplot as plt
import numpy as np
import torch

from dmae.completion.complete import Completer, completers
from dmae.data.clip import Clip, Poses3D
from dmae.formats.shelf import read_shelf
from dmae.metrics.comparison import match, take_matched
from dmae.online.capture import OnlineCapture
from dmae.reconstruction.config import CaptureConfig
from dmae.reconstruction.pipeline import capture
from tests.support.clips import looking_inwards
from tests.support.detected_people import FPS, detected_clip, walk
from tests.support.ghosts import haunted_clip

VIEWS, PEOPLE = (2, 4, 8, 16, 32), (1, 2, 5, 10, 20)
GHOSTS, RATES = (0, 50, 150, 500), (1, 5, 25, 100, 250, 1000)
_FRAMES, _SECONDS = 50, 8


def dome(views: int) -> np.ndarray:
    """(V, 3) m, camera centres on a dome of 6 m."""
    index = np.arange(views)
    height, angle = 0.5 + 4.5 * index / views, index * np.pi * (3 - 5**0.5)
    return np.stack([6 * np.cos(angle), 6 * np.sin(angle), height], -1)


def crowd(persons: int) -> np.ndarray:
    """(F, P, 25, 3) people on a grid of 1.2 m who walk half a metre each."""
    side = int(np.ceil(np.sqrt(persons)))
    starts = 1.2 * (np.stack(np.divmod(np.arange(persons), side), -1) - (side - 1) / 2)
    return np.stack([walk(start, start + (0.5, 0.1), 0.95, i, _FRAMES) for i, start in enumerate(starts)], 1)


def milliseconds(clip: Clip, runs: int = 3) -> tuple[float, int]:
    """Return the processor time of capture, ms a frame, the least of some runs, and the number of people."""
    spent = []
    for _ in range(runs):
        begun = time.process_time()
        found = capture(clip, CaptureConfig()).xyz.shape[1]
        spent.append(1000 * (time.process_time() - begun) / len(clip))
    return min(spent), found


def by_views(persons: int = 4) -> list[dict]:
    """Cost with more and more cameras around people."""
    clips = [detected_clip(crowd(persons), rig=looking_inwards(dome(views))) for views in VIEWS]
    return [dict(zip(("views", "ms", "people"), (len(c.rig), *milliseconds(c)), strict=True)) for c in clips]


def by_people(views: int = 5) -> list[dict]:
    """Cost with more and more people in the middle of cameras."""
    clips = {n: detected_clip(crowd(n), rig=looking_inwards(dome(views))) for n in PEOPLE}
    return [dict(zip(("persons", "ms", "people"), (n, *milliseconds(c)), strict=True)) for n, c in clips.items()]


def by_ghosts(fixed: bool) -> list[dict]:
    """Cost with more and more ghosts in each of five views, and two people."""
    found = []
    for ghosts in GHOSTS:
        spent, people = milliseconds(haunted_clip(ghosts, 15, fixed), runs=1)
        found.append({"ghosts": ghosts, "ms": spent, "people": people})
    return found


def by_rate() -> list[dict]:
    """People and errors in the same eight seconds of two people, at other rates."""
    ways = [((-1.5, 0), (1.5, 0.2), 1, 0), ((0, -1.5), (0.4, 1.5), 0.9, 1.6)]
    paths = np.stack([walk(*way, round(_SECONDS * FPS) + 1) for way in ways], 1)
    found = []
    for rate in RATES:
        at = np.arange(_SECONDS * rate) * FPS / rate
        low = at.astype(int)
        people = paths[low] + (at - low)[:, None, None, None] * (paths[low + 1] - paths[low])
        poses = capture(replace(detected_clip(people), fps=float(rate)), CaptureConfig())
        error = np.linalg.norm(take_matched(poses.xyz, match(poses.xyz, people)) - people, axis=-1)
        measured = float((~np.isnan(error)).mean())
        found.append(
            {"hz": rate, "people": poses.xyz.shape[1], "mm": 1000 * float(np.nanmean(error)), "measured": measured}
        )
    return found


class Timed(Completer):
    """Notes the processor time of each call, ms."""

    spent: ClassVar[list[float]] = []

    def __call__(self, *given) -> Poses3D:
        begun = time.thread_time()
        done = super().__call__(*given)
        self.spent.append(1000 * (time.thread_time() - begun))
        return done


def online(clip: Clip, complete: bool, look_ahead: float | None = None) -> dict:
    """Cost of each frame as it comes, ms, after the first two seconds: the least of three runs that do the same.

    `ms` is that of all threads, `slowest_in_100` that of the thread that takes frames. Meanwhile another one completes
    people: `background` is its longest call.
    """
    torch.set_num_threads(1)
    skeleton, completer = clip.detections.skeleton, None
    if complete:
        shipped = completers(None)(skeleton)
        completer = Timed(**{field.name: getattr(shipped, field.name) for field in fields(shipped)})
    frames = [
        replace(clip.detections, xy=clip.detections.xy[[f]], score=clip.detections.score[[f]]) for f in range(len(clip))
    ]
    runs, calls = [], []
    for _ in range(4):  # the first one compiles
        live, spent = OnlineCapture(clip.rig, skeleton, clip.fps, CaptureConfig(), completer, look_ahead), []
        Timed.spent.clear()
        for frame in frames:
            begun = time.thread_time()
            live.push(frame)
            spent.append(1000 * (time.thread_time() - begun))
        live.flush()
        runs.append(spent)
        calls.append([*Timed.spent])
    late = np.min(runs[1:], 0)[round(2 * clip.fps) :]
    called = np.min(calls[1:], 0)
    return {
        "complete": complete,
        "delay": live.delay,
        "ms": float(late.mean() + called.sum() / len(clip)),
        "slowest_in_100": float(np.percentile(late, 99)),
        "background": float(called.max(initial=0)),
    }


def measure() -> dict:
    """Return all of it."""
    found = {"views": by_views(), "people": by_people(), "rates": by_rate()}
    found |= {"ghosts": by_ghosts(fixed=False), "fixed_ghosts": by_ghosts(fixed=True)}
    if os.environ.get("DMAE_DATA"):
        shelf = read_shelf(Path(os.environ["DMAE_DATA"]) / "shelf")
        found |= {
            "shelf": {"ms": milliseconds(shelf)[0], "online": [online(shelf, complete) for complete in (False, True)]}
        }
    return found


def tables(found: dict) -> dict:
    """Return what was found as tables of text, as pages of the documentation show them."""

    def table(rows: list[dict], columns: dict[str, tuple[str, str]]) -> dict:
        cells = [[format(row[key], form) for key, (_, form) in columns.items()] for row in rows]
        return {"columns": [label for label, _ in columns.values()], "rows": cells}

    cost = {"ms": ("ms a frame", ".1f"), "people": ("people found", "d")}
    rate = {"hz": ("frames/s", "d"), "people": ("people found", "d"), "mm": ("mean error, mm", ".1f")}
    made = {
        "views": table(found["views"], {"views": ("cameras", "d")} | cost),
        "people": table(found["people"], {"persons": ("people", "d")} | cost),
        "rates": table(found["rates"], rate | {"measured": ("joints measured", ".1%")}),
    }
    for name in ("ghosts", "fixed_ghosts"):
        made[name] = table(found[name], {"ghosts": ("ghosts a camera", "d")} | cost)
    if "shelf" in found:
        slowest = {
            "slowest_in_100": ("slowest in 100, ms", ".1f"),
            "background": ("longest in the background, ms", ".0f"),
        }
        online = {"complete": ("completion", ""), "ms": ("mean of all threads, ms", ".1f")}
        slowest |= {"delay": ("delay, frames", "d")}
        made["online"] = table(found["shelf"]["online"], online | slowest)
    return made


def draw(found: dict, file: Path) -> None:
    """Draw the cost by cameras, people and ghosts as curves."""
    curves = (("views", "views", "cameras, 4 people"), ("people", "persons", "people, 5 cameras"))
    figure, axes = plt.subplots(1, 3, figsize=(10, 3), layout="constrained")
    for axis, (name, key, label) in zip(axes, curves, strict=False):
        axis.plot([row[key] for row in found[name]], [row["ms"] for row in found[name]], "o-")
        axis.set_xlabel(label)
    for name, label in (("ghosts", "new in each frame"), ("fixed_ghosts", "at fixed places")):
        axes[2].plot([row["ghosts"] for row in found[name]], [row["ms"] for row in found[name]], "o-", label=label)
    axes[2].set_xlabel("ghosts a camera, 5 cameras, 2 people")
    axes[2].legend()
    for axis in axes:
        axis.set_ylim(0)
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("ms a frame, one core")
    figure.savefig(file, metadata={"Date": None})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", help="JSON file of the figures")
    parser.add_argument("--picture", help="SVG file of the curves")
    asked = parser.parse_args()
    out, found = asked.out, measure()
    print(json.dumps(found, indent=1))
    if asked.picture:
        draw(found, Path(asked.picture))
    if out:
        command = "python -m tests.bench.costs --picture docs/images/capture_cost.svg"
        commit = subprocess.run(["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True).stdout.strip()
        versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("dmae-synth", "numpy", "numba", "torch"))
        made = {
            "command": command,
            "measured": f"{date.today().isoformat()}, commit {commit}, python {platform.python_version()}, {versions}",
            "found": found,
            "tables": {name: {"command": command} | table for name, table in tables(found).items()},
        }
        Path(out).write_text(json.dumps(made, indent=1) + "\n")


if __name__ == "__main__":
    main()
