"""Errors of 2D pose detectors: simulate a detector, measure real detectors, and fit presets to them."""
