"""Measure how good forecasts of generation are, what a second process costs, and what ids add: `generation_cost.json`.

    python docs/tools/generation_cost.py             # 3 minutes on two cores
    python docs/tools/generation_cost.py only=ids

All in seconds of the processor, so that another program on the machine changes little. Of two processes, the seconds
of both are compared with those of one: what is more is lost to what they share.
"""

import json
import os
import resource
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from joblib.externals.loky import get_reusable_executor
from provenance import measured

from dmae.data.json_text import json_text
from synth.datasets import forecast as forecasting
from synth.datasets.clip import GenerateConfig
from synth.datasets.forecast import forecast
from synth.datasets.generate import generate
from synth.rendering.renderer import ImageQuality
from synth.rigs.placement import RingConfig
from synth.rigs.rig import RigConfig
from synth.scene.spec import SceneConfig

FILE = Path(__file__).parents[2] / "docs/results/generation_cost.json"
_TWO = RigConfig(ring=RingConfig(views=2))
_SMALL = RigConfig(ring=RingConfig(views=2, focal=400, size=[384, 288]))
SETS = {
    "labels, 12 clips of 2 s, 2 views": GenerateConfig(clips=12, seed=4, scene=SceneConfig(seconds=2), rig=_TWO),
    "labels, 2 clips of 6 s, 4 to 6 people": GenerateConfig(clips=2, seed=5, scene=SceneConfig(persons=[4, 6])),
    "rgb, draft, 3 clips of 1.2 s": GenerateConfig(
        clips=3, seed=6, scene=SceneConfig(seconds=1.2), rig=_TWO, images=["rgb"], quality=ImageQuality.draft
    ),
    "rgb, depth, ids, 384 x 288, 2 clips of 1.2 s": GenerateConfig(
        clips=2, seed=7, scene=SceneConfig(seconds=1.2), rig=_SMALL, images=["rgb", "depth", "ids"]
    ),
}
"""Data sets that are forecast, then made."""
SHARED = {
    "labels, 4 clips of 6 s": GenerateConfig(clips=4, seed=9),
    "rgb, draft, 4 clips of 1 s": GenerateConfig(
        clips=4, seed=10, scene=SceneConfig(seconds=1), rig=_TWO, images=["rgb"], quality=ImageQuality.draft
    ),
}
"""Data sets that are made by one process and by two."""
IDS = GenerateConfig(clips=1, seed=12, scene=SceneConfig(persons=[4, 4], seconds=0.3), rig=_TWO)
QUALITIES = ImageQuality.draft, ImageQuality.standard
_TIMES = 2
"""Times that ids are measured; the least counts."""


def main(only: str) -> None:
    # Mesa's rasteriser takes as many threads as there are cores; of one process, too, one is compared.
    os.environ["LP_NUM_THREADS"] = "0"
    parts = {"forecast": _forecasts, "workers": _workers, "ids": _ids}
    found = json.loads(FILE.read_text()) if FILE.is_file() else {"tables": {}}
    for name, part in parts.items():
        if only in ("", name):
            command = f"python docs/tools/generation_cost.py only={name}"
            found["tables"][name] = {"command": command} | part()
    FILE.write_text(json_text({"measured": measured("mujoco"), "tables": found["tables"]}) + "\n")


def _forecasts() -> dict:
    """Return the forecasts of data sets beside what they took."""
    forecasting.time.perf_counter = time.process_time
    rows = []
    for name, config in SETS.items():
        with tempfile.TemporaryDirectory() as folder:
            here = replace(config, out=str(Path(folder, "data")))
            foretold = forecast(here)
            took = _seconds(lambda here=here: generate(here))
            size = sum(each.stat().st_size for each in Path(here.out).rglob("*") if each.is_file()) / 1e6
        ratios = (100 * (foretold.seconds / took - 1), 100 * (foretold.megabytes / size - 1))
        rows.append([name, f"{foretold.seconds:.1f}", f"{took:.1f}", *(f"{ratio:+.0f}" for ratio in ratios)])
        print(rows[-1], flush=True)
    columns = ["data set", "forecast, CPU s", "took, CPU s", "time off by, %", "disk off by, %"]
    return {"columns": columns, "rows": rows}


def _workers() -> dict:
    """Return what the same clips cost by one process and by two."""
    rows = []
    for name, config in SHARED.items():
        short = replace(config, clips=2, scene=replace(config.scene, seconds=0.2))
        _spent(replace(short, workers=1))  # imports and caches
        one, two = (_spent(replace(config, workers=workers)) for workers in (1, 2))
        # What it takes to begin processes and import packages in them: the same little work by two and by one.
        beginning = _spent(replace(short, workers=2)) - _spent(replace(short, workers=1))
        two -= beginning
        rows.append([name, f"{one:.1f}", f"{two:.1f}", f"{beginning:.1f}", f"{2 * one / two:.2f}"])
        print(rows[-1], flush=True)
    columns = ["data set", "one process, CPU s", "two, CPU s", "to begin two, CPU s", "times as fast on two idle cores"]
    return {"columns": columns, "rows": rows}


def _spent(config: GenerateConfig) -> float:
    """Make a data set by processes that end with it; return the seconds of the processor of all of them."""
    with tempfile.TemporaryDirectory() as folder:
        begun = _all_seconds()
        generate(replace(config, out=str(Path(folder, "data"))))
        if config.workers > 1:
            get_reusable_executor().shutdown(wait=True)
        return _all_seconds() - begun


def _ids() -> dict:
    """Return what colour costs, and what it costs with ids."""
    rows, pictures = [], IDS.scene.frames * _TWO.ring.views
    for quality in QUALITIES:
        spent = {1: [], 2: []}
        for _ in range(_TIMES):
            for kinds in (["rgb"], ["rgb", "ids"]):
                with tempfile.TemporaryDirectory() as folder:
                    config = replace(IDS, out=str(Path(folder, "data")), quality=quality)
                    generate(config)
                    spent[len(kinds)].append(
                        _seconds(lambda config=config, kinds=kinds: generate(replace(config, images=kinds)))
                    )
        colour, both = min(spent[1]), min(spent[2])
        rows.append(
            [quality.name, *(f"{1000 * each / pictures:.0f}" for each in (colour, both)), f"{both / colour:.2f}"]
        )
        print(rows[-1], flush=True)
    return {"columns": ["quality", "rgb, CPU ms a picture", "rgb and ids", "ratio"], "rows": rows}


def _seconds(work) -> float:
    begun = time.process_time()
    work()
    return time.process_time() - begun


def _all_seconds() -> float:
    """Return the seconds of the processor of this process and of those of its processes that have ended."""
    used = [resource.getrusage(which) for which in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in used)


if __name__ == "__main__":
    main(dict(argument.split("=") for argument in sys.argv[1:]).get("only", ""))
