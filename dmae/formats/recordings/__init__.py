"""What formats share: numbered detections, matching of cameras, selection of frames and views, files of poses."""
