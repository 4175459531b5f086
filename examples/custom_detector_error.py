"""A detector error of your own: sun glare that blinds a part of each image, for a while.

An error is a function of a `View`, what one camera's detector reports so far and the truth that it depends on. It
returns the view with its errors added. `detector.custom` names it, here and on the command line.
"""

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import dmae
import synth
from synth.detector.view import View


def sun_glare(view: View, *, rng: np.random.Generator) -> View:
    """Blind the left or right two thirds of the image for two seconds: joints in it are missed."""
    frames = np.arange(len(view.score))
    start, left = rng.integers(0, max(len(frames) - 2 * view.fps, 1)), rng.random() < 0.5
    blinded = (frames >= start) & (frames < start + 2 * view.fps)
    x = view.xy[..., 0] / view.size[0]
    in_glare = x < 2 / 3 if left else x > 1 / 3
    return view.without(blinded[:, None, None] & in_glare)


def main(out: Path) -> None:
    figure = Figure(figsize=(8, 2.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, errors in zip(panels, ([], ["custom_detector_error:sun_glare"]), strict=True):
        detector = synth.preset("detector", "shelf_openpose", custom=errors)
        clip = next(synth.generate(clips=1, seconds=4, detector=detector, seed=3))
        detected = np.isfinite(clip.detections.score).any(-1).sum(-1)  # (F, V)
        scores = dmae.evaluate(clip, dmae.capture(clip))
        absent = scores["shares"]["absent"]
        name = "with sun glare" if errors else "the preset alone"
        print(f"{name:18} {absent:4.1f} % of the joints are not measured, PCP {scores['pcp']:.1f} %")
        joints = np.isfinite(clip.detections.score).sum((-1, -2)).T
        extent = (0, len(clip) / clip.fps, len(clip.rig) - 0.5, -0.5)
        image = axes.imshow(joints, aspect="auto", interpolation="nearest", extent=extent, vmin=0, vmax=80)
        axes.set(xlabel="time [s]", title=f"{name}: {detected.sum()} detections", yticks=range(len(clip.rig)))
    panels[0].set_ylabel("camera")
    figure.colorbar(image, ax=panels, label="joints detected")
    figure.savefig(out / "custom_detector_error.png", dpi=100)


if __name__ == "__main__":
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "runs/examples")
    folder.mkdir(parents=True, exist_ok=True)
    main(folder)
