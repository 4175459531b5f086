"""Corruptions of cameras, calibration, times and the number of people, one module each."""
