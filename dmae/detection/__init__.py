"""What do pixels show? From the videos of cameras to 2D detections of people."""
