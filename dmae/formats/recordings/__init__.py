"""Code that formats share: numbered detections, matching of cameras, selection of frames and views, pose files."""
