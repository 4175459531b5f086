"""What errors do 2D pose detectors make? Simulate a detector, measure real ones, and fit presets to them."""
