"""ARE THE CAMERAS KNOWN? Calibration files, a file a format; `files` finds, recognises, reads and writes them."""
