"""Are the cameras right: faults of a calibration, found and named."""
