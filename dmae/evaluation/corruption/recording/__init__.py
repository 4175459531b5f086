"""Corruptions of cameras, calibration, times and the number of people, a file each."""
