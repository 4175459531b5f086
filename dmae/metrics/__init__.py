"""Metrics of predicted poses against true poses: one module per family of metrics, and their registry.

Predictions are (F, P, J, 3) and the truth is (F, T, J, 3), m, world, on the same J joints; T true persons. Frames
without a true person are not annotated and do not count.
"""
