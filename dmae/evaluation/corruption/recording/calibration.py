"""Calibrations with wrong directions of cameras."""

from dataclasses import replace

import cv2
import numpy as np

from dmae.data.clip import Clip
from dmae.evaluation.corruption.registry import corruption


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
    return replace(clip, rig=replace(clip.rig, cam_from_world=turned), true_rig=clip.true_rig or clip.rig)
