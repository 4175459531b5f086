"""The mistakes that 2D pose detectors make, in one view."""

from synth.mistakes.config import DetectorConfig, PartConfig, PartsConfig

__all__ = ["DetectorConfig", "PartConfig", "PartsConfig"]
