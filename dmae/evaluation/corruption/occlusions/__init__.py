"""Corruptions that hide joints from cameras, a file each."""
