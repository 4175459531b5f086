"""The files of a plan: rigs, lists to print, figures, and the page."""

import tempfile
from dataclasses import asdict, replace
from pathlib import Path

import matplotlib.image
import numpy as np
import yaml
from matplotlib.figure import Figure

from dmae.data.json_values import json_text
from dmae.files.contents import check_vacant, whole_folder, write_atomic
from dmae.formats.pose2sim import write_cameras
from dmae.reporting.page import CaptionedFigure, Section, write_report
from dmae.reporting.tables import Table
from dmae.viewing.config import LayersConfig
from dmae.viewing.overlay import chosen_layers
from dmae.viewing.show import write_sheet
from synth.interactions.registry import people as counted
from synth.planning.config import PlanConfig
from synth.planning.plan import FIGURES, CameraPlan, Expected, PlannedRig, check_numbers, make_plan
from synth.planning.search import Rehearsal, rehearse
from synth.rendering.rooms import draw_rooms
from synth.rigs.config import listed_rig
from synth.scene.sampling import people_range

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
        "persons": list(people_range(config.setting(), config.interaction)),
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
    """YAML preset of a rig, found as `rig=planned_<n>` with `--config-dir`."""
    rig, keys = planned.rig, ("name", "size", "K", "cam_from_world", "dist", "fisheye")
    cameras = [{key: getattr(camera, key) for key in keys} for camera in listed_rig(rig).cameras]
    comment = f"# {len(rig)} cameras that `synth plan` chose.\n"
    return comment + yaml.safe_dump({"name": f"planned_{len(rig)}", "cameras": cameras}, sort_keys=False)


# Figures of a plan: curves by number of cameras, maps of the floor, views from each camera.

_CURVES = ("missing", "pcp", "error")
_MARKS = {"wall": "s", "ceiling": "o", "tripod": "^", "given": "D"}
_COLOUR = "#0072b2"
_VIEW_WIDTH = 320
"""Width of the drawn views, px."""


def curves_figure(plan: CameraPlan) -> Figure:
    """Draw the expected figures for each number of cameras, with 95 % intervals."""
    figure = Figure(figsize=(11.5, 3.2), layout="constrained")
    numbers = [len(each.rig) for each in plan.rigs]
    for axes, name in zip(figure.subplots(1, len(_CURVES)), _CURVES, strict=True):
        value, low, high = np.array([[getattr(each.figures[name], part) for part in ("value", "low", "high")]
                                     for each in plan.rigs]).T  # fmt: skip
        axes.errorbar(numbers, value, [value - low, high - value], fmt="o-", color=_COLOUR, capsize=3, label="captured")
        if name == "missing":
            predicted = [each.prediction.missing for each in plan.rigs]
            axes.plot(numbers, predicted, "x--", color="#777777", label="by visibility alone")
            axes.legend(frameon=False, fontsize=8)
        heading, unit = FIGURES[name]
        axes.set(xlabel="cameras", ylabel=f"{heading} [{unit}]", xticks=numbers)
        axes.grid(color="#dddddd", linewidth=0.5)
        axes.spines[["top", "right"]].set_visible(False)
    return figure


def floor_figure(planned: PlannedRig) -> Figure:
    """Draw a map of the people's area: the number of cameras that see each point, and the cameras."""
    figure = Figure(figsize=(5.2, 4.6), layout="constrained")
    axes = figure.subplots()
    floor = planned.floor
    seen = np.where(floor.cameras < 0, np.nan, floor.cameras)
    half = (floor.x[1] - floor.x[0]) / 2
    extent = (floor.x[0] - half, floor.x[-1] + half, floor.y[0] - half, floor.y[-1] + half)
    drawn = axes.imshow(
        seen.T, origin="lower", extent=extent, cmap="viridis", vmin=0, vmax=len(planned.rig), interpolation="nearest"
    )
    figure.colorbar(drawn, ax=axes, label="cameras that see a person there", ticks=range(len(planned.rig) + 1))
    for name, kind, (x, y, z), pan in zip(
        planned.rig.names, planned.kind, planned.rig.centers, np.radians(planned.pan_deg), strict=True
    ):
        axes.plot(x, y, _MARKS[kind], color="#d55e00", markersize=7)
        axes.annotate("", (x + 0.8 * np.cos(pan), y + 0.8 * np.sin(pan)), (x, y), arrowprops={"arrowstyle": "->"})
        axes.annotate(f"{name} {z:.1f} m", (x, y), textcoords="offset points", xytext=(5, 5), fontsize=7)
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.margins(0.12)
    return figure


