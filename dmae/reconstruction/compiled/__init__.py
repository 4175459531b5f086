"""Inner loops of capture, compiled to machine code."""
