"""Cameras: where they are, what they cover, and how their calibration is wrong."""
