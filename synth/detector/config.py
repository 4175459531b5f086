"""The configuration of a simulated 2D pose detector: one field for each kind of error."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from dmae.data.typed import Configuration
from synth.detector.errors_of_joints import Inversions, Misses, Noise, Scores
from synth.detector.errors_of_persons import Drops, Ghosts, Merges, Splits, Swaps, Timing
from synth.detector.parts import PartsConfig
from synth.detector.view import Times


@dataclass(frozen=True)
class DetectorConfig(Configuration):
    """A 2D pose detector of BODY25. By default it detects all visible joints and no others, without error.

    Errors are applied in the order of their fields. Each has its own random streams: changing one does not change the
    random numbers of the others.
    """

    name: str = "clean"
    """Name of the preset."""
    parts: PartsConfig = field(default_factory=PartsConfig)
    """Noise, scores and misses by kind of joint."""
    times: Times = field(default_factory=Times)
    """Correlation times of errors."""
    timing: Timing = field(default_factory=Timing)
    """Unsynchronised cameras and rolling shutters."""
    swaps: Swaps = field(default_factory=Swaps)
    """Joints that are detected on another person."""
    noise: Noise = field(default_factory=Noise)
    """Errors of the positions of detected joints."""
    scores: Scores = field(default_factory=Scores)
    """Confidences."""
    misses: Misses = field(default_factory=Misses)
    """Joints, limbs and persons that are not detected."""
    inversions: Inversions = field(default_factory=Inversions)
    """Left limbs that are detected as right ones, and right as left."""
    merges: Merges = field(default_factory=Merges)
    """Two persons that become one detection."""
    splits: Splits = field(default_factory=Splits)
    """One person that becomes two detections."""
    ghosts: Ghosts = field(default_factory=Ghosts)
    """Persons that are detected where none are."""
    drops: Drops = field(default_factory=Drops)
    """Frames that are lost."""
    custom: list[str] = field(default_factory=list)
    """Errors of your own, applied last: `module:function` each, called as function(view, rng=generator) -> view (see
    `synth.detector.view.View`)."""

    def errors(self) -> dict[str, Any]:
        """Return the parameters of each kind of error by its name, in order of application. Each has a method `apply`,
        which returns a `View` with errors of this kind."""
        return {name: value for name, value in vars(self).items() if hasattr(value, "apply")}


class ErrorReference(StrEnum):
    """The reference that detections are measured against."""

    others = "others"
    """Poses captured from the other views."""
    annotated = "annotated"
    """The recording's own truth, on the joints that it shares with the detector."""


@dataclass(frozen=True)
class Limits(Configuration):
    """Greatest differences allowed between a recording and its simulation."""

    miss: float = 0.03
    """Difference of the fractions of missed joints."""
    joint_miss: float = 0.1
    """Difference of the fractions of joints missed with their neighbour."""
    distance: float = 0.1
    """Kolmogorov-Smirnov distance between distributions: of errors, and of miss lengths."""
    confidence: float = 0.2
    """Relative difference between the median errors at one confidence."""
    views: float = 0.15
    """Kolmogorov-Smirnov distance between distributions of the number of views that detect a joint."""
