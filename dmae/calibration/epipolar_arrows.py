"""Epipolar arrows: vectors from the detections of a camera to the epipolar lines of the other cameras."""

from __future__ import annotations

from io import BytesIO

import numpy as np

from dmae.calibration.agreement import measure_agreement, pairs_to_compare
from dmae.calibration.epipolar import ViewSample, fundamental
from dmae.calibration.hypothesis import Hypothesis

_FRAMES = 60
_MOST_ARROWS = 900


def epipolar_arrows(hypothesis: Hypothesis) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return for each camera the places of its joints, (n, 2) undistorted px, and the vectors from there to the lines.

    A line is the epipolar line of the joint in another camera with a matching detection. A correct camera has short
    arrows in all directions. Arrows with a common pattern show how the image of the camera is displaced.
    """
    pairs = pairs_to_compare(len(hypothesis.rig))
    sample = ViewSample.of(hypothesis, hypothesis.sample_frames(_FRAMES))
    found = measure_agreement(sample, pairs)
    a, b = np.asarray(pairs)[found.pair].reshape(-1, 2).T
    F = fundamental(sample.rig, a, b)
    points = [sample.homogeneous[view, found.frame, index] for view, index in ((a, found.a), (b, found.b))]
    lines = [points[1] @ F, points[0] @ F.swapaxes(-1, -2)]
    arrows = []
    for view in range(len(hypothesis.rig)):
        starts, ways = [], []
        for at, own, line in zip((a, b), points, lines, strict=True):
            own, line = own[at == view].reshape(-1, 3), line[at == view].reshape(-1, 3)
            with np.errstate(divide="ignore", invalid="ignore"):
                off = (own * line).sum(-1, keepdims=True) / (line[:, :2] ** 2).sum(-1, keepdims=True)
            way = -off * line[:, :2]
            known = np.isfinite(way).all(-1)
            starts.append(own[known, :2])
            ways.append(way[known])
        arrows.append((np.concatenate(starts), np.concatenate(ways)))
    return arrows


def draw_arrows(hypothesis: Hypothesis, title: str, images: list[np.ndarray | None] | None = None) -> list[bytes]:
    """Return a PNG for each camera: its epipolar arrows, enlarged ten times, on its image if there is one.

    Args:
        images: (h, w, 3) RGB by camera; None for a blank one.
    """
    from matplotlib.figure import Figure

    pictures = []
    for view, (start, way) in enumerate(epipolar_arrows(hypothesis)):
        width, height = hypothesis.rig.size[view]
        figure = Figure(figsize=(8, 8 * height / width + 0.5), layout="constrained")
        axes = figure.subplots()
        if images is not None and images[view] is not None:
            axes.imshow(images[view], extent=(-0.5, width - 0.5, height - 0.5, -0.5), alpha=0.6)
        every = slice(None, None, len(start) // _MOST_ARROWS + 1)
        length = np.linalg.norm(way, axis=-1)
        if len(start):
            quiver = axes.quiver(*start[every].T, *(10 * way[every]).T, length[every], angles="xy", scale_units="xy",
                                 scale=1, width=0.002, cmap="viridis", clim=(0, 20))  # fmt: skip
            figure.colorbar(quiver, ax=axes, label="px to the epipolar line", shrink=0.7)
        axes.set(xlim=(0, width), ylim=(height, 0), aspect="equal")
        median = f"median {np.median(length):.1f} px" if len(length) else "no detection matches another camera's"
        axes.set_title(f"{title}, camera {hypothesis.rig.names[view]}: {median}; arrows 10 x", fontsize=10)
        figure.savefig(buffer := BytesIO(), format="png", dpi=90)
        pictures.append(buffer.getvalue())
    return pictures
