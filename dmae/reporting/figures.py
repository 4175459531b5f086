"""Figures: the views of a clip with its poses drawn, the world from the side and from above, errors by gap."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from dmae.data.cameras import camera_label
from dmae.data.clip import Clip, Poses3D, Source

COMPLETED = "#e5262a"
"""Colour of completed joints, on which fewer than two cameras agree: red, as in the paper's figures."""
PERSONS = ("#2f8fe8", "#f6b12f", "#46c47c", "#b07be8", "#27cbd8", "#f08cc0", "#b9b93c", "#8d9bac")
"""Colours of persons, in the order of their indices. Further persons start again at the first colour."""
_COLUMNS = 4


def views_figure(clip: Clip, frame: int | None = None) -> Figure:
    """Draw every view of one frame with `clip.poses` projected into it, then the world from the side and from above.

    Measured joints have the colour of their person; completed joints are red; views without images are grey. By default
    the frame is `telling_frame`. Raises ValueError if there are no poses or frames, or no such frame.
    """
    if clip.poses is None:
        raise ValueError(f"clip {clip.id!r} has no poses to draw; run dmae.capture(clip)")
    if not len(clip):
        raise ValueError(f"clip {clip.id!r}: expected frames to draw, found none")
    frame = telling_frame(clip.poses) if frame is None else frame
    if not 0 <= frame < len(clip):
        raise ValueError(f"frame={frame}: clip {clip.id!r} has frames 0 to {len(clip) - 1}")
    views = len(clip.rig)
    rows = -(-(views + 2) // _COLUMNS)
    width, height = clip.rig.size[0]
    figure = Figure(figsize=(4 * _COLUMNS, rows * (4 * height / width + 0.3)))
    # Numbers and names beside two of the panels do not move their columns; all columns have room for them.
    figure.set_layout_engine("constrained", w_pad=0.16, h_pad=0.1, rect=(0.015, 0, 0.97, 1))
    axes = figure.subplots(rows, _COLUMNS, squeeze=False).ravel()
    for panel in axes:
        panel.set_box_aspect(height / width)
    pixels, _ = clip.rig.project(clip.poses.xyz[frame : frame + 1])
    for view, name in enumerate(clip.rig.names):
        _draw_view(axes[view], clip, frame, view, pixels[0, view])
        axes[view].set_title(camera_label(name), fontsize=10)
    _draw_world(axes[views], clip, frame, (0, 2), "side")
    _draw_world(axes[views + 1], clip, frame, (0, 1), "top")
    for panel in axes[views : views + 2]:
        for artist in (panel.xaxis, panel.yaxis, *panel.texts):
            artist.set_in_layout(False)
    for spare in axes[views + 2 :]:
        spare.axis("off")
    handles = [
        Line2D([], [], color=PERSONS[0], marker="o", label="measured (a colour for each person)"),
        Line2D([], [], color=COMPLETED, marker="o", label="completed: fewer than two\ncameras agree, or rejected"),
    ]
    if len(axes) > views + 2:
        axes[-1].legend(handles=handles, loc="center", frameon=False)
    else:
        figure.legend(handles=handles, loc="outside lower center", ncols=2, frameon=False)
    return figure


def gaps_figure(scores: dict) -> Figure:
    """Draw the mean error of unmeasured joints by gap length, a panel per number of views, from `evaluate`'s scores."""
    results = [result for result in scores["results"] if any(gap["filled"] for gap in result["mean"]["gaps"])]
    views = list(dict.fromkeys(result["views"] for result in results)) or [0]
    figure = Figure(figsize=(4.6 * len(views) + 1.6, 3.4), layout="constrained")
    panels = figure.subplots(1, len(views), sharey=True, squeeze=False)[0]
    methods = dict.fromkeys(result["method"] for result in results)
    colours = {method: PERSONS[i % len(PERSONS)] for i, method in enumerate(methods)}
    for axes, count in zip(panels, views, strict=True):
        for result in (result for result in results if result["views"] == count):
            gaps = result["mean"]["gaps"]
            errors = [np.nan if gap["mpjpe"] is None else gap["mpjpe"] for gap in gaps]
            axes.plot(range(len(gaps)), errors, "o-", color=colours[result["method"]], label=result["method"])
            axes.set_xticks(range(len(gaps)), [f"{gap['frames']}\n{gap['hidden']} joints" for gap in gaps], fontsize=8)
        axes.set(title=f"{count} views" if count else "synthetic gaps", xlabel="frames without a measurement")
        plain(axes)
    panels[0].set_ylabel("mean error [mm]")
    panels[0].set_ylim(bottom=0)
    handles, labels = panels[0].get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside right upper", frameon=False)
    return figure


def plain(axes: Axes) -> None:
    """Give a plot the grid and the open frame that all plots of pages have."""
    axes.grid(color="#dddddd", linewidth=0.5)
    axes.spines[["top", "right"]].set_visible(False)


def _draw_view(axes: Axes, clip: Clip, frame: int, view: int, pixels: np.ndarray) -> None:
    assert clip.poses is not None
    width, height = clip.rig.size[view]
    if clip.images is not None and clip.has_images:
        # Images of another size than the calibration's are stretched over it.
        place = (-0.5, width - 0.5, height - 0.5, -0.5)
        axes.imshow(clip.images.at("rgb", clip.rig.names[view], frame), aspect="auto", extent=place)
    else:
        axes.set_facecolor("#e9ecef")
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])
    _draw_bones(axes, clip.poses, frame, pixels)


