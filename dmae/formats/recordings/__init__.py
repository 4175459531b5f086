"""What formats of several cameras share: numbered detections, matching of cameras, selection of frames and views."""
