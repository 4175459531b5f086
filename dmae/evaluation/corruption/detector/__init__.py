"""Corruptions of the output of a detector, one module each."""
