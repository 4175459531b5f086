"""Checks of a calibration: faults of its cameras are found and named."""