def views_figure(plan: CameraPlan, planned: PlannedRig, people: Rehearsal) -> Figure:
    """Draw the view of each camera on simulated people in their room, in the middle frame."""
    # Images are scaled to the drawn width.
    scale, K = _VIEW_WIDTH / planned.rig.size[:, 0], planned.rig.K.copy()
    K[:, :2] *= scale[:, None, None]
    size = np.maximum(1, np.round(planned.rig.size * scale[:, None])).astype(int)
    middle = len(people.simulation.qpos) // 2
    rig, frames = replace(planned.rig, K=K, size=size), slice(middle, middle + 1)
    clip = people.seen_by(rig, plan.config.detector, frames)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "sheet.png"
        write_sheet(clip, path, chosen_layers(clip, LayersConfig()), rows=1, width=_VIEW_WIDTH, rooms=draw_rooms(clip))
        picture = matplotlib.image.imread(path)
    height, width = picture.shape[:2]
    figure = Figure(figsize=(width / 140, height / 140))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.imshow(picture)
    axes.set_axis_off()
    return figure


# The page of a plan: expected capture for each number of cameras, mounting positions, and views.

PAGE = "plan.html"
_SHOWN = ("missing", "pcp", "error", "switches")
"""Figures in the table. The other figures are only in the JSON file."""
_ABOUT = (
    "Cameras were chosen by the visibility of joints of simulated people, computed by rays, and by how often the "
    "detector's preset misses joints so visible. The figures are of other simulated people: their simulated detections "
    "were captured, gaps filled by straight lines, and compared with the truth. Intervals are of 95 %, over clips of "
    "different people. They do not cover effects that the simulation lacks: another detector, an inexact calibration, "
    "light, clothes, furniture that is not in the room's file."
)
_WORTH = (
    "What a camera is worth: the figure with all cameras less the figure without this one. An interval on both sides "
    "of 0 means that the camera could be left out without a loss that these people show."
)


def numbers_table(plan: CameraPlan) -> Table:
    """Return a table of the figures by number of cameras."""
    header = ("cameras", *(", ".join(FIGURES[name]) for name in _SHOWN), "floor seen by 2 or more", "by 3 or more")
    rows = [
        (
            str(len(each.rig)),
            *(figure_text(each.figures[name]) for name in _SHOWN),
            *(f"{each.floor.share(least):.0f} %" for least in (2, 3)),
        )
        for each in plan.rigs
    ]
    return Table("expected capture for each number of cameras", header, rows)


def figure_text(figure: Expected, signed: bool = False) -> str:
    """Return a figure with its interval as text."""
    sign = "+" if signed else ""
    if not np.isfinite(figure.value):
        return "-"
    text = f"{figure.value:{sign}.1f}"
    return text if not np.isfinite(figure.low) else f"{text} ({figure.low:{sign}.1f} to {figure.high:{sign}.1f})"


def worth_table(planned: PlannedRig) -> Table:
    """Return a table of the gain from each camera."""
    shown = ("missing", "pcp", "error")
    header = ("camera", *(f"{FIGURES[name][0]}, {FIGURES[name][1]}" for name in shown))
    rows = [
        (name, *(figure_text(worth[figure], signed=True) for figure in shown))
        for name, worth in zip(planned.rig.names, planned.worth, strict=True)
    ]
    return Table("gain from each camera", header, rows)


def write_plan(config: PlanConfig, out: Path) -> CameraPlan:
    """Plan cameras, and write the page, the rigs and the lists to a folder, which is whole or does not appear. Raises
    as `make_plan`, and ValueError if the folder is not empty."""
    check_vacant(out, "the plan")
    plan = make_plan(config)
    with whole_folder(out) as partial:
        write_files(plan, partial)
        write_page(plan, partial / PAGE)
    return plan


def write_page(plan: CameraPlan, path: Path) -> None:
    """Write the page as one HTML file."""
    config = plan.config
    people = rehearse(config, check_numbers(config)[0])  # of the first clip that the rigs were checked on
    sections = [
        Section(
            "How many cameras",
            _ABOUT,
            tables=[numbers_table(plan)],
            figures=[CaptionedFigure("Intervals of 95 % over clips of different people.", curves_figure(plan))],
        )
    ]
    for each in plan.rigs:
        number = len(each.rig)
        files = f"Rig: cameras_{number}.toml, rig/planned_{number}.yaml. List to print: mounting_{number}.txt."
        figures = [
            CaptionedFigure("The people's area from above; squares: walls, discs: ceiling, triangles: tripods.",
                            floor_figure(each)),
            CaptionedFigure("What each camera sees.", views_figure(plan, each, people)),
        ]  # fmt: skip
        tables = [mounting_table(each), *([worth_table(each)] if each.worth else [])]
        sections.append(Section(f"{number} cameras", f"{files} {_WORTH if each.worth else ''}", tables, figures))
    scene = config.setting()
    persons = counted(people_range(scene, config.interaction))
    summary = [
        f"Room {Path(scene.arena).stem}, {persons} within {scene.radius:g} m of ({scene.middle[0]:g}, "
        f"{scene.middle[1]:g}), detector {config.detector.name}, seed {config.seed}. {plan.candidates} cameras were "
        f"tried on {config.search.clips} clips, the rigs checked on {config.search.check_clips} others of "
        f"{scene.seconds:g} s.",
        *([f"The room's file: {'; '.join(plan.room)}."] if plan.room else []),
    ]
    write_report(path, "Where to mount cameras", sections, summary=summary)
