"""Cameras: their placement, their coverage, and the errors of their calibration."""
