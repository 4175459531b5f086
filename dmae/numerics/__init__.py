"""How is a path filled? Interpolation, smoothing and noise of samples over time, and geometry of bodies."""
