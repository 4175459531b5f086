"""HOW IS IT FAST? Inner loops of capture, compiled to machine code."""
