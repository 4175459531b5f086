"""`synth realism`: measure the results of a real detector on rendered images of fully visible people."""

from dataclasses import asdict
from pathlib import Path

import cv2

from dmae.data.json_values import json_text
from dmae.data.store import clip_folders
from dmae.files.contents import write_atomic
from dmae.reporting.tables import Table, print_tables
from synth.commands.config import RealismCommand
from synth.recognition.realism import HEAD, described, draw_sheet, judge, rates, worst
from synth.recognition.silhouettes import comparison, photographed, rendered

_NUMBERS, _PICTURE = "realism.json", "worst.jpg"
_REAL_IMAGES = 12
"""Number of images of each real camera that are looked at."""


def default_out(config: RealismCommand) -> Path:
    return Path(config.data) / "realism"


def run(config: RealismCommand, out: Path) -> None:
    folders = config.data, *config.extra_data
    judged = judge(folders, config.detector, config.every, config.workers)
    if not judged:
        raise ValueError(f"{config.data}: in no image is a person in plain sight, there is nothing to look at")
    rows = rates(judged)
    print_tables([Table(f"{config.detector.name} on {len(judged)} people", HEAD, [described(row) for row in rows])])
    numbers: dict = {"detector": config.detector.name, "rows": [asdict(row) for row in rows]}
    if config.real:
        real = photographed(Path(config.real), _REAL_IMAGES)
        clips = [clip for folder in folders for clip in clip_folders(Path(folder))]
        table = comparison(rendered(clips, config.every), real)
        print_tables([table])
        numbers["silhouettes"] = {"real": config.real, "columns": list(table.header), "rows": table.rows}
    write_atomic(out / _NUMBERS, json_text(numbers) + "\n")
    sheet = cv2.cvtColor(draw_sheet(worst(judged, config.shown)), cv2.COLOR_RGB2BGR)
    write_atomic(out / _PICTURE, cv2.imencode(".jpg", sheet, [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tobytes())
    print(f"{out / _NUMBERS}, {out / _PICTURE}")
