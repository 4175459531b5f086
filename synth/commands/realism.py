"""`synth realism`: measure the results of a real detector on rendered images of fully visible people."""

from dataclasses import asdict, dataclass, field
from pathlib import Path

import cv2

from dmae.data.json_values import json_text
from dmae.detection.registry import PoseDetectorConfig
from dmae.files.contents import write_atomic
from dmae.parallel import Backend, running_on
from dmae.reporting.tables import Table, print_tables
from synth.recognition.realism import HEAD, described, draw_sheet, judge, rates, worst

WRITES = "folder"
EXAMPLES = (
    "synth realism data=runs/data",
    "synth realism data=runs/office extra_data=[runs/market] every=5 workers=2 out=runs/realism",
)
_NUMBERS, _PICTURE = "realism.json", "worst.jpg"


@dataclass(frozen=True)
class RealismCommand:
    """Run a detector on people in plain sight in rendered images, and measure how many it finds and the errors of their
    joints.

    A person is in plain sight if at least 80 % of the joints are visible, or hidden only by the person's own body. Each
    person is cut out of the image, and detected without further information.
    """

    data: str = "???"
    """Folder of a data set with colour images, or of a clip."""
    extra_data: list[str] = field(default_factory=list)
    """More data sets for the same table."""
    detector: PoseDetectorConfig = field(default_factory=PoseDetectorConfig)
    every: int = 1
    """Number of frames from one examined image of a camera to the next."""
    shown: int = 36
    """Number of people in the figure, those with the worst detections."""
    workers: int = 1
    """Processes; -1 for one per core."""
    backend: Backend = Backend.loky
    """What runs the processes: this machine, or a cluster."""
    out: str | None = None
    """Folder of the results and the figure; by default `realism` in the data set."""

    def __post_init__(self):
        for name in ("every", "shown"):
            if getattr(self, name) < 1:
                raise ValueError(f"{name}: expected 1 or more, got {getattr(self, name)}")


def default_out(config: RealismCommand) -> Path:
    return Path(config.data) / "realism"


def run(config: RealismCommand, out: Path) -> None:
    folders = [Path(path) for path in (config.data, *config.extra_data)]
    with running_on(config.backend):
        judged = judge(folders, config.detector, config.every, config.workers)
    if not judged:
        raise ValueError(f"{config.data}: in no picture is a person in plain sight, there is nothing to look at")
    rows = rates(judged)
    print_tables([Table(f"{config.detector.name} on {len(judged)} people", HEAD, [described(row) for row in rows])])
    numbers = {"detector": config.detector.name, "rows": [asdict(row) for row in rows]}
    write_atomic(out / _NUMBERS, json_text(numbers) + "\n")
    sheet = cv2.cvtColor(draw_sheet(worst(judged, config.shown)), cv2.COLOR_RGB2BGR)
    write_atomic(out / _PICTURE, cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tobytes())
    print(f"{out / _NUMBERS}, {out / _PICTURE}")
