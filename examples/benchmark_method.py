"""Your interpolation on the benchmark: ten lines, the same gaps for all, a table, and intervals.

The clips are made here, from a definition and its seed, and compared with frozen checksums. A second argument names
another benchmark, a YAML file of your own.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import dmae

out = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples")
out.mkdir(parents=True, exist_ok=True)
name = sys.argv[2] if len(sys.argv) > 2 else "occlusion-v2"


def nearest(poses: dmae.Poses3D, fps: float) -> dmae.Poses3D:
    """Fill a gap with the measurement nearest in time."""
    xyz, frames = poses.xyz.copy(), np.arange(len(poses.xyz))
    for person, joint in np.ndindex(*poses.source.shape[1:]):
        known = np.flatnonzero(poses.measured[:, person, joint])
        if len(known):
            near = known[np.abs(frames[:, None] - known).argmin(1)]
            xyz[:, person, joint] = poses.xyz[near, person, joint]
    filled = ~np.isnan(xyz).any(-1) & ~poses.measured
    return replace(poses, xyz=xyz, source=np.where(filled, dmae.Source.COMPLETED, poses.source))


scores = dmae.benchmark(
    methods=[nearest, "linear", "gaussian_process", "dmae"], name=name, workers=2, out=out / "benchmark"
)
levels = [level["name"] for level in scores["levels"]]
print(f"{len(scores['clips'])} clips, checksums: {scores['checksums']}; mean error in gaps, mm, by level")
print(f"{'':18}" + "".join(f"{level:>8}" for level in levels) + "     all")
figure = Figure(figsize=(7, 3), layout="constrained")
axes = figure.subplots()
for method, entry in scores["completion"].items():
    found = entry["summary"]
    print(f"{method:18}" + "".join(f"{mm:8.0f}" for mm in found["levels"]) + f"{found['mm']['value']:8.0f}")
    axes.plot(levels, found["levels"], "o-", label=method)
axes.set(xlabel="main cause of the level", ylabel="mean error [mm]")
axes.legend(frameon=False)
figure.savefig(out / "benchmark_method.png", dpi=100)
