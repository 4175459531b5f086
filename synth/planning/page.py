"""The page of a plan: expected capture for each number of cameras, mounting positions, and views."""

from pathlib import Path

import numpy as np

from dmae.reporting.page import CaptionedFigure, Section, write_report
from dmae.reporting.tables import Table
from synth.planning.check import FIGURES, Expected
from synth.planning.figures import curves_figure, floor_figure, people_to_show, views_figure
from synth.planning.files import mounting_table
from synth.planning.plan import CameraPlan, PlannedRig

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
    header = ("cameras", *(", ".join(FIGURES[name]) for name in _SHOWN), "floor seen by 2", "by 3")
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


def write_page(plan: CameraPlan, path: Path) -> None:
    """Write the page as one HTML file."""
    people, config = people_to_show(plan), plan.config
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
    persons = f"{scene.persons[0]} to {scene.persons[1]} people" if scene.persons else "2 to 4 people"
    summary = [
        f"Room {Path(scene.arena).stem}, {persons} within {scene.radius:g} m of ({scene.middle[0]:g}, "
        f"{scene.middle[1]:g}), detector {config.detector.name}, seed {config.seed}. {plan.candidates} cameras were "
        f"tried on {config.search.clips} clips, the rigs checked on {config.search.check_clips} others of "
        f"{scene.seconds:g} s.",
        *([f"The room's file: {'; '.join(plan.room)}."] if plan.room else []),
    ]
    write_report(path, "Where to mount cameras", sections, summary=summary)
