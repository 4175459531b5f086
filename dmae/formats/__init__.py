"""WHICH FORMAT IS A FILE IN? Formats of recordings and poses: one module per format, with its reader and its writers.

`registry` lists the formats, `reading` and `writing` use them, `calibrations` has the formats of cameras, `recordings`
what formats of several cameras share.
"""
