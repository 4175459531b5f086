"""A data set, and a model trained on it, in a minute: simulate, capture, train, complete people it has never seen.

The model is trained for 200 steps. It shows the steps; the weights that come with the package were trained
for longer, on more (see their model card). Conclude only that training works: that both come out alike on four
seconds of two people, in the kind of room and before the very cameras that this model learned from, does not show
that 200 steps are enough. Which of them is better in other rooms and with other cameras, this script does not measure.
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

# A clip of another seed: other people and motion, but the same cameras and kind of room.
test = next(synth.generate(seconds=4, clips=1, seed=2, scene="office")).select(views=[0, 1, 3])
methods = {
    "measured": dmae.capture(test),
    "linear": dmae.capture(test, fill="linear"),
    "this model": dmae.complete(dmae.capture(test), test.fps, weights=folder),
    "shipped weights": dmae.complete(dmae.capture(test), test.fps),
}
pcp = {name: dmae.evaluate(test, poses)["pcp"] for name, poses in methods.items()}

# Linear filling ends where nothing was measured. The errors compared are those of the joints that it fills.
filled = methods["linear"].source == dmae.Source.COMPLETED
errors = {}
for name, poses in methods.items():
    found = (poses.source == dmae.Source.COMPLETED).mean()
    errors[name] = dmae.evaluate(test, poses.without(~filled))["mpjpe"]["completed"]
    error = f"   the same joints: {errors[name]:.0f} mm off" if found else ""
    print(f"{name:16} PCP {pcp[name]:5.1f} %   completes {found:3.0%} of the joints{error}")

figure = Figure(figsize=(7, 2.6), layout="constrained")
axes = figure.subplots(1, 2, sharey=True)
axes[0].barh([*pcp], pcp.values(), color="#2f8fe8")
axes[1].barh([*errors], errors.values(), color="#e5262a")
axes[0].set(xlabel="strict PCP [%]")
axes[1].set(xlabel="error of the joints that all complete [mm]")
axes[0].invert_yaxis()
figure.savefig(out / "dataset_and_model.png", dpi=110)
