"""Formats of programs for biomechanics and animation: C3D, BVH, GLB."""
