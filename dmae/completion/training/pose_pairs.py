"""Pairs of true and captured poses of the same persons: what a model learns from."""

from dataclasses import dataclass

import numpy as np

from dmae.completion.fusion import true_pair
from dmae.data.clip import Clip, Poses3D
from dmae.data.conversion import convert
from dmae.data.skeleton import Skeleton
from dmae.metrics.comparison import match, take_matched
from dmae.numerics.filling import resample


@dataclass(frozen=True)
class PosePair:
    """True poses, and the same persons as cameras captured them.

    Attributes:
        truth: F frames, P persons, J joints.
        captured: The same persons in the same order, with gaps and errors; None where nothing was captured. On the
            skeleton of the truth; of two side by side on the first.
    """

    truth: Poses3D
    captured: Poses3D | None = None


def pose_pair(clip: Clip, skeleton: Skeleton, fps: float) -> PosePair:
    """Return the true poses of a clip, and where it has `poses` those of the same persons, at another rate.

    Raises:
        ValueError: the clip has no truth, or infinite coordinates, or for two skeletons side by side
            (`dmae.completion.fusion`) no truth on the second.
        KeyError: the skeleton cannot be derived from those of the clip.
    """
    if clip.truth is None:
        raise ValueError(f"clip {clip.id!r} has no truth to learn from")
    for name, poses in (("truth", clip.truth), ("poses", clip.poses)):
        if poses is not None and np.isinf(poses.xyz).any():
            raise ValueError(f"clip {clip.id!r}: {name} has infinite coordinates; unknown joints must be NaN")
    source, target = skeleton.parts[0], skeleton.parts[-1]
    truth = convert(clip.truth, skeleton) if source is target else true_pair(clip.truth, skeleton)
    if clip.poses is None:
        return PosePair(resample(truth, clip.fps, fps))
    poses = convert(clip.poses, source)
    measured = Poses3D(source, np.where(poses.measured[..., None], poses.xyz, np.nan), rays=poses.rays)
    matches = match(convert(measured, target).xyz, convert(truth, target).xyz)
    captured = Poses3D(source, take_matched(measured.xyz, matches), rays=take_matched(measured.rays, matches))
    return PosePair(resample(truth, clip.fps, fps), resample(captured, clip.fps, fps))
