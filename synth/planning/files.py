"""Write the files of a plan: rigs for `rig=` and captures, lists to print, and all numbers as JSON."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import yaml

from dmae.data.json_values import json_text
from dmae.data.store import write_atomic
from dmae.formats.calibrations.pose2sim import write_cameras
from dmae.reporting.tables import Table
from synth.planning.plan import CameraPlan, PlannedRig

NUMBERS = "plan.json"
_HEADER = ("camera", "mount", "x m", "y m", "height m", "pan deg", "tilt deg", "view deg", "size px")


def write_files(plan: CameraPlan, out: Path) -> None:
    """Write `cameras_<n>.toml`, `rig/planned_<n>.yaml` and `mounting_<n>.txt` of each rig, and `plan.json`."""
    for each in plan.rigs:
        number = len(each.rig)
        write_cameras(each.rig, out / f"cameras_{number}.toml")
        write_atomic(out / "rig" / f"planned_{number}.yaml", _preset(each))
        write_atomic(out / f"mounting_{number}.txt", mounting_text(each))
    write_atomic(out / NUMBERS, json_text(numbers(plan)))


def mounting_table(planned: PlannedRig) -> Table:
    """Return a table with the position and the direction of each camera."""
    rows = [
        (
            name, kind, *(f"{length:.2f}" for length in center), *(f"{angle:.0f}" for angle in angles),
            f"{width} x {high}",
        )
        for name, kind, center, angles, (width, high) in zip(
            planned.rig.names, planned.kind, planned.rig.centers,
            np.column_stack([planned.pan_deg, planned.tilt_deg, planned.view_deg]),
            planned.rig.size, strict=True,
        )
    ]  # fmt: skip
    return Table(f"where to mount {len(rows)} cameras", _HEADER, rows)


def mounting_text(planned: PlannedRig) -> str:
    """Return the mounting list as text to print."""
    table = mounting_table(planned)
    rows = [table.header, *table.rows]
    widths = [max(len(row[column]) for row in rows) for column in range(len(table.header))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    legend = (
        "x, y: on the floor, as in the room's file. Pan: direction of the lens from +x towards +y. Tilt: above the\n"
        "horizontal; below 0 the camera looks down. View: horizontal field of view. Calibrate after mounting."
    )
    return "\n".join([table.caption, "", *lines, "", legend, ""])


def numbers(plan: CameraPlan) -> dict:
    """Return all numbers of a plan for JSON. A figure without data is None."""
    config = plan.config
    return {
        "arena": config.setting().arena,
        "persons": list(config.setting().persons),
        "detector": config.detector.name,
        "seed": config.seed,
        "candidates": plan.candidates,
        "clips": {"search": config.search.clips, "check": config.search.check_clips},
        "rigs": [
            {
                "cameras": len(each.rig),
                "names": list(each.rig.names),
                "mount": each.kind.tolist(),
                "position": np.round(each.rig.centers, 3).tolist(),
                "pan_deg": np.round(each.pan_deg, 1).tolist(),
                "tilt_deg": np.round(each.tilt_deg, 1).tolist(),
                "view_deg": np.round(each.view_deg, 1).tolist(),
                "predicted": asdict(each.prediction),
                "expected": _plain(each.figures),
                "worth": [_plain(worth) for worth in each.worth],
                "floor_seen_by": {str(least): each.floor.share(least) for least in (2, 3)},
            }
            for each in plan.rigs
        ],
    }


def _plain(figures: dict) -> dict:
    return {
        name: [round(value, 3) if np.isfinite(value) else None for value in (each.value, each.low, each.high)]
        for name, each in figures.items()
    }


def _preset(planned: PlannedRig) -> str:
    """Return the YAML preset of a rig. `rig=planned_<n>` finds it with `--config-dir`."""
    rig = planned.rig
    cameras = [
        {
            "name": name,
            "size": rig.size[view].tolist(),
            "K": rig.K[view].ravel().tolist(),
            "cam_from_world": rig.cam_from_world[view, :3].ravel().tolist(),
            "dist": rig.dist[view].tolist(),
            "fisheye": bool(rig.fisheye[view]),
        }
        for view, name in enumerate(rig.names)
    ]
    comment = f"# {len(rig)} cameras that `synth plan` chose.\n"
    return comment + yaml.safe_dump({"name": f"planned_{len(rig)}", "cameras": cameras}, sort_keys=False)
