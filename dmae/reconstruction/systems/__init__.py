"""Published systems of multi-view capture, one a file, for comparison on the same detections."""
