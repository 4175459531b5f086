"""Frames as they come: capture and completion while cameras run, each frame finished with a bounded delay.

`OnlineCapture` takes the detections of one frame and gives back the frames that are now finished. Here a simulated
clip stands in for the cameras.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import dmae
import synth

out = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples")
out.mkdir(parents=True, exist_ok=True)
clip = next(synth.generate(seconds=4, clips=1, seed=2)).select(views=[0, 1, 3])
skeleton, found = clip.detections.skeleton, clip.detections

complete = dmae.completer(skeleton)
stream = dmae.OnlineCapture(clip.rig, skeleton, clip.fps, dmae.CaptureConfig(), complete)
print(f"a frame is finished at most {stream.delay} frames, {stream.delay / clip.fps:.2f} s, after it came")

finished, waited = [], []
for frame in range(len(clip)):
    arriving = dmae.Detections2D(skeleton, found.xy[frame : frame + 1], found.score[frame : frame + 1])
    for done in stream.push(arriving):
        finished.append(done)
        waited.append(frame - done.number)
finished += stream.flush()
print(f"{len(finished)} frames in and out, waiting {min(waited)} to {max(waited)} frames")

# A wrist or ankle that was measured and completed often: what cameras measured, what was completed, what is true.
people = np.unique(np.concatenate([done.people for done in finished]))
xyz = np.full((len(clip), len(people), len(skeleton), 3), np.nan)
completed = np.zeros(xyz.shape[:-1], bool)
for done in finished:
    rows = np.searchsorted(people, done.people)
    xyz[done.number, rows] = done.poses.xyz[0]
    completed[done.number, rows] = done.poses.source[0] == dmae.Source.COMPLETED
ends = skeleton.index("r_wrist", "l_wrist", "r_ankle", "l_ankle")
often = np.minimum(completed[:, :, ends].sum(0), (np.isfinite(xyz[..., 0]) & ~completed)[:, :, ends].sum(0))
person, end = np.unravel_index(often.argmax(), often.shape)
joint = skeleton.joints[ends[end]]
path, marked = xyz[:, person, ends[end]], completed[:, person, ends[end]]
print(f"{joint}: measured in {np.isfinite(path[~marked, 2]).sum()} frames, completed in {marked.sum()}")
truth = clip.truth.xyz[:, :, clip.truth.skeleton.index(f"body25.{joint}")[0]]
nearest = np.nanmean(np.linalg.norm(truth - path[:, None], axis=-1), 0).argmin()

seconds = np.arange(len(clip)) / clip.fps
figure = Figure(figsize=(7, 3), layout="constrained")
axes = figure.subplots()
axes.plot(seconds, truth[:, nearest, 2], color="#bbbbbb", linewidth=4, label="truth")
axes.plot(seconds[~marked], path[~marked, 2], ".", color="#2f8fe8", label="measured")
axes.plot(seconds[marked], path[marked, 2], "x", color="#e5262a", label="completed")
axes.set(xlabel="time [s]", ylabel=f"height of {joint} [m]")
axes.legend(frameon=False)
figure.savefig(out / "frames_as_they_come.png", dpi=100)
