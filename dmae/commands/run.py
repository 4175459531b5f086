"""`dmae run`: from videos to completed people, a report and a file for other programs, in one go."""

import shutil
from dataclasses import fields
from pathlib import Path

from dmae.commands import capture, complete, detect, export, report
from dmae.commands.config import DetectCommand, FilmedConfig, RunCommand
from dmae.data.store import clip_folders
from dmae.formats.reading import DataConfig
from dmae.formats.registry import pose_writer
from dmae.formats.writing import export_path

_DETECTED, _CAPTURED, _COMPLETED = "detected", "captured", "completed"


def run(config: RunCommand, out: Path) -> None:
    if (config.videos or config.photos) and config.calibration is None:
        raise ValueError(
            "expected calibration=<file>: without it people are found in 2D only; use dmae detect for that"
        )
    for name in config.export:
        pose_writer.find(name).check_installed()
    folders = {name: out / name for name in (_DETECTED, _CAPTURED, _COMPLETED)}
    filmed = {each.name: getattr(config, each.name) for each in fields(FilmedConfig)}
    told = detect.run(DetectCommand(**filmed), folders[_DETECTED], out.resolve().name, least=2)
    data = DataConfig(name="clip", path=str(folders[_DETECTED]))
    capture.run(capture.CaptureCommand(data=data, capture=config.capture), folders[_CAPTURED], told)
    complete.run(complete.CompleteCommand(clip=str(folders[_CAPTURED]), weights=config.weights), folders[_COMPLETED])
    page = out / "report.html"
    report.run(report.ReportCommand(clip=str(folders[_COMPLETED])), page)
    clips, failed = clip_folders(folders[_COMPLETED]), []
    for name in config.export:
        for clip in clips:
            stem = "poses" if len(clips) == 1 else f"poses_{clip.name}"
            suffix = export_path(Path("poses"), name).suffix
            path = out / (stem + suffix if suffix else f"{stem}_{name}")
            # An earlier run wrote them, perhaps with other options; `dmae export` takes no folder for its own.
            shutil.rmtree(out / f"{stem}_images" if name == "coco" else path, ignore_errors=True)
            try:
                export.run(export.ExportCommand(clip=str(clip), format=name), path)
            except ValueError as error:  # The other files are written
                failed.append(f"export={name}: {error}")
    if failed:
        raise ValueError("; ".join(failed))
    print(out)


def interrupted(config: RunCommand, out: Path) -> str:
    return f"the complete parts of {out} stay; the same command continues it"
