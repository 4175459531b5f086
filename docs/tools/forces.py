"""Measure the physical labels of `synth label` for all interactions: the tables of `docs/results/forces.json`.

    python docs/tools/forces.py             # two clips of each interaction: 10 minutes
    python docs/tools/forces.py clips=1 keep=runs/interactions     # and keep the clips

For forces, the tables show the share of the force needed by the motion that no contact explains, the balance of the
weight at rest, and the cost of labels relative to generation. For surface points, they show how well the visibility
agrees with id images.
"""

import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import nullcontext
from pathlib import Path

import numpy as np
from provenance import measured

import synth
from dmae.data.json_values import json_text
from dmae.data.labels import Visibility
from dmae.data.store import clip_folders, load_clip
from dmae.progress import progress
from synth.interactions.registry import NO_INTERACTION, interaction
from synth.labels.surfaces import agreement

ROOT = Path(__file__).parents[2]
FILE = ROOT / "docs/results/forces.json"
SEED = 7
INTERACTIONS = {"seconds": 6, "rig": synth.RigConfig(ring=synth.RingConfig(views=2))}
OFFICE = {
    "scene": synth.preset("scene", "office", seconds=1, persons=[4, 5], gathering=0.3),
    "images": ["ids"],
    "quality": "draft",
}
FORCE_COLUMNS = [
    "interaction", "clips", "residual force, % of the weight: median", "95 % below",
    "residual moment, mm of the weight: median", "95 % below", "rests",
    "weight borne at rest, %: least", "median", "most",
]  # fmt: skip
COST_COLUMNS = ["labels", "CPU seconds", "% of generation", "MB"]
SURFACE_COLUMNS = ["points that are", "compared", "agree, %"]
_STILL, _REST = 0.5, 0.5
"""Greatest acceleration of a centre of mass at rest, m/s^2, and least duration of rest, s."""


def main(clips: int, keep: str | None) -> None:
    with nullcontext(keep) if keep else tempfile.TemporaryDirectory() as folder:
        kinds = [NO_INTERACTION, *sorted(interaction.keys())]
        made = (_forces(kind, clips, Path(folder, kind)) for kind in kinds)
        rows = list(progress(made, "interactions", len(kinds)))
        surface, cost = _surface(Path(folder, "office")), _cost()
    command = f"python docs/tools/forces.py clips={clips}"
    tables = {
        "forces": {"command": command, "columns": FORCE_COLUMNS, "rows": rows},
        "surface": {"command": command, "columns": SURFACE_COLUMNS, "rows": surface},
        "cost": {"command": command, "columns": COST_COLUMNS, "rows": cost},
    }
    FILE.write_text(json_text({"measured": measured("mujoco"), "tables": tables}) + "\n")


def _forces(kind: str, clips: int, out: Path) -> list[str]:
    """Generate clips of an interaction, label them, and return a row of the table."""
    list(synth.generate(**INTERACTIONS, clips=clips, seed=SEED, interaction=kind, out=out))
    synth.label(out, ["forces"])
    found = [_measured(folder) for folder in clip_folders(out)]
    residual, moment, rests = (np.concatenate(part) for part in zip(*found, strict=True))
    borne = np.percentile(rests, (0, 50, 100)) if len(rests) else []
    return [
        kind,
        str(len(found)),
        *(f"{100 * value:.1f}" for value in np.percentile(residual, (50, 95))),
        *(f"{1000 * value:.0f}" for value in np.percentile(moment, (50, 95))),
        str(len(rests)),
        *([f"{100 * share:.1f}" for share in borne] or [""] * 3),
    ]


def _cost() -> list[list[str]]:
    """Return a row each for the cost of generation and of labels: four people in 100 frames and 4 views."""
    with tempfile.TemporaryDirectory() as folder:
        options = {"seconds": 4, "persons": [4, 4], "rig": synth.RigConfig(ring=synth.RingConfig(views=4))}
        # The first clip also includes one-time costs.
        list(synth.generate(seconds=0.2, clips=1, seed=SEED, out=Path(folder, "warm")))
        synth.label(Path(folder, "warm"))
        work = {"generation": lambda: list(synth.generate(**options, clips=1, seed=SEED, out=Path(folder, "clip")))}
        for labels in (["contacts", "forces"], ["surface"]):
            work[" and ".join(labels)] = lambda labels=labels: synth.label(Path(folder, "clip"), labels)
        rows, before = [], 0
        for name, task in work.items():
            seconds, bytes_now = _seconds(task), _bytes(Path(folder, "clip"))
            rows.append((name, seconds, (bytes_now - before) / 1e6))
            before = bytes_now
    return [[name, f"{s:.2f}", f"{100 * s / rows[0][1]:.0f}", f"{size:.1f}"] for name, s, size in rows]


def _bytes(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _seconds(work) -> float:
    begun = time.process_time()
    work()
    return time.process_time() - begun


def _surface(out: Path) -> list[list[str]]:
    """Compare surface points with id images. Return a row for each kind of visibility."""
    list(synth.generate(**OFFICE, clips=2, seed=SEED, out=out))
    synth.label(out, ["surface"])
    found = [agreement(load_clip(each), synth.physical_labels(each).surface) for each in clip_folders(out)]
    compared, agreeing = (sum(part) for part in zip(*found, strict=True))
    return [
        [
            kind.name.lower().replace("_", " "),
            str(compared[kind]),
            f"{100 * agreeing[kind] / max(1, compared[kind]):.2f}",
        ]
        for kind in list(Visibility)[:4]
    ]


def _measured(folder: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return residual forces, residual moments and supported weights of all people and frames.

    Forces are shares of the weight. Moments are divided by the weight, m. The third array is the share of the weight
    that contacts support in each period of rest.
    """
    forces, fps = synth.physical_labels(folder).forces, load_clip(folder).fps
    sizes = np.linalg.norm(forces.residual, axis=-1) / forces.weights[:, None]
    speed = np.gradient(forces.centre_of_mass.astype(float), 1 / fps, axis=0)
    change = np.linalg.norm(np.gradient(speed, 1 / fps, axis=0), axis=-1)
    borne = [
        forces.supported[first:last, person, 0, 2].mean() / forces.weights[person]
        for person, first, last in _rests(change, round(_REST * fps))
    ]
    return sizes[..., 0].ravel(), sizes[..., 1].ravel(), np.array(borne)


def _rests(change: np.ndarray, least: int) -> Iterator[tuple[int, int, int]]:
    """Yield person, first frame and the frame after the last of each period of rest in accelerations (F, P)."""
    for person, still in enumerate((change < _STILL).T):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
        for first, last in edges.reshape(-1, 2):
            if last - first >= least:
                yield person, first, last


if __name__ == "__main__":
    options = dict(argument.split("=") for argument in sys.argv[1:])
    main(int(options.get("clips", 2)), options.get("keep"))
