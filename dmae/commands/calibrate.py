"""`dmae calibrate`: refine a calibration by the people in a recording."""

import json
from dataclasses import asdict
from itertools import compress
from pathlib import Path

from dmae.calibration.config import RefineConfig, describe_shortness
from dmae.calibration.refinement import Refined, refine
from dmae.commands.config import CalibrateCommand
from dmae.files.contents import write_atomic
from dmae.formats.pose2sim import write_cameras
from dmae.formats.reading import Clips
from dmae.reporting.tables import Table, print_tables


def written_path(config: CalibrateCommand, out: Path) -> Path:
    return out if out.suffix else out.with_suffix(".toml")


def run(config: CalibrateCommand, out: Path) -> None:
    if out.suffix.lower() != ".toml":
        raise ValueError(
            f"out={out}: expected a file with the suffix .toml; the changes are written beside it, as JSON"
        )
    given, facts_file = config.data.calibration, out.with_suffix(".json")
    if out.is_file() and (not facts_file.is_file() or (given and Path(given).resolve() == out.resolve())):
        raise ValueError(
            f"out={out}: expected a new file, or one that dmae calibrate wrote, other than data.calibration; "
            f"for example out={out.with_stem(f'{out.stem}_2')}"
        )
    clips = Clips(config.data)
    if clips.data_set:
        raise ValueError(
            f"data.path={config.data.path}: expected a recording or a single clip, found a data set; name a clip of "
            f"it, as data.path={clips.folders[0]}"
        )
    clip = clips[0]
    refined = refine(clip, config.refine)
    write_cameras(refined.rig, out)
    facts = {
        "clip": clip.id,
        "changes": [asdict(change) for change in refined.changes],
        "covariance": refined.covariance.tolist(),
        "floor": refined.floor and asdict(refined.floor),
    }
    write_atomic(facts_file, json.dumps(facts, indent=1) + "\n")
    _print(refined, config.refine)
    short = describe_shortness(len(clip) / clip.fps)
    if short and any(change.refined for change in refined.changes):
        print(short)
    print(out)


def _print(refined: Refined, config: RefineConfig) -> None:
    header = ("camera", "moved cm", "turned deg", "focal %", "k1 now", "started late, frames", "px before", "px after")
    timed = config.offsets or config.drift or bool(refined.offset.any())
    asked = (True, True, True, config.focal, config.distortion, timed, True, True)
    rows = []
    for each in refined.changes:
        placed = each.refined and config.extrinsics
        error = ("", "") if each.error_cm is None else (f" +- {each.error_cm:.1f}", f" +- {each.error_deg:.2f}")
        late = "" if each.error_frames is None else f" +- {each.error_frames:.2f}"
        rows.append(
            (
                each.camera,
                f"{each.moved_cm:.1f}{error[0]}" if placed else "stays",
                f"{each.turned_deg:.2f}{error[1]}" if placed else "stays",
                f"{100 * (each.focal - 1):+.2f}",
                f"{each.k1:.3f}",
                f"{each.late_frames:+.2f}{late}",
                "-" if each.residual_before is None else f"{each.residual_before:.1f}",
                "-" if each.residual_after is None else f"{each.residual_after:.1f}",
            )
        )
    shown = [tuple(compress(row, asked)) for row in (header, *rows)]
    print_tables([Table("what changed; reprojection errors are medians", shown[0], shown[1:])])
    if refined.floor is not None:
        known = refined.floor.up is not None and refined.floor.height_m is not None
        how = "; before" if known else " only roughly, by the mean direction of people who stand. Before"
        print(f"the world is turned by {refined.turned_deg:.1f} degrees to be level{how}, {refined.floor.describe()}")
    if refined.note:
        print(refined.note)
