"""`dmae export`: poses to a file that other programs read."""

from pathlib import Path

from dmae.command_line.outputs import check_out
from dmae.commands.config import ExportCommand
from dmae.data.clip import person_names
from dmae.data.store import load_clip
from dmae.evaluation.review import with_decisions
from dmae.formats.poses import REGIONS, describe_filled, states_completed
from dmae.formats.registry import pose_writer
from dmae.formats.writing import export_path, format_of, write_poses
from dmae.reporting.tables import counted


def written_path(config: ExportCommand, out: Path) -> Path:
    return export_path(out, config.format)


def run(config: ExportCommand, out: Path) -> None:
    writer = pose_writer.find(config.format or format_of(out))
    out = written_path(config, out)
    check_out(out, "folder" if writer.folder else "file")
    folder = Path(config.clip)
    clip = load_clip(folder)
    kept = with_decisions(clip, folder)
    written = write_poses(
        kept,
        out,
        config.format,
        skeleton=config.skeleton,
        unit=config.unit,
        keep_mm=config.keep_mm,
        robot=config.robot,
        people=config.people,
    )
    frames, persons = written.poses.xyz.shape[:2]
    named = config.skeleton if config.skeleton in writer.rigs else written.poses.skeleton.name
    people = [name.rpartition(":")[2] for name in config.people] or person_names(clip, persons)
    # Where people have a file each, somebody may have none.
    apart = [out.parent / f"{out.stem}_{name}{out.suffix}" in written.files for name in people]
    own = [n for n in range(persons) if apart[n] or not any(apart)]
    size = f"{counted(frames, 'frame')}, {counted(len(own), 'person', 'people')}"
    if writer.fills:
        for said in describe_filled(written.poses.select(persons=own), [people[n] for n in own], writer.fills):
            print(said)
    if writer.errors and states_completed(written.poses):
        print(REGIONS)
    print(f"{', '.join(map(str, written.files))}: {size}, {named}")
    if kept is not clip and kept.poses is not None and clip.poses is not None:
        left_out = int((kept.poses.source != clip.poses.source).sum())
        print(f"{left_out} joints are left out by the decisions of dmae review")
