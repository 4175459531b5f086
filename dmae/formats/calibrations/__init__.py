"""ARE THE CAMERAS KNOWN? Calibration files, one module per format; `files` finds, recognises, reads and writes them."""
