"""Draw a training's error on held-back people by its steps, beside interpolation inside the same windows.

python docs/tools/training_curve.py runs/paper/pretrained paper_training
"""

import json
import sys
from pathlib import Path

import matplotlib as mpl
from matplotlib import pyplot
from provenance import provenance
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from dmae.data.json_values import json_text

ROOT = Path(__file__).parents[2]


def main(folder: Path, name: str) -> None:
    logged = EventAccumulator(str(folder / "tensorboard"))
    logged.Reload()
    series = {
        what: [(event.step + 1, round(event.value, 2)) for event in logged.Scalars(f"hidden_{what}")]
        for what in ("model_mm", "interpolation_mm", "model_recall", "interpolation_recall")
    }
    made = {
        "command": f"make paper && python docs/tools/training_curve.py runs/paper/pretrained {name}",
        **provenance("torch"),
        "steps": json.loads((folder / "model.json").read_text())["steps"],
        "validation": series,
    }
    (ROOT / "docs/results" / f"{name}.json").write_text(json_text(made) + "\n")
    mpl.rcParams["svg.hashsalt"] = name
    figure, axes = pyplot.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    for axis, unit, label in zip(axes, ("mm", "recall"), ("MPJPE, mm", "within 0.2 m, %"), strict=True):
        for what, colour, words in (
            ("model", "tab:red", "the paper's network"),
            ("interpolation", "tab:gray", "interpolation inside the window"),
        ):
            axis.plot(*zip(*series[f"{what}_{unit}"], strict=True), color=colour, label=words)
        axis.set_xlabel("steps of 16 windows")
        axis.set_ylabel(f"masked joints: {label}")
    axes[0].set_ylim(bottom=0)
    axes[0].legend()
    figure.savefig(ROOT / "docs/images" / f"{name}.svg", metadata={"Date": None})


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
