"""WHICH FORMAT IS A FILE IN? Formats of recordings and poses: one module per format, with its reader and its writers.

`registry` lists the formats, and `reading` and `writing` use them. `calibrations` contains the formats of cameras.
`recordings` contains the code that formats with several cameras share.
"""
