"""HOW GOOD IS IT? Metrics of predicted against true poses: one module per family of metrics, and their registry.

Arrays are (F, P, J, 3) of predictions and (F, T, J, 3) of truth, m, world, on the same J joints; T true persons. Frames
without a true person are not annotated and do not count.
"""
