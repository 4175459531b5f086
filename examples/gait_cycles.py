"""Gait cycles: heel strikes, and the average cycle of the knees, from captured poses.

At a heel strike the heel is farthest in front of the pelvis (Zeni, Richards and Higginson, Gait & Posture 2008).
Angles between two strikes of a foot are resampled to 0 to 100 % and averaged. A recorded walk of the CMU database,
before simulated cameras, shows how far to trust both: joints are the true ones, or captured and completed.
"""

import os
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.signal import find_peaks

import dmae
import synth


def heel_strikes(poses, fps, side, person=0):
    """Return the frames in which the heel is farthest in front of the pelvis, in the direction of walking."""
    joints = poses.skeleton.index("mid_hip", f"{side}_heel")
    paths = pd.DataFrame(poses.xyz[:, person, joints, :2].reshape(-1, 4)).interpolate().to_numpy()
    hip, heel = paths[:, :2], paths[:, 2:]
    # The pelvis sways, so people walk in the direction of its mean velocity over half a second.
    window = pd.DataFrame(np.gradient(hip, axis=0)).rolling(round(0.5 * fps), center=True, min_periods=1)
    forward = window.mean().to_numpy()
    ahead = ((heel - hip) * forward).sum(1) / np.linalg.norm(forward, axis=1)
    return find_peaks(ahead, distance=0.5 * fps, prominence=0.1)[0]


out = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples")
out.mkdir(parents=True, exist_ok=True)
take = Path(os.environ.get("DMAE_DATA", "."), "cmu/asf_amc/02_01.amc")
if not take.is_file():
    sys.exit(f"skipped: no {take}; set DMAE_DATA to the folder that holds cmu/, takes of mocap.cs.cmu.edu")
motion = synth.MotionConfig(kind="amc", path=str(take))
clip = next(synth.generate(seconds=3, clips=1, persons=[1, 1], scene="studio", motion=motion, seed=3))
full = dmae.complete(dmae.capture(clip), fps=clip.fps)

figure = Figure(figsize=(7, 3), layout="constrained")
axes = figure.subplots()
for name, poses in ("true", dmae.to_skeleton(clip.truth, "body25")), ("completed", full):
    dmae.export(clip, out / f"{name}.mot", poses=poses)  # also writes <name>.angles.csv
    angles, cycles = pd.read_csv(out / f"{name}.angles.csv", index_col="time"), []
    for side in "rl":
        strikes = heel_strikes(poses, clip.fps, side)
        knee = angles[f"knee_angle_{side}"].interpolate()
        cycles += [np.interp(np.linspace(*ends, 101) / clip.fps, knee.index, knee) for ends in pairwise(strikes)]
        print(f"{name}, {side}: heel strikes at {', '.join(f'{strike / clip.fps:.2f}' for strike in strikes)} s")
    mean, sd = np.mean(cycles, 0), np.std(cycles, 0)
    print(f"{name}: {len(cycles)} cycles, knees bend by up to {mean.max():.0f} degrees, at {mean.argmax()} %")
    (line,) = axes.plot(mean, label=f"{name}, {len(cycles)} cycles")
    axes.fill_between(range(101), mean - sd, mean + sd, color=line.get_color(), alpha=0.2)
axes.set(xlabel="gait cycle [%]", ylabel="knee flexion [°]", xlim=(0, 100))
axes.legend(frameon=False)
figure.savefig(out / "gait_cycles.png", dpi=100)
