"""Your triangulation under pytest: 25 fixed cases with documented bounds.

    pytest examples/triangulation_check.py        # one test per case
    python examples/triangulation_check.py        # the same, as a figure

`solve` is the linear method of textbooks. It passes 17 cases. It fails where a view is in error, and where textbooks
leave something out: points behind cameras, skewed pixels, large coordinates. Replace it by your own.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure


def solve(*, K, dist, cam_from_world, size, xy, confidence):
    """(n, V, 2) px, NaN where absent, to (n, 3) m: the direct linear transform, all views with equal weight."""
    views = [cv2.undistortPoints(xy[:, v, None], K[v], dist[v], P=K[v])[:, 0] for v in range(len(K))]
    xy, P = np.stack(views, 1), K @ cam_from_world[:, :3]
    rows = xy[..., None] * P[:, None, 2] - P[:, :2]
    rows = np.where(np.isfinite(xy)[..., None], rows, 0).reshape(len(xy), -1, 4)
    homogeneous = np.linalg.svd(rows)[2][:, -1]
    enough = np.isfinite(xy[..., 0]).sum(-1) >= 2
    return np.where(enough[:, None], homogeneous[:, :3] / homogeneous[:, 3:], np.nan)


def test_triangulation(check_triangulation):
    check_triangulation(solve)


def main(out: Path) -> None:
    from dmae.regression import check

    verdicts = check(solve)
    passed = [verdict.case.name for verdict in verdicts if verdict.passed]
    print(f"{len(passed)} of {len(verdicts)} cases passed")
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.subplots()
    for verdict in verdicts:
        ratio = max(verdict.measured[key] / bound for key, bound in verdict.bounds.items() if bound)
        if "invented" in verdict.broken:  # Its bound is 0
            ratio = 100
        axes.barh(verdict.case.name, np.clip(ratio, 0.01, 100), color="#46c47c" if verdict.passed else "#e5262a")
        if not verdict.passed:
            print(verdict)
    axes.axvline(1, color="black", linewidth=1)
    axes.set(xscale="log", xlim=(0.008, 110), xlabel="worst measure / its bound (red: over the bound)")
    axes.tick_params(axis="y", labelsize=8)
    axes.invert_yaxis()
    figure.savefig(out / "triangulation_check.png", dpi=100)


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples")
    folder.mkdir(parents=True, exist_ok=True)
    main(folder)
