"""Cameras: examine a calibration, and refine it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dmae.data.clip import Clip
from dmae.public.arguments import checked

if TYPE_CHECKING:
    from dmae.calibration.config import RefineConfig
    from dmae.calibration.doctor import Diagnosis
    from dmae.calibration.refinement import Refined


@checked
def doctor(clip: Clip, *, max_offset: int = 50) -> Diagnosis:
    """Find faults of a calibration by comparing the detections of its cameras.

    Args:
        clip: F frames of V cameras; only cameras and detections are read.
        max_offset: Largest time offset between two cameras that is tried, in frames, in both directions.

    Returns:
        `findings`, each with fault, cameras, evidence and remedy, in the order to correct them; empty if nothing is
        wrong. `pairs`: how well every two cameras agree.

    Raises:
        ValueError: `max_offset` is negative.

    Examples:
        >>> clip = next(synth.generate(seconds=1, clips=1, seed=7))
        >>> dmae.doctor(clip).findings
        ()
    """
    from dmae.calibration.doctor import diagnose

    return diagnose(clip, max_offset=max_offset)


@checked
def calibrate(clip: Clip, refine: RefineConfig | None = None) -> Refined:
    """Refine the calibration of a clip by the people in it: bundle adjustment over their joints and bones.

    Args:
        clip: F frames of V cameras; only cameras and detections are read.
        refine: What may change (`dmae.calibration.config.RefineConfig`); by default the extrinsics of
            the cameras that clearly differ from their calibration.

    Returns:
        `rig`, the cameras; `offset` and `drift` of their clocks; `covariance`; `changes`, corrections by camera.

    Raises:
        ValueError: there are too few cameras or people, or `refine` names a camera that does not exist.

    Examples:
        >>> clip = next(synth.generate(seconds=3, clips=1, seed=7))
        >>> refined = dmae.calibrate(clip)
        >>> refined.rig.names == clip.rig.names
        True
    """
    from dmae.calibration.refinement import refine as run

    return run(clip, refine)
