"""How do 2D pose detectors err? Simulate a detector, measure real ones, and fit it to them."""
