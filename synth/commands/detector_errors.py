"""`synth detector-errors`: errors of a detector by cause of occlusion, and of simulated detectors on the same clips."""

import io
from dataclasses import dataclass, field
from pathlib import Path

from dmae.data.json_values import json_text
from dmae.files.contents import write_atomic
from dmae.parallel import Backend, running_on
from dmae.reporting.tables import print_tables
from synth.detector.fitting import load_preset
from synth.recognition.detector_errors import draw_errors, study, tables

WRITES = "folder"
EXAMPLES = (
    "synth detector-errors data=runs/detected",
    "synth detector-errors data=runs/detected simulated=[blazepose,shelf_openpose] out=runs/errors",
)
_NUMBERS, _FIGURE = "errors.json", "errors.png"


@dataclass(frozen=True)
class DetectorErrorsCommand:
    """Measure the errors of a detector against the truth, by the occluder of a joint, the distance in depth, the size
    of people, crowding, and the direction of view.

    The detections are those in the clips, as `dmae detect clip=...` makes them from images.
    """

    data: str = "???"
    """Folder of a data set, or of a clip, with truth and detections."""
    extra_data: list[str] = field(default_factory=list)
    """More data sets for the same table."""
    simulated: list[str] = field(default_factory=lambda: ["shelf_openpose", "hrnet_like"])
    """Presets of the simulated detector that are run on the same clips: names, or YAML files."""
    seed: int = 0
    """Seed of the simulated detectors."""
    workers: int = 1
    """Processes; -1 for one per core."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""
    out: str | None = None
    """Folder of the results and the figure; by default `errors` in the data set."""


def default_out(config: DetectorErrorsCommand) -> Path:
    return Path(config.data) / "errors"


def run(config: DetectorErrorsCommand, out: Path) -> None:
    simulated = {Path(name).stem: load_preset(name) for name in config.simulated}
    folders = [Path(path) for path in (config.data, *config.extra_data)]
    with running_on(config.backend):
        studied = study(folders, simulated, config.seed, config.workers)
    print_tables(tables(studied))
    write_atomic(out / _NUMBERS, json_text({"detectors": studied}) + "\n")
    draw_errors(studied).savefig(buffer := io.BytesIO(), format="png", dpi=90)
    write_atomic(out / _FIGURE, buffer.getvalue())
    print(f"{out / _NUMBERS}, {out / _FIGURE}")
