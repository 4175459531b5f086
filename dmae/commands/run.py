"""`dmae run`: from videos to completed people, a report and a file for other programs, in one go."""

from dataclasses import dataclass, field
from pathlib import Path

from dmae.commands import capture, complete, detect, export, report
from dmae.commands.detect import DetectCommand, WorldConfig
from dmae.data.store import clip_folders
from dmae.detection.registry import OutputConfig, PoseDetectorConfig
from dmae.formats.reading import DataConfig
from dmae.formats.registry import pose_writer
from dmae.reconstruction.config import CaptureConfig

WRITES = "folder"
EXAMPLES = (
    "dmae run videos=session/videos calibration=session/calibration.toml out=runs/session",
    "dmae run videos=session/videos calibration=session/calibration.toml export=[trc,c3d] workers=4 out=runs/session",
)
_DETECTED, _CAPTURED, _COMPLETED = "detected", "captured", "completed"


@dataclass(frozen=True)
class RunCommand:
    """Turn videos of calibrated cameras into people in 3D: detect, capture, complete, report, export.

    The same command continues an interrupted run.
    """

    videos: str | None = None
    """Folder of a video, or a folder of pictures, for each camera, named as in the calibration."""
    calibration: str | None = None
    """Calibration file, or folder of them."""
    clip: str | None = None
    """Instead of videos: folder of a clip with colour images, or of a data set of them."""
    detector: PoseDetectorConfig = field(default_factory=PoseDetectorConfig)
    capture: CaptureConfig = field(default_factory=CaptureConfig)
    weights: str | None = None
    """Folder that `dmae train` wrote; by default the weights that come with the package."""
    fps: float | None = None
    """1/s; frame rate, by default that of the videos. Required for folders of pictures."""
    offsets: list[int] | None = None
    """Frames by which each camera started late, in the order of the calibration; by default read from the videos."""
    world: WorldConfig = field(default_factory=WorldConfig)
    export: list[str] = field(default_factory=lambda: ["trc"], metadata={"choices": pose_writer})
    """Formats of the poses that are written in addition to the report."""
    workers: int = 1
    """Processes that detect; -1 for one per core."""
    out: str = "runs/run"
    """Folder: `detected`, `captured` and `completed` clips, `report.html`, and `poses` in each format."""

    def __post_init__(self):
        if self.videos is not None and self.calibration is None:
            raise ValueError(
                "expected calibration=<file>: without it people are found in 2D only; use dmae detect for that"
            )


def run(config: RunCommand, out: Path) -> None:
    for name in config.export:
        pose_writer.find(name)
    folders = {name: out / name for name in (_DETECTED, _CAPTURED, _COMPLETED)}
    given = {name: getattr(config, name) for name in ("videos", "calibration", "clip", "detector", "fps", "offsets")}
    detect.run(
        DetectCommand(**given, world=config.world, output=OutputConfig(), workers=config.workers), folders[_DETECTED]
    )
    data = DataConfig(name="clip", path=str(folders[_DETECTED]))
    capture.run(capture.CaptureCommand(data=data, capture=config.capture), folders[_CAPTURED])
    complete.run(complete.CompleteCommand(clip=str(folders[_CAPTURED]), weights=config.weights), folders[_COMPLETED])
    page = out / "report.html"
    report.run(report.ReportCommand(clip=str(folders[_COMPLETED])), page)
    clips = clip_folders(folders[_COMPLETED])
    for name in config.export:
        for clip in clips:
            stem = "poses" if len(clips) == 1 else f"poses_{clip.name}"
            path = out / (f"{stem}_{name}" if pose_writer.find(name).folder else f"{stem}.{name}")
            if not path.is_dir():
                export.run(export.ExportCommand(clip=str(clip), format=name), path)
    print(out)


def interrupted(config: RunCommand, out: Path) -> str:
    return f"the complete parts of {out} stays; the same command continues it"
