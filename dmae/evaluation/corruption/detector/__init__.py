"""Corruptions of what a detector says, a file each."""
