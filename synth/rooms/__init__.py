"""Arenas, furniture and their finish."""
