"""Occluded multi-view human motion: capture it, complete it, score it.

The package never imports the generator (`synth`) or its physics engine, and
importing it loads neither torch nor hydra.
"""
