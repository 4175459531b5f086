"""A data set, and a model trained on it, in a minute: simulate, capture, train, complete people it has never seen.

The model is tiny and trained for seconds. It shows the steps; the weights that come with the package were trained
for longer, on more (see their model card).
"""

import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from matplotlib.figure import Figure

import dmae
import synth

out = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples")
out.mkdir(parents=True, exist_ok=True)
steps = int(sys.argv[2]) if len(sys.argv) > 2 else 200

# Simulated people with exact truth. Capturing them with three cameras gives the gaps and errors of real capture.
clips = list(synth.generate(seconds=3, clips=10, seed=1, scene="office"))
clips = [clip.select(views=[0, 1, 3]) for clip in clips]
clips = [replace(clip, poses=dmae.capture(clip)) for clip in clips]
hidden = sum((clip.poses.source == dmae.Source.ABSENT).mean() for clip in clips) / len(clips)
print(f"{len(clips)} clips, {sum(len(clip) for clip in clips)} frames, {hidden:.0%} of the joints not measured")

folder = tempfile.mkdtemp(prefix="model_")
dmae.train(clips, folder, dmae.TrainConfig(learning=dmae.LearningConfig(steps=steps, epoch=min(steps, 200))))

# A clip of another seed: no camera, person or motion of it was in the training.
test = next(synth.generate(seconds=4, clips=1, seed=2, scene="office")).select(views=[0, 1, 3])
methods = {
    "measured": dmae.capture(test),
    "linear": dmae.capture(test, fill="linear"),
    "this model": dmae.complete(dmae.capture(test), test.fps, weights=folder),
    "shipped weights": dmae.complete(dmae.capture(test), test.fps),
}
scores = {name: dmae.evaluate(test, poses) for name, poses in methods.items()}
for name, found in scores.items():
    error = "" if name == "measured" else f"error of completed joints {found['mpjpe']['completed']:.0f} mm"
    print(f"{name:16} PCP {found['pcp']:5.1f} %   {error}".rstrip())

figure = Figure(figsize=(7, 2.6), layout="constrained")
axes = figure.subplots(1, 2, sharey=True)
rows = range(len(scores))
axes[0].barh(rows, [found["pcp"] for found in scores.values()], color="#2f8fe8")
axes[1].barh(rows, [found["mpjpe"]["completed"] for found in scores.values()], color="#e5262a")
axes[0].set(xlabel="strict PCP [%]", yticks=rows, yticklabels=scores)
axes[1].set(xlabel="error of completed joints [mm]")
axes[0].invert_yaxis()
figure.savefig(out / "dataset_and_model.png", dpi=110)