def _draw_world(axes: Axes, clip: Clip, frame: int, plane: tuple[int, int], title: str) -> None:
    """Draw an orthographic view along the axis that is not in `plane`."""
    assert clip.poses is not None
    axes.set_title(title, fontsize=10)
    _draw_bones(axes, clip.poses, frame, clip.poses.xyz[frame][..., plane])
    axes.set_aspect("equal", adjustable="datalim")
    axes.tick_params(labelsize=7, pad=1)
    axes.annotate("m", (1, 0), xycoords="axes fraction", textcoords="offset points", xytext=(4, -9), fontsize=7)
    axes.grid(color="#dddddd", linewidth=0.5)
    axes.set_axisbelow(True)
    if title == "side":
        axes.axhline(0, color="#888888", linewidth=1)
    else:
        camera = clip.rig.centers[:, plane]
        axes.plot(*camera.T, "^", color="#333333", markersize=5)
        for name, place in zip(clip.rig.names, camera, strict=True):
            axes.annotate(name, place, textcoords="offset points", xytext=(4, 4), fontsize=8)


def _draw_bones(axes: Axes, poses: Poses3D, frame: int, points: np.ndarray) -> None:
    """Draw bones and joints at `points` (P, J, 2); a bone is red when either end is completed."""
    completed = poses.source[frame] == Source.COMPLETED
    for person, joints in enumerate(points):
        own = PERSONS[person % len(PERSONS)]
        for parent, child in poses.skeleton.bones:
            if np.isfinite(joints[[parent, child]]).all():
                red = completed[person, [parent, child]].any()
                axes.plot(
                    *joints[[parent, child]].T,
                    "-",
                    color=COMPLETED if red else own,
                    linewidth=2,
                    zorder=3 if red else 2,
                )
        for colour, chosen in ((own, ~completed[person]), (COMPLETED, completed[person])):
            axes.plot(*joints[chosen].T, ".", color=colour, markersize=5, zorder=4)


def telling_frame(poses: Poses3D) -> int:
    """Return the frame with the most completed joints, or else the most missing, or else the most known joints."""
    present = (poses.source != Source.ABSENT).any(-1, keepdims=True)
    kinds = (poses.source == Source.COMPLETED, (poses.source == Source.ABSENT) & present, poses.source != Source.ABSENT)
    return int(next((kind for kind in kinds if kind.any()), kinds[0]).sum((1, 2)).argmax())
