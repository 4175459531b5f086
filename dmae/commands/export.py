"""`dmae export`: poses to a file that other programs read."""

from dataclasses import dataclass, field
from pathlib import Path

from dmae.command_line.outputs import check_out
from dmae.data.store import load_clip
from dmae.evaluation.review import with_decisions
from dmae.formats.config import LengthUnit
from dmae.formats.registry import pose_writer
from dmae.formats.writing import export_path, write_poses
from dmae.reporting.tables import counted

WRITES = None
EXAMPLES = (
    "dmae export clip=runs/completed out=runs/completed/poses.npz",
    "dmae export clip=runs/completed format=trc unit=mm out=runs/walk.trc",
    "dmae export clip=runs/completed keep_mm=30 out=runs/completed/sure.npz",
    "dmae export clip=runs/data/000000 format=coco out=runs/keypoints.json",
)


@dataclass(frozen=True)
class ExportCommand:
    """Write poses to a file that other programs read."""

    clip: str = "???"
    """Folder of a clip; its captured or completed poses are exported, its truth where it has none. What
    `dmae review` blanked or handed back is left out."""
    format: str = field(default="npz", metadata={"choices": pose_writer})
    """Format of the file."""
    skeleton: str | None = None
    """Skeleton of the file; by default the one the poses are in, and of two fused the first, except for npz."""
    unit: LengthUnit = LengthUnit.m
    """Unit of lengths in a TRC."""
    keep_mm: float | None = None
    """mm; leave out joints that are likely farther than this from the truth, by the uncertainty that they state, and
    completed ones that state none. By default all joints are written."""
    out: str = "???"
    """File to write, by default with the suffix of the format; for panoptic and openpose a folder."""


def run(config: ExportCommand, out: Path) -> None:
    writer = pose_writer.find(config.format)
    out = export_path(out, config.format)
    check_out(out, "folder" if writer.folder else "file")
    folder = Path(config.clip)
    clip = load_clip(folder)
    kept = with_decisions(clip, folder)
    options = {"skeleton": config.skeleton, "unit": config.unit, "keep_mm": config.keep_mm}
    written = write_poses(kept, out, config.format, **options)
    frames, persons = written.xyz.shape[:2]
    print(f"{out}: {counted(frames, 'frame')}, {counted(persons, 'person', 'people')}, {written.skeleton.name}")
    if kept is not clip:
        left_out = int((kept.poses.source != clip.poses.source).sum())
        print(f"{left_out} joints are left out by the decisions of dmae review")
