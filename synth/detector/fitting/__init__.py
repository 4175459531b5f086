"""Fit the parameters of a simulated detector to measured statistics."""
