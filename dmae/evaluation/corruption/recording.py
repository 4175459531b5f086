"""What a recording lacks: cameras, frames, synchronisation, a right calibration."""

from dataclasses import replace

import cv2
import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.corrupt import share_of_time, undetected
from dmae.evaluation.corruption.registry import corruption
from dmae.formats.reading import shift_views


@corruption(
    "cameras", order=90, unit="cameras fewer", levels=(1, 2, 3), small=(1, 2, 3), fewer_cameras=True, whole=True
)
def cameras(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Cameras left out, drawn at random: of five, one fewer is four."""
    kept = np.sort(rng.permutation(len(clip.rig))[int(level) :])
    return replace(clip.select(views=kept.tolist()), poses=clip.poses)


@corruption("frame_rate", order=91, unit="frames left out", levels=(1, 3, 7, 15), small=(3, 7), whole=True)
def frame_rate(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Frames left out after each frame that is kept: 1 halves the frame rate.

    Truth is left out with its frames. Nothing is drawn at random.
    """
    every = int(level) + 1
    return replace(clip.select(frames=slice(None, None, every)), fps=clip.fps / every)


@corruption("dropouts", order=31, unit="%", levels=(10, 20, 40, 60), small=(20, 40), most=100)
def dropouts(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Cameras that deliver nothing, % of the time, in bursts, each on its own."""
    lost = share_of_time(clip, (len(clip.rig),), level, (1.0, 0.1), rng=rng)
    return undetected(clip, lost[..., None, None])


@corruption("offsets", order=32, unit="frames", levels=(2, 4, 8, 16), small=(4, 8), whole=True)
def offsets(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Frames by which half of the cameras, drawn at random, are late."""
    late = rng.permutation(len(clip.rig)) < len(clip.rig) // 2
    return shift_views(clip, (late * int(level)).tolist())


@corruption("calibration", order=33, unit="degrees", levels=(0.2, 0.5, 1, 2), small=(0.5, 1), most=45)
def calibration(clip: Clip, level: float, *, rng: np.random.Generator) -> Clip:
    """Degrees by which the calibrated direction of each camera is off; 0.1 is 1 cm at 6 m.

    The camera is turned about a random axis across its line of sight. The detections stay.
    """
    angle = rng.uniform(0, 2 * np.pi, len(clip.rig))
    axis = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], -1)
    turned = clip.rig.cam_from_world.copy()
    for view, vector in enumerate(axis * np.radians(level)):
        turned[view, :3] = cv2.Rodrigues(vector)[0] @ turned[view, :3]
    return replace(clip, rig=replace(clip.rig, cam_from_world=turned), true_rig=clip.actual_rig)
