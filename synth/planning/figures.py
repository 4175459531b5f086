"""Figures of a plan: curves by number of cameras, maps of the floor, views from each camera."""

import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib.image
import numpy as np
from matplotlib.figure import Figure

from dmae.data.cameras import CameraRig
from dmae.viewing.layers import LayersConfig, chosen_layers
from dmae.viewing.sheet import write_sheet
from synth.planning.check import FIGURES
from synth.planning.plan import CameraPlan, PlannedRig, check_numbers
from synth.planning.rehearsal import Rehearsal, rehearse
from synth.viewing.rooms import draw_rooms

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


def people_to_show(plan: CameraPlan) -> Rehearsal:
    """Return the first clip that the rigs were checked on, reduced to its middle frame."""
    rehearsal = rehearse(plan.config, check_numbers(plan.config)[0])
    frame = len(rehearsal.qpos) // 2
    shown = slice(frame, frame + 1)
    return replace(rehearsal, qpos=rehearsal.qpos[shown], joints=rehearsal.joints[shown])


def views_figure(plan: CameraPlan, planned: PlannedRig, people: Rehearsal) -> Figure:
    """Draw the view of each camera on simulated people in their room."""
    clip = people.seen_by(_smaller(planned.rig), plan.config.detector)
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


def _smaller(rig: CameraRig) -> CameraRig:
    """Return the cameras with images scaled to the drawn width."""
    scale = _VIEW_WIDTH / rig.size[:, 0]
    K = rig.K.copy()
    K[:, :2] *= scale[:, None, None]
    return replace(rig, K=K, size=np.maximum(1, np.round(rig.size * scale[:, None])).astype(int))
