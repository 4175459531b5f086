"""`synth detector-errors`: errors of a detector by cause of occlusion, and of simulated detectors on the same clips."""

import io
from pathlib import Path

from dmae.data.json_values import json_text
from dmae.files.contents import write_atomic
from dmae.reporting.tables import print_tables
from synth.commands.config import DetectorErrorsCommand
from synth.recognition.detector_errors import draw_errors, study, tables

_NUMBERS, _FIGURE = "errors.json", "errors.png"


def default_out(config: DetectorErrorsCommand) -> Path:
    return Path(config.data) / "errors"


def run(config: DetectorErrorsCommand, out: Path) -> None:
    studied = study((config.data, *config.extra_data), config.simulated, config.seed, config.workers)
    print_tables(tables(studied))
    write_atomic(out / _NUMBERS, json_text({"detectors": studied}) + "\n")
    draw_errors(studied).savefig(buffer := io.BytesIO(), format="png", dpi=90)
    write_atomic(out / _FIGURE, buffer.getvalue())
    print(f"{out / _NUMBERS}, {out / _FIGURE}")
