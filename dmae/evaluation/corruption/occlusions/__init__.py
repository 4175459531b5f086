"""Corruptions that hide joints from cameras, one module each."""
